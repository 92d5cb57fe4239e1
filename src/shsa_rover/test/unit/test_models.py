"""The rover's models: valid, measured, sufficient, never tripped by a healthy rover."""
from pathlib import Path
from typing import List, Set

import numpy as np
import pytest

from shsa_core.analysis.check import check_files
from shsa_core.codegen.generator import generate
from shsa_core.codegen.program import compile_program
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.service import Provision, Service
from shsa_core.search.substitutes import find_substitute
from shsa_rover.accuracy import relations, services, substitutes
from shsa_rover.dataset import Dataset, random_drive, simulate
from shsa_rover.drive import Drive
from shsa_rover.fitting import (
    PUBLISHED,
    f1_with,
    fit_f1,
    fit_motors,
    fit_sag,
    fit_without_voltage,
)
from shsa_rover.measuring import accuracy_main, fit_data, fit_main, test_data as unseen_data

FOLDER = Path(__file__).resolve().parents[2] / "ontology"
ONTOLOGY_FILE, SOM_FILE = str(FOLDER / "rover.yaml"), str(FOLDER / "rover_som.yaml")
ONTOLOGY, SOM = read_ontology(ONTOLOGY_FILE), read_som(SOM_FILE)
INPUTS = (
    "linear_velocity",
    "linear_acceleration",
    "angular_velocity",
    "angular_acceleration",
    "battery_voltage",
)
NEEDED = {"/battery_current", "/battery_voltage", "/odom", "/drivetrain/accel", "/imu/data"}


@pytest.fixture(name="unseen", scope="module")
def _unseen() -> Dataset:
    return unseen_data()


@pytest.fixture(name="seen", scope="module")
def _seen() -> List[Dataset]:
    return fit_data()


def test_the_files_are_valid() -> None:
    assert check_files(ONTOLOGY_FILE, SOM_FILE) == []
    assert check_files(str(FOLDER / "paper.yaml"), None) == []


def test_the_needed_topics_are_those_of_the_rover() -> None:
    assert {service.topic for service in SOM.needed()} == NEEDED


def test_every_stated_quality_is_the_measured_one(unseen: Dataset) -> None:
    for item in services(SOM, unseen) + relations(ONTOLOGY, unseen):
        assert item.stated == pytest.approx(item.quality, abs=0.0101), item.name


def test_every_needed_service_has_a_substitute_that_follows_the_truth(unseen: Dataset) -> None:
    healed = substitutes(ONTOLOGY, SOM, unseen)
    assert {item.name.split(":")[0] for item in healed} == {
        source.path for service in SOM.needed() for source in service.sources
    }
    for item in healed:
        assert item.error < 0.1 * item.span, item.name


def test_the_amperemeter_is_replaced_by_f1_and_the_power_chain_is_behind_it() -> None:
    found = find_substitute(ONTOLOGY, SOM.sources, "battery_current", ["/amperemeter"])
    assert found.derivation.relations() == ("f1",)
    assert tuple(source.property for source in found.derivation.sources()) == INPUTS
    without = type(ONTOLOGY)(
        ONTOLOGY.properties,
        ONTOLOGY.constants,
        [function for function in ONTOLOGY.functions if function.relation != "f1"],
    )
    chain = find_substitute(without, SOM.sources, "battery_current", ["/amperemeter"])
    assert set(chain.derivation.relations()) == {"supply", "motors", "traction", "wheels"}


def test_the_battery_can_lose_both_of_its_sensors() -> None:
    lost = ["/amperemeter", "/voltmeter"]
    current = find_substitute(ONTOLOGY, SOM.sources, "battery_current", lost).derivation
    voltage = find_substitute(ONTOLOGY, SOM.sources, "battery_voltage", lost).derivation
    assert current.relations() == ("supply", "motors", "traction", "wheels")
    assert voltage.relations() == ("sag", *current.relations())


@pytest.mark.parametrize(
    "prop, relations_used",
    [
        ("linear_velocity", {"steering"}),
        ("angular_velocity", set()),
        ("linear_acceleration", set()),
        ("angular_acceleration", {"turning"}),
    ],
)
def test_a_dead_drivetrain_can_be_replaced(prop: str, relations_used: Set[str]) -> None:
    found = find_substitute(ONTOLOGY, SOM.sources, prop, ["/drivetrain"])
    assert set(found.derivation.relations()) == relations_used
    assert all(source.node != "/drivetrain" for source in found.derivation.sources())


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("soc", [0.2, 0.95])
def test_a_healthy_rover_never_leaves_a_range(seed: int, soc: float) -> None:
    data = simulate(random_drive(seed), 60.0, seed, soc)
    for source in SOM.sources:
        assert source.provision.range is not None
        low, high = source.provision.range
        column = data.measured[source.path]
        margin = 0.02 * (high - low)
        if source.property != "state_of_charge":
            assert low + margin < column.min() and column.max() < high - margin, source.path
        assert low <= column.min() and column.max() <= high, source.path


