"""Every rostest of healing itself."""
from pathlib import Path

import pytest
from rostests import check, of_packages


@pytest.mark.parametrize("path", of_packages("src/shsa_core"), ids=lambda path: path.stem)
def test_rostest(path: Path) -> None:
    check(path)
