"""docs/architecture.md names nothing that is not there, and fits on six screens."""
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "shsa_core" / "src" / "shsa_core"
PAGE = ROOT / "docs" / "architecture.md"
INTERNALS = ROOT / "docs" / "internals.md"
SCREEN = 45  # lines
PATH = re.compile(r"(?<![\w./])([a-z_]+(?:/[a-z_]+)+)(?![\w./]|\()")
"""A path in the package, as `healing/node` or `ros/sockets`; a link's target is none."""


@pytest.mark.parametrize("page", [PAGE, INTERNALS], ids=lambda page: page.stem)
def test_every_module_that_a_page_names_exists(page: Path) -> None:
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir()}
    named = {
        name for name in PATH.findall(page.read_text("utf-8")) if name.split("/")[0] in folders
    }
    assert named
    there = lambda name: (PACKAGE / name).is_dir() or (PACKAGE / f"{name}.py").is_file()
    assert [name for name in sorted(named) if not there(name)] == []


def test_the_page_fits_on_six_screens() -> None:
    assert len(PAGE.read_text("utf-8").splitlines()) <= 6 * SCREEN