def test_the_fitted_coefficients_are_those_in_the_file(seen: List[Dataset]) -> None:
    """The file holds what `fit_current` prints, to the digits that it gives."""
    motors, sag = fit_motors(seen[0]).coefficients, fit_sag(seen[0]).coefficients
    for name, value in {**motors, **sag}.items():
        assert ONTOLOGY.constants[name].value == pytest.approx(value, rel=0.01), name
    text = next(f.text for f in ONTOLOGY.functions if f.relation == "f1")
    for value in fit_f1(seen).coefficients.values():
        assert f"{abs(value):.3f}" in text


@pytest.mark.parametrize("name", ["paper.yaml", "rover.yaml"])
def test_f1_has_the_inputs_of_the_paper_in_its_order(name: str) -> None:
    functions = read_ontology(str(FOLDER / name)).functions
    assert next(f.inputs for f in functions if f.relation == "f1") == INPUTS


def test_the_file_of_the_paper_holds_the_whole_f1() -> None:
    paper = read_ontology(str(FOLDER / "paper.yaml"))
    source = [
        Service(name, f"/{name}", "std_msgs/Float64", "/truth", 0.02, (Provision(name, "data"),))
        for name in INPUTS
    ]
    found = find_substitute(paper, [s for each in source for s in each.sources], "battery_current")
    program = generate([(found.derivation, "/battery_current/data")], paper.constants)
    assert program.inputs == tuple(f"/{name}/data" for name in INPUTS)
    v, a, w, e, u = x = (-0.5, 0.25, -1.5, 3.0, 12.1)
    result = 48.67 - 0.03 * abs(v) - 1.17 * abs(a) + 2.07 * abs(w) - 0.03 * abs(e) - 3.72 * u
    assert compile_program(program.code, 5, 1).step(x, 0.0) == pytest.approx((result,))
    assert list(PUBLISHED.values()) == [48.67, -0.03, -1.17, 2.07, -0.03, -3.72]


def test_f1_follows_every_drive_and_the_published_one_belongs_to_another_rover(
    seen: List[Dataset],
) -> None:
    own, published = fit_f1(seen), f1_with("published", PUBLISHED, seen)
    assert own.error < 0.07 * own.span
    assert 0.2 * published.span < published.error < 0.4 * published.span


def test_the_voltage_makes_f1_as_good_on_a_flat_battery_as_on_a_full_one(
    seen: List[Dataset],
) -> None:
    own, without = fit_f1(seen), fit_without_voltage(seen)
    assert own.error < without.error
    assert without.coefficients["voltage"] == 0.0 > own.coefficients["voltage"]
    unseen = [unseen_data(0.95), unseen_data(0.3)]
    errors = [f1_with("f1", own.coefficients, [drive]).error for drive in unseen]
    assert max(errors) < 1.1 * min(errors)
    errors = [f1_with("f1", without.coefficients, [drive]).error for drive in unseen]
    assert max(errors) > 1.1 * min(errors)


def test_an_f1_from_one_state_of_charge_fails_at_another(seen: List[Dataset]) -> None:
    alone = fit_f1(seen[:1])
    assert alone.error < fit_f1(seen).error
    flat = [unseen_data(0.3)]
    assert f1_with("f1", alone.coefficients, flat).error > 3.0


def test_the_drive_moves_the_current_clearly() -> None:
    current = simulate(Drive(), 30.0, 0).truth["battery_current"]
    assert np.ptp(current) > 5.0
    assert np.std(current) > 1.5


def test_the_commands_print_tables_and_end_as_they_should(
    capsys: "pytest.CaptureFixture[str]", tmp_path: Path
) -> None:
    assert fit_main([]) == 0
    assert "f1 as published" in capsys.readouterr().out
    assert accuracy_main([]) == 0
    assert "power: battery_current" in capsys.readouterr().out
    wrong = tmp_path / "rover.yaml"
    text = Path(ONTOLOGY_FILE).read_text(encoding="utf-8")
    wrong.write_text(text.replace("quality: 0.92", "quality: 0.5"), encoding="utf-8")
    assert accuracy_main(["--ontology", str(wrong)]) == 1
    assert "its file says 0.5, measured is 0.92" in capsys.readouterr().out
    assert accuracy_main(["--som", "/nowhere.yaml"]) == 2
    assert fit_main(["/nowhere.bag"]) == 2
    assert "/nowhere.bag" in capsys.readouterr().err
