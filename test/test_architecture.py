"""docs/architecture.md has a row for every module of the core package, in its own words."""
import ast
from pathlib import Path
from typing import List

ROOT = Path(__file__).resolve().parent.parent
PACKAGE = ROOT / "src" / "shsa_core" / "src" / "shsa_core"
PAGE = ROOT / "docs" / "architecture.md"
PARTS = (
    "",
    *("language", "model", "files", "search", "codegen", "journal", "monitoring"),
    *("substitution", "gating", "healing", "analysis", "learning", "explaining", "cli"),
    *("ros/graph", "ros/wire", "ros/host", "ros"),
)


def idea(module: Path) -> str:
    """The first sentence of a module's or a folder's own words."""
    words = ast.get_docstring(ast.parse(module.read_text("utf-8"))) or ""
    return " ".join(words.split("\n\n")[0].split()).split(". ")[0].rstrip(".")


def table() -> List[str]:
    """The rows that the page must have, from the lowest part to the highest."""
    rows = []
    for part in PARTS:
        if part:
            rows.append(f"| **{part}** | | *{idea(PACKAGE / part / '__init__.py')}* |")
        for module in sorted((PACKAGE / part).glob("*.py")):
            if module.stem != "__init__":
                rows.append(f"| {part} | `{module.stem}` | {idea(module)} |")
    return rows


def test_the_page_has_a_row_for_every_module() -> None:
    lines = PAGE.read_text("utf-8").splitlines()
    start = lines.index("| part | module | its one idea |") + 2
    shown = lines[start : lines.index("", start)]
    assert "\n".join(shown) == "\n".join(table())


def test_every_folder_of_the_package_is_a_part() -> None:
    folders = {str(path.parent.relative_to(PACKAGE)) for path in PACKAGE.rglob("__init__.py")}
    assert folders - {"."} == set(PARTS) - {""}
