"""The page on injection has every fault, in the words of the command."""
from pathlib import Path

from shsa_injection.vocabulary import FAULTS, Place

PAGE = Path(__file__).resolve().parents[4] / "docs" / "injection.md"
MADE_IN = {
    Place.PROCESS: "the process",
    Place.MESSAGES: "messages",
    Place.LINE: "the serial line",
    Place.GRAPH: "the graph",
    Place.MASTER: "the master",
}


def test_the_page_has_a_row_for_every_fault() -> None:
    lines = PAGE.read_text("utf-8").splitlines()
    start = lines.index("| fault | made in | what it does |") + 2
    shown = lines[start : lines.index("", start)]
    rows = [f"| `{word}` | {MADE_IN[each.place]} | {each.tells} |" for word, each in FAULTS.items()]
    assert shown == rows
