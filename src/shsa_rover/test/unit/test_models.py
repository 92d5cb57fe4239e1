"""The rover's ontology and SOM: valid, measured, sufficient, and never tripped by a healthy rover."""
from pathlib import Path
from typing import Set

import numpy as np
import pytest

from shsa_core.analysis.check import check_files
from shsa_core.files.ontology_file import read_ontology
from shsa_core.model.som import read_som
from shsa_core.search.substitutes import find_substitute
from shsa_rover.accuracy import relations, services, substitutes
from shsa_rover.dataset import Dataset, random_drive, simulate
from shsa_rover.drive import Drive
from shsa_rover.fitting import fit_f1, fit_motors, fit_sag, published_f1
from shsa_rover.measuring import accuracy_main, fit_data, fit_main, test_data as unseen_data

FOLDER = Path(__file__).resolve().parents[4] / "ontology"
ONTOLOGY_FILE, SOM_FILE = str(FOLDER / "rover.yaml"), str(FOLDER / "rover_som.yaml")
ONTOLOGY, SOM = read_ontology(ONTOLOGY_FILE), read_som(SOM_FILE)
NEEDED = {"/battery_current", "/battery_voltage", "/odom", "/drivetrain/accel", "/imu/data"}


@pytest.fixture(name="unseen", scope="module")
def _unseen() -> Dataset:
    return unseen_data()


@pytest.fixture(name="seen", scope="module")
def _seen() -> Dataset:
    return fit_data()


def test_the_files_are_valid() -> None:
    assert check_files(ONTOLOGY_FILE, SOM_FILE) == []
    assert check_files(str(FOLDER / "paper.yaml"), None) == []


def test_the_needed_topics_are_those_of_the_rover() -> None:
    assert {service.topic for service in SOM if service.needed} == NEEDED


def test_every_stated_quality_is_the_measured_one(unseen: Dataset) -> None:
    for item in services(SOM, unseen) + relations(ONTOLOGY, unseen):
        assert item.stated == pytest.approx(item.quality, abs=0.0101), item.name


def test_every_needed_service_has_a_substitute_that_follows_the_truth(unseen: Dataset) -> None:
    healed = substitutes(ONTOLOGY, SOM, unseen)
    assert {item.name.split(":")[0] for item in healed} == {s.path for s in SOM if s.needed}
    for item in healed:
        assert item.error < 0.1 * item.span, item.name


def test_the_amperemeter_is_replaced_by_f1_and_the_power_chain_is_behind_it() -> None:
    found = find_substitute(ONTOLOGY, SOM, "battery_current", ["/amperemeter"])
    assert found.derivation.relations() == ("f1",)
    without = type(ONTOLOGY)(
        ONTOLOGY.properties,
        ONTOLOGY.constants,
        [function for function in ONTOLOGY.functions if function.relation != "f1"],
    )
    chain = find_substitute(without, SOM, "battery_current", ["/amperemeter"])
    assert set(chain.derivation.relations()) == {"power", "motors", "traction", "wheels"}


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
    found = find_substitute(ONTOLOGY, SOM, prop, ["/drivetrain"])
    assert set(found.derivation.relations()) == relations_used
    assert all(service.node != "/drivetrain" for service in found.derivation.services())


@pytest.mark.parametrize("seed", [11, 12, 13])
@pytest.mark.parametrize("soc", [0.2, 0.95])
def test_a_healthy_rover_never_leaves_a_range(seed: int, soc: float) -> None:
    data = simulate(random_drive(seed), 60.0, seed, soc)
    for service in SOM:
        assert service.range is not None
        low, high = service.range
        column = data.measured[service.path]
        margin = 0.02 * (high - low)
        if service.property != "state_of_charge":
            assert low + margin < column.min() and column.max() < high - margin, service.path
        assert low <= column.min() and column.max() <= high, service.path


def test_the_fitted_coefficients_are_those_in_the_file(seen: Dataset) -> None:
    """Recomputes the fits: the file holds what `fit_current` prints, to the digits that it gives."""
    motors, sag = fit_motors(seen).coefficients, fit_sag(seen).coefficients
    for name, value in {**motors, **sag}.items():
        assert ONTOLOGY.constants[name].value == pytest.approx(value, rel=0.01), name
    text = next(f.text for f in ONTOLOGY.functions if f.relation == "f1")
    for value in fit_f1(seen).coefficients.values():
        assert f"{abs(value):.3f}"[:4] in text


def test_f1_follows_the_drive_and_the_published_one_belongs_to_another_rover(seen: Dataset) -> None:
    own, published = fit_f1(seen), published_f1(seen)
    assert own.error < 0.1 * own.span
    assert published.error > own.span


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
