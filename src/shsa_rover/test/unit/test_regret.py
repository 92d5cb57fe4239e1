"""The choice for every property, and what had been best, as the benchmark `truth` compares them."""
import sys
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[3]
sys.path[:0] = [str(SOURCE / package / "bench") for package in ("shsa_rover", "shsa_core")]

from healed import drive  # noqa: E402
from regret import regrets  # noqa: E402

from shsa_core.files.ontology_file import read_ontology  # noqa: E402
from shsa_core.files.som_file import read_som  # noqa: E402
from shsa_rover.worlds import WORLDS  # noqa: E402

MODELS = SOURCE / "shsa_rover" / "ontology"


def test_the_power_of_the_wheels_on_slopes_is_derived_about_as_well_as_can_be() -> None:
    models = read_ontology(str(MODELS / "rover.yaml")), read_som(str(MODELS / "rover_som.yaml"))
    data = drive(WORLDS["slopes"], 31000, 60.0)
    found = {each.lost: each for each in regrets("slopes", data, *models, 60.0)}
    assert all(each.ratio >= 1.0 for each in found.values())
    assert found["drive_power"].ratio < 1.2
