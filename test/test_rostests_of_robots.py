"""Every rostest of the robots and of fault injection."""
from pathlib import Path

import pytest
from rostests import check, of_packages

CORE = of_packages("src/shsa_core")
OTHERS = [path for path in of_packages("src/*", "examples/*") if path not in CORE]


@pytest.mark.parametrize("path", OTHERS, ids=lambda path: path.stem)
def test_rostest(path: Path) -> None:
    check(path)
