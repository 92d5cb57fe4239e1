"""The rover's models: valid, measured, sufficient, never tripped by a healthy rover."""
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, List, Set

import numpy as np
import pytest

from shsa_core.codegen.generator import generate
from shsa_core.codegen.prediction import predictor
from shsa_core.codegen.program import compile_program
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.kinds import Contain, Standby
from shsa_core.model.service import Provision, Service
from shsa_learning.check import check_files
from shsa_learning.learn.evaluation import evaluate_derivation
from shsa_learning.substitutes import substitutes as substitutes_by_error
from shsa_learning.substitutes import Substitute, find_substitute
from shsa_rover import measuring
from shsa_rover.accuracy import errors, relations, services, substitutes, usual_ranges
from shsa_rover.dataset import Dataset, random_drive, simulate
from shsa_rover.drive import Drive
from shsa_rover.measuring import accuracy_main, error_data, test_data as unseen_data
from shsa_rover.worlds import WORLDS, named_world
from shsa_testing.thorough import some

FOLDER = Path(__file__).resolve().parents[2] / "ontology"
ONTOLOGY_FILE, SOM_FILE = str(FOLDER / "rover.yaml"), str(FOLDER / "rover_som.yaml")
PAPER_FILES = str(FOLDER / "paper.yaml"), str(FOLDER / "paper_som.yaml")
ONTOLOGY, SOM = read_ontology(ONTOLOGY_FILE), read_som(SOM_FILE)
INPUTS = (
    "linear_velocity",
    "linear_acceleration",
    "angular_velocity",
    "angular_acceleration",
    "battery_voltage",
)
LEARNED, PRODUCTS = "learned_battery_current", "learned_battery_current_products"
NEEDED = {"/battery_current", "/battery_voltage", "/odom", "/drivetrain/accel", "/imu/data"}


@pytest.fixture(name="unseen", scope="module")
def _unseen() -> Dataset:
    return unseen_data()


@pytest.fixture(name="drives", scope="module")
def _drives() -> List[Dataset]:
    return error_data()


def test_the_files_are_valid() -> None:
    assert check_files(ONTOLOGY_FILE, SOM_FILE) == []
    assert check_files(*PAPER_FILES) == []


def test_on_three_computers_the_services_are_the_same() -> None:
    file = str(FOLDER / "rover_hosts_som.yaml")
    three = read_som(file)
    assert set(three.hosts) == {service.host for service in three}
    assert set(three.hosts) == {"raspberry_pi", "mainboard", "notebook"}
    assert [replace(service, host="") for service in three] == list(SOM)
    # The estimator's voltage is on the mainboard, as the voltmeter is.
    (finding,) = check_files(ONTOLOGY_FILE, file)
    assert finding.level == "warning" and "does without mainboard" in finding.todo


def test_behind_gates_the_services_are_the_same() -> None:
    file = str(FOLDER / "rover_gated_som.yaml")
    assert check_files(ONTOLOGY_FILE, file) == []
    gated = read_som(file)
    plain = [
        replace(
            service,
            topic=service.beyond_gate,
            beyond_gate="",
            standby=Standby.WARM,
            contain=Contain.NODE,
        )
        if service.gated
        else service
        for service in gated
    ]
    assert plain == list(SOM)
    assert {service.name for service in gated if service.gated} == {
        service.name for service in SOM.needed()
    }


def test_the_needed_topics_are_those_of_the_rover() -> None:
    assert {service.topic for service in SOM.needed()} == NEEDED


def test_every_stated_quality_is_the_measured_one(unseen: Dataset) -> None:
    for item in services(SOM, unseen) + relations(ONTOLOGY, unseen):
        assert item.stated == pytest.approx(item.quality, abs=0.0101), item.name


def test_every_stated_error_is_the_measured_one(drives: List[Dataset]) -> None:
    measured = errors(ONTOLOGY, SOM, drives)
    for function in ONTOLOGY.functions:
        name, stated = (function.relation, function.output), function.error
        if stated is None or name[0] in (LEARNED, PRODUCTS, "level_ground"):
            continue  # exact, or of other drives
        found = measured[name]
        assert stated.p95 is not None and found.p95 is not None
        assert stated.rms == pytest.approx(found.rms, rel=0.03), name
        assert stated.p95 == pytest.approx(found.p95, rel=0.03), name
        assert stated.bias == pytest.approx(found.bias, abs=0.1 * found.rms), name
        assert stated.baseline in (None, pytest.approx(found.baseline, rel=0.03)), name


