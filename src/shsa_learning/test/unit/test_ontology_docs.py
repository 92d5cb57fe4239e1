"""docs/reference/ontology.md and som.md say what is true: their examples are run."""
import dataclasses
import itertools
import pathlib
import re

from typing import Any, List

import pytest

from shsa_core.codegen.generator import generate
from shsa_core.codegen.program import compile_program
from shsa_core.errors import NoSubstitute
from shsa_core.files import keys
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service, Source
from shsa_core.search.derivation import Derivation
from shsa_learning.check import check_files
from shsa_learning.substitutes import find_substitute, substitutes

REFERENCE = pathlib.Path(__file__).resolve().parents[4] / "docs" / "reference"
ROSTEST = pathlib.Path(__file__).resolve().parents[3] / "shsa_core" / "test" / "rostest"
TEXT = (REFERENCE / "ontology.md").read_text("utf-8")
BLOCKS = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
SOM_TEXT = (REFERENCE / "som.md").read_text("utf-8")
SOM_BLOCKS = re.findall(r"```yaml\n(.*?)```", SOM_TEXT, re.DOTALL)


@pytest.fixture
def ontology(tmp_path: pathlib.Path) -> Ontology:
    (tmp_path / "o.yaml").write_text(BLOCKS[0])
    return read_ontology(str(tmp_path / "o.yaml"))


def source(name: str, topic: str, quality: float) -> Source:
    provided = (Provision(name, name, quality=quality),)
    (only,) = Service(name, topic, "p/T", "/node_of" + topic, 0.02, provided).sources
    return only


RUNNING = [
    source("battery_voltage", "/battery_voltage", 0.96),
    source("battery_power", "/power", 0.9),
    source("linear_velocity", "/odom", 0.99),
    source("angular_velocity", "/odom", 0.99),
    source("linear_acceleration", "/drivetrain/accel", 0.96),
    source("angular_acceleration", "/drivetrain/accel", 0.96),
]


def test_the_files_of_the_examples_are_valid(tmp_path: pathlib.Path) -> None:
    (tmp_path / "o.yaml").write_text(BLOCKS[0])
    (tmp_path / "s.yaml").write_text(SOM_BLOCKS[0])
    findings = check_files(str(tmp_path / "o.yaml"), str(tmp_path / "s.yaml"))
    assert [f for f in findings if f.level == "error"] == []
    assert len(read_som(str(tmp_path / "s.yaml")).services) == 2


@pytest.mark.parametrize("block", BLOCKS[1:])
def test_the_other_examples_are_valid(tmp_path: pathlib.Path, block: str) -> None:
    (tmp_path / "o.yaml").write_text(block)
    assert check_files(str(tmp_path / "o.yaml")) == []


@pytest.mark.parametrize("block", SOM_BLOCKS)
def test_the_soms_of_the_examples_are_valid(tmp_path: pathlib.Path, block: str) -> None:
    (tmp_path / "s.yaml").write_text(block)
    assert read_som(str(tmp_path / "s.yaml")).services


def test_every_field_of_the_model_has_its_key() -> None:
    ours = {"name", "property", "sources", "where", "unreadable", "unwritable", "upstream"}
    ours |= {"beyond_gate", "unknown_with"}  # `gate` and `topic` say the one, the type the other
    ours |= {"weakened", "fastest"}  # what live parameters have changed
    for kind, table in ((Service, keys.SERVICE), (Provision, keys.VALUE)):
        assert {*_names(kind)} - ours == set(table) - {"gate"}


def _names(of: Any) -> List[str]:
    return [each.name for each in dataclasses.fields(of)]


def block_after(words: str) -> str:
    """The indented lines that follow some words in the text, without their indentation."""
    lines = iter(TEXT[TEXT.index(words) :].splitlines()[2:])
    block = itertools.takewhile(lambda line: line.startswith("    "), lines)
    return "".join(line[4:] + "\n" for line in block)


def test_the_code_of_f1_and_the_listing_of_the_paper_are_as_shown(ontology: Any) -> None:
    f1 = next(f for f in ontology.functions if f.relation == "f1")
    inputs = tuple(source(name, "/" + name, 1.0) for name in f1.inputs)
    derivations = tuple(Derivation(each.property, each, None) for each in inputs)
    root = Derivation(
        "battery_current", None, dataclasses.replace(f1, constraint=None), derivations
    )
    code = generate([(root, "/battery_current/data")], ontology.constants).code
    assert code.replace("\n", "\n    ").strip() in TEXT
    page = (REFERENCE.parent / "tutorials" / "paper.md").read_text("utf-8")
    listing = page.split("CODE='")[1].split("'\n")[0]
    rostest = (ROSTEST / "paper_listing_test").read_text("utf-8")
    assert listing.replace("\\", "\\\\") in rostest
    x = (0.5, -0.2, 1.5, -3.0, 12.2)
    results = [compile_program(each, 5, 1).step(x, 0.0) for each in (code, listing)]
    assert results[0] == results[1]
    assert results[0] == pytest.approx((48.67 - 0.015 - 0.234 + 3.105 - 0.09 - 45.384,))


def test_the_worked_example(ontology: Any) -> None:
    found: Any = [found for found, _ in substitutes(ontology, RUNNING, "battery_current")]
    assert [s.derivation.function.relation for s in found] == ["power", "f1"]
    assert [round(s.quality, 3) for s in found] == [0.864, 0.78]
    program = generate([(found[0].derivation, "/battery_current/data")], ontology.constants)
    assert program.code.replace("\n", "\n    ").strip() in TEXT
    step = compile_program(program.code, 2, 1).step
    assert step((148.8, 12.4), 0.0) == pytest.approx((12.0,))
    assert step((148.8, 0.0), 0.0) is None

    without = [s for s in RUNNING if s.property != "battery_power"]
    left: Any = find_substitute(ontology, without, "battery_current")
    assert left.derivation.function.relation == "f1"
    without = [s for s in RUNNING if s.property not in ("battery_power", "battery_voltage")]
    with pytest.raises(NoSubstitute) as caught:
        find_substitute(ontology, without, "battery_current")
    assert f"*{caught.value}*" in TEXT
