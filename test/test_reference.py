"""The reference has a row for all that there is, and each row says something."""
import csv
import importlib
import importlib.util
import re
from pathlib import Path
from typing import Any, List, Set
from xml.etree import ElementTree

import pytest
from listings import ROOT

from shsa_core.cli.main import command_line
from shsa_core.files import keys
from shsa_core.language.functions import CALLS
from shsa_core.model.kinds import Kind
from shsa_learning.type_check import available

PAGES = sorted((ROOT / "docs" / "reference").glob("*.md"))
INTERFACES = sorted(
    path for each in ("msg", "srv") for path in ROOT.glob(f"src/shsa_msgs/{each}/*")
)

_SPEC: Any = importlib.util.spec_from_file_location(
    "reference_tables", str(ROOT / "docs" / "reference_tables.py")
)
TABLES: Any = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(TABLES)


def rows(part: str) -> List[List[str]]:
    """Return the cells of the rows of a part's tables, without their titles."""
    lines = TABLES.PARTS[part]().splitlines()
    cells = [re.split(r"(?<!\\)\|", line)[1:-1] for line in lines if line.startswith("|")]
    rules = [number for number, line in enumerate(cells) if set(line) == {"---"}]
    return [line for at, line in enumerate(cells) if not {at, at + 1} & set(rules)]


def test_each_part_stands_on_one_page() -> None:
    pages = (ROOT / "docs").glob("*/*.md")
    asked = [name for page in pages for name in re.findall(r"{reference} (\w+)", page.read_text())]
    assert sorted(asked) == sorted(TABLES.PARTS)


@pytest.mark.parametrize(
    "part", [name for name in TABLES.PARTS if name not in ("messages", "commands")]
)
def test_each_row_says_what_it_is(part: str) -> None:
    found = rows(part)
    assert found
    for row in found:
        assert all(cell.strip() for cell in row[:2]), row


def test_every_function_has_its_words() -> None:
    shown = {row[0].strip("`").split("(")[0] for row in rows("functions")}
    assert shown == {*CALLS, "dt"}
    assert all(each.tells for each in CALLS.values())


def test_every_kind_has_its_row() -> None:
    assert [row[0].strip("`") for row in rows("kinds")] == [kind.value for kind in Kind]


@pytest.mark.skipif(not available(), reason="there is no ROS here")
@pytest.mark.parametrize("path", INTERFACES, ids=lambda path: path.name)
def test_every_field_of_a_message_has_its_row(path: Path) -> None:
    built = getattr(importlib.import_module(f"shsa_msgs.{path.parent.name}"), path.stem)
    parts = [built._request_class, built._response_class] if path.suffix == ".srv" else [built]
    texts = path.read_text().split("\n---\n")
    for part, text in zip(parts, texts):
        assert [name for _, name, _ in TABLES._fields(text)] == part.__slots__


def test_every_message_and_command_is_there() -> None:
    messages, commands = TABLES.PARTS["messages"](), TABLES.PARTS["commands"]()
    for path in ROOT.glob("src/shsa_msgs/*/*.[msa]*"):
        if path.suffix in (".msg", ".srv", ".action"):
            assert f"### {path.stem}\n" in messages
    for name in command_line()[1]:
        assert f"## shsa {name}\n" in commands


def test_every_launch_file_is_there_and_each_argument_has_its_doc() -> None:
    shown = TABLES.PARTS["launch_files"]()
    for path in ROOT.glob("src/*/launch/*.launch"):
        assert f"### {path.name}\n" in shown


def test_a_sign_of_a_table_does_not_end_its_cell() -> None:
    assert TABLES.table(("a",), [("x | y",)]) == "|a|\n|---|\n|x \\| y|\n"


EXPERT_PAGES = {
    *("reference/ontology.md", "reference/ros.md", "reference/som.md"),
    *("howto/false_alarms.md", "howto/gate.md", "howto/several_computers.md"),
    "explanation/killing.md",
}
"""The reference, and pages about what experts set; all others do with the basic keys."""
PLAIN_WORDS = {"inputs", "where", "usual", "host", "hosts"}  # words of their own elsewhere


def test_a_first_robot_needs_few_names() -> None:
    names = {name for _, line in rows("basics") for name in line.split()}
    assert len(names) <= 27
    shown = TABLES.PARTS["launch_files"]().partition("### shsa.launch")[2]
    assert all(f"|`{name}`|" in shown for name in TABLES.BASIC_ARGUMENTS)


def test_each_parameter_is_an_argument_that_its_nodes_get() -> None:
    root = ElementTree.parse(str(ROOT / "src/shsa_core/launch/shsa.launch")).getroot()
    given = {(n.get("type"), p.get("name")) for n in root.iter("node") for p in n.iter("param")}
    listed = {
        (node, row[0].strip("`~")) for row in rows("parameters") for node in row[1].split(", ")
    }
    assert given == listed
    assert {name for _, name in listed} <= {arg.get("name") for arg in root.iter("arg")}


def expert_keys() -> Set[str]:
    tables = (keys.SERVICE, keys.VALUE, keys.SOM, keys.PROPERTY, keys.FUNCTION)
    basic = {name for table in tables for name, key in table.items() if key.basic}
    return {name for table in tables for name in table} - basic - PLAIN_WORDS


def shown_keys(text: str, whole: bool) -> Set[str]:
    """Return the expert keys in a file, or in what a page shows in its listings and code spans."""
    fenced = re.findall(r"^```(?!text).*?^```", text, re.DOTALL | re.MULTILINE)
    plain = re.sub(r"^```.*?^```", "", text, flags=re.DOTALL | re.MULTILINE)
    listings = [text] if whole else fenced + re.findall(r"^ {4}.*$", plain, re.MULTILINE)
    spans = [] if whole else re.findall(r"`([^`\n]+)`", plain)
    named = {key for each in [*listings, *spans] for key in re.findall(r"([a-z_]+): ", each)}
    return (named | set(spans)) & expert_keys()


def test_only_pages_for_experts_show_expert_keys() -> None:
    docs = ROOT / "docs"
    pages = {str(path.relative_to(docs)): path.read_text() for path in docs.glob("**/*.md")}
    showing = {name for name, text in pages.items() if shown_keys(text, whole=False)}
    assert showing - EXPERT_PAGES == set(), {n: shown_keys(pages[n], False) for n in showing}
    for path in (*ROOT.glob("examples/*/*.yaml"), ROOT / "README.md"):
        assert shown_keys(path.read_text(), path.suffix == ".yaml") == set(), path


def test_each_statement_of_the_paper_has_its_place_and_its_test() -> None:
    with open(ROOT / "docs" / "data" / "paper.csv", newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    assert len({each["statement"] for each in lines}) == len(lines) > 30
    for each in lines:
        assert (ROOT / each["where"]).is_file(), each
        assert each["done"] == "yes" or (each["done"] == "partly" and each["remark"]), each
        path, _, name = each["test"].partition("::")
        assert f"def {name or 'test_'}" in (ROOT / path).read_text("utf-8"), each