def test_the_usual_values_are_the_measured_ones(drives: List[Dataset]) -> None:
    for name, limits in usual_ranges(ONTOLOGY, drives).items():
        stated = ONTOLOGY.properties[name].usual
        assert stated is not None, name
        width = limits[1] - limits[0]
        assert stated == (
            pytest.approx(limits[0], abs=0.02 * width),
            pytest.approx(limits[1], abs=0.02 * width),
        ), name


def test_what_is_predicted_of_a_chain_is_of_the_size_of_its_error(unseen: Dataset) -> None:
    """By the commands, whose error goes on with the acceleration that is usual."""
    sources = [each for each in SOM.sources if each.service.name != "odometry"]
    errors_of = predictor(ONTOLOGY, SOM.sources)
    assert errors_of is not None
    derivation = find_substitute(ONTOLOGY, sources, "drive_power").derivation
    assert "steering" in derivation.relations()
    (predicted,) = errors_of.of([derivation])
    values = evaluate_derivation(derivation, ONTOLOGY.constants, unseen.time, unseen.measured)
    off = (values - unseen.truth["drive_power"])[unseen.time >= 60.0]
    real = float(np.sqrt(np.nanmean(off**2)))
    assert predicted is not None and 0.5 * real < predicted.rms < 2.0 * real


def test_every_needed_service_has_a_substitute_that_follows_the_truth(unseen: Dataset) -> None:
    healed = substitutes(ONTOLOGY, SOM, unseen)
    assert {item.name.split(":")[0] for item in healed} == {
        source.path for service in SOM.needed() for source in service.sources
    }
    for item in healed:
        assert item.error < 0.1 * item.span, item.name


def chosen(prop: str, *lost: str) -> Substitute:
    """Return healing's choice: the smallest expected error."""
    left = [source for source in SOM.sources if not set(source.names) & set(lost)]
    return next(substitutes_by_error(ONTOLOGY, left, prop, predictor(ONTOLOGY, SOM.sources)))[0]


def test_the_amperemeter_is_replaced_by_what_was_learned_and_the_power_chain_is_behind_it() -> None:
    felt = {*INPUTS, "specific_force"} - {"linear_acceleration"}
    for found in (
        find_substitute(ONTOLOGY, SOM.sources, "battery_current", ["amperemeter"]),
        chosen("battery_current", "amperemeter"),
    ):
        assert found.derivation.relations() == (LEARNED,)
        assert {source.property for source in found.derivation.sources()} == felt
    blind = chosen("battery_current", "amperemeter", "/imu").derivation
    assert blind.relations() == (PRODUCTS,)
    assert {source.property for source in blind.sources()} == set(INPUTS)
    without = type(ONTOLOGY)(
        ONTOLOGY.properties,
        ONTOLOGY.constants,
        [f for f in ONTOLOGY.functions if f.relation not in (LEARNED, PRODUCTS)],
    )
    chain = find_substitute(without, SOM.sources, "battery_current", ["amperemeter"])
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
        ("linear_acceleration", {"level_ground"}),
        ("angular_acceleration", {"turning"}),
    ],
)
def test_a_dead_drivetrain_can_be_replaced(prop: str, relations_used: Set[str]) -> None:
    found = find_substitute(ONTOLOGY, SOM.sources, prop, ["/drivetrain"])
    assert set(found.derivation.relations()) == relations_used
    assert all(source.node != "/drivetrain" for source in found.derivation.sources())


@pytest.mark.parametrize("seed", some([11, 12, 13]))
@pytest.mark.parametrize("soc", [0.2, 0.95])
@pytest.mark.parametrize("world", ["as_fitted", "drawn"])
def test_a_healthy_rover_never_leaves_a_range(world: str, seed: int, soc: float) -> None:
    data = simulate(random_drive(seed), 60.0, seed, soc, named_world(world, seed))
    for source in SOM.sources:
        assert source.provision.range is not None
        low, high = source.provision.range
        column = data.measured[source.path]
        margin = 0.02 * (high - low)
        if source.property != "state_of_charge":
            assert low + margin < column.min() and column.max() < high - margin, source.path
        assert low <= column.min() and column.max() <= high, source.path


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


