"""docs/explanation/architecture.md names nothing that is not there, and fits on six screens."""
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "shsa_core" / "src" / "shsa_core"
PAGE = ROOT / "docs" / "explanation" / "architecture.md"
SCREEN = 45  # lines
PATH = re.compile(r"(?<![\w./])([a-z_]+(?:/[a-z_]+)+)(?![\w./]|\()")
"""A path in the package, as `healing/node` or `ros/sockets`; a link's target is none."""


def test_every_module_that_the_page_names_exists() -> None:
    folders = {path.name for path in PACKAGE.iterdir() if path.is_dir()}
    named = {
        name for name in PATH.findall(PAGE.read_text("utf-8")) if name.split("/")[0] in folders
    }
    assert named
    there = lambda name: (PACKAGE / name).is_dir() or (PACKAGE / f"{name}.py").is_file()
    assert [name for name in sorted(named) if not there(name)] == []


def test_the_page_fits_on_six_screens() -> None:
    assert len(PAGE.read_text("utf-8").splitlines()) <= 6 * SCREEN
