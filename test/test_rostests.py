"""Runs every rostest of the workspace, each with a master of its own."""
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TIMEOUT = 240.0
ROSTESTS = sorted(ROOT.glob("src/*/test/rostest/*.test"))


@pytest.mark.parametrize("path", ROSTESTS, ids=lambda path: path.stem)
def test_rostest(path: Path, tmp_path: Path) -> None:
    package = path.relative_to(ROOT / "src").parts[0]
    done = subprocess.run(
        ["rostest", package, path.name],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=TIMEOUT,
    )
    assert done.returncode == 0, done.stdout[-8000:]