def test_in_the_world_of_the_paper_f1_holds_and_its_witness_does_not_protest() -> None:
    paper, som = read_ontology(PAPER_FILES[0]), read_som(PAPER_FILES[1])
    for seed in range(3):
        data = simulate(random_drive(seed), 90.0, seed, world=named_world("paper"))
        healed = find_substitute(paper, som.sources, "battery_current", ["/amperemeter"])
        assert healed.derivation.relations() == ("f1",)
        columns = data.time, data.measured
        current = evaluate_derivation(healed.derivation, paper.constants, *columns)
        off = current - data.measured["/battery_current/data"]
        assert np.std(off) < 0.15 < 0.05 * np.ptp(data.truth["battery_current"])
        assert np.max(np.abs(off)) < 0.7  # the witness of paper_som.yaml allows 1 A
        for source in som.sources:
            low, high = source.provision.range or (0.0, 0.0)
            column = data.measured[source.path]
            assert low < column.min() and column.max() < high, source.path


@lru_cache(maxsize=None)
def unseen_at(charge: float) -> Dataset:
    return unseen_data(charge)


@pytest.mark.parametrize("charge", some([0.25, 0.95, 0.8, 0.5]))
@pytest.mark.parametrize("name", [LEARNED, PRODUCTS])
def test_the_learned_current_is_good_at_every_charge_and_says_how_good(
    name: str, charge: float
) -> None:
    (learned,) = [f for f in ONTOLOGY.functions if f.relation == name]
    measured = relations(ONTOLOGY, unseen_at(charge))
    (item,) = [each for each in measured if each.name.startswith(f"{name}:")]
    assert item.error < 0.04 * item.span
    assert learned.error is not None and learned.error.rms is not None
    assert item.error < 1.25 * learned.error.rms
    drive = "drive_1.bag" if name == LEARNED else "drive_full.bag"
    assert drive in str(learned.error.source)


def test_the_accelerometer_tells_the_acceleration_on_level_ground_alone_and_says_so() -> None:
    both = [f for f in ONTOLOGY.functions if f.relation == "level_ground"]
    data = simulate(random_drive(31, 200), 300.0, 31, 0.8, WORLDS["slopes"])
    off = data.truth["specific_force"] - data.truth["linear_acceleration"]
    for function in both:
        assert function.error is not None and function.error.p95 is not None
        assert np.sqrt(np.mean(off**2)) == pytest.approx(function.error.rms, rel=0.15)
        assert np.percentile(np.abs(off), 95) == pytest.approx(function.error.p95, rel=0.15)
    assert {function.output for function in both} == {"specific_force", "linear_acceleration"}


def test_the_published_f1_belongs_to_another_rover(unseen: Dataset) -> None:
    paper = read_ontology(str(FOLDER / "paper.yaml"))
    (item,) = relations(paper, unseen)
    assert 0.15 * item.span < item.error < 0.4 * item.span


def test_the_drive_moves_the_current_clearly() -> None:
    current = simulate(Drive(), 30.0, 0).truth["battery_current"]
    assert np.ptp(current) > 5.0
    assert np.std(current) > 1.5


def test_the_command_prints_tables_and_ends_as_it_should(
    capsys: "pytest.CaptureFixture[str]",
    tmp_path: Path,
    monkeypatch: Any,
    unseen: Dataset,
    drives: List[Dataset],
) -> None:
    monkeypatch.setattr(measuring, "test_data", lambda: unseen)
    monkeypatch.setattr(measuring, "error_data", lambda: drives[:1])
    assert accuracy_main([]) == 0
    assert "power: battery_current" in capsys.readouterr().out
    wrong = tmp_path / "rover.yaml"
    text = Path(ONTOLOGY_FILE).read_text(encoding="utf-8")
    wrong.write_text(text.replace("quality: 0.93", "quality: 0.5"), encoding="utf-8")
    assert accuracy_main(["--ontology", str(wrong)]) == 1
    assert "its file says 0.5, measured is 0.93" in capsys.readouterr().out
    assert accuracy_main(["--som", "/nowhere.yaml"]) == 2
    assert "/nowhere.yaml" in capsys.readouterr().err
