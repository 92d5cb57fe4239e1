"""docs/ontology.md and docs/som.md say what is true: their examples are run."""
import dataclasses
import pathlib
import re
from typing import Any

import pytest
from search_models import source

from shsa_core.analysis.check import check_files
from shsa_core.codegen.generator import generate
from shsa_core.codegen.program import compile_program
from shsa_core.errors import NoSubstitute
from shsa_core.healing.settings import Settings
from shsa_core.model.checks import REGISTRY
from shsa_core.language.functions import FUNCTIONS, STATEFUL
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.search.substitutes import find_substitute, iter_substitutes

DOCS = pathlib.Path(__file__).resolve().parents[4] / "docs"
TEXT = (DOCS / "ontology.md").read_text("utf-8")
SOM_TEXT = (DOCS / "som.md").read_text("utf-8")
BLOCKS = re.findall(r"```yaml\n(.*?)```", TEXT, re.DOTALL)
SOM_BLOCKS = re.findall(r"```yaml\n(.*?)```", SOM_TEXT, re.DOTALL)


@pytest.fixture
def ontology(tmp_path: pathlib.Path) -> Ontology:
    (tmp_path / "o.yaml").write_text(BLOCKS[0])
    return read_ontology(str(tmp_path / "o.yaml"))


RUNNING = [
    source("battery_voltage", "/battery_voltage", quality=0.96),
    source("battery_power", "/power", quality=0.9),
    source("linear_velocity", "/odom", quality=0.99),
    source("linear_acceleration", "/drivetrain/accel", quality=0.96),
]


def test_the_files_of_the_examples_are_valid(tmp_path: pathlib.Path) -> None:
    (tmp_path / "o.yaml").write_text(BLOCKS[0])
    (tmp_path / "s.yaml").write_text(SOM_BLOCKS[0])
    findings = check_files(str(tmp_path / "o.yaml"), str(tmp_path / "s.yaml"))
    assert [f for f in findings if f.level == "error"] == []
    assert len(read_som(str(tmp_path / "s.yaml")).services) == 2


@pytest.mark.parametrize("block", SOM_BLOCKS)
def test_the_soms_of_the_examples_are_valid(tmp_path: pathlib.Path, block: str) -> None:
    (tmp_path / "s.yaml").write_text(block)
    assert read_som(str(tmp_path / "s.yaml")).services


def test_every_key_check_and_setting_is_described() -> None:
    keys = [
        each.name
        for model in (Service, Provision)
        for each in dataclasses.fields(model)
        if each.name not in ("name", "property", "where", "sources")
    ]
    checks = ["bad", "of", "recovery", *REGISTRY]
    settings = ["~" + each.name for each in dataclasses.fields(Settings)]
    for name in [*keys, *checks, *settings]:
        assert f"`{name}`" in SOM_TEXT


def test_every_function_is_described() -> None:
    for name in [*FUNCTIONS, *STATEFUL]:
        assert f"`{name}(" in TEXT


def test_the_worked_example(ontology: Any) -> None:
    found: Any = list(iter_substitutes(ontology, RUNNING, "battery_current"))
    assert [s.derivation.function.relation for s in found] == ["power", "f1"]
    assert [round(s.quality, 3) for s in found] == [0.864, 0.821]
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
