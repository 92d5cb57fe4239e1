"""The commands `fit_current` and `relation_accuracy`."""
import argparse
import sys
from pathlib import Path
from typing import List, Mapping, Optional, Sequence

from rospkg import RosPack
from tabulate import tabulate

from shsa_core.errors import ShsaError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.model.som import read_som
from shsa_rover.accuracy import Accuracy, relations, services, substitutes
from shsa_rover.dataset import Dataset, random_drive, simulate
from shsa_rover.drive import Drive
from shsa_rover.fitting import Fit, fit_all

FIT_SEED, TEST_SEED = 1, 2
DRIVE_SEED = 7
FIT_DURATION, TEST_DURATION = 120.0, 360.0  # s


def fit_data() -> Dataset:
    """The scripted drive that the relations are fitted to, four times round."""
    return simulate(Drive(), FIT_DURATION, FIT_SEED)


def test_data() -> Dataset:
    """Another drive, with another seed, that nothing was fitted to."""
    return simulate(random_drive(DRIVE_SEED), TEST_DURATION, TEST_SEED)


def fit_main(arguments: Optional[Sequence[str]] = None) -> int:
    """Prints the fitted coefficients; returns the exit status (0 done, 2 the bag cannot be used)."""
    parser = argparse.ArgumentParser(
        prog="fit_current",
        description="Fits the rover's relations to a recorded drive, and compares the paper's f1 with it.",
    )
    parser.add_argument(
        "bag", nargs="?", help="a rosbag of the rover's topics; without it the drive is simulated"
    )
    options = parser.parse_args(arguments)
    try:
        if options.bag:
            # rosbag takes long to import, and only here is it needed.
            from shsa_rover.drive_bag import read_bag

            data = read_bag(options.bag)
        else:
            data = fit_data()
    except ShsaError as error:
        print(error, file=sys.stderr)
        return 2
    print(_fit_table(fit_all(data)))
    return 0


def accuracy_main(arguments: Optional[Sequence[str]] = None) -> int:
    """Prints the accuracies; returns 1 if a stated quality is not the measured one, 2 for unusable files."""
    folder = Path(RosPack().get_path("shsa_rover")) / "ontology"
    parser = argparse.ArgumentParser(
        prog="relation_accuracy",
        description="Measures services, relations and substitutes on a simulated drive that nothing was fitted to.",
    )
    parser.add_argument("--ontology", default=str(folder / "rover.yaml"), metavar="FILE")
    parser.add_argument("--som", default=str(folder / "rover_som.yaml"), metavar="FILE")
    options = parser.parse_args(arguments)
    try:
        ontology, som = read_ontology(options.ontology), read_som(options.som)
        data = test_data()
        parts = [services(som, data), relations(ontology, data)]
        healed = substitutes(ontology, som, data)
    except ShsaError as error:
        print(error, file=sys.stderr)
        return 2
    units = {name: prop.unit for name, prop in ontology.properties.items()}
    for title, part in zip(("service", "relation"), parts):
        print(_accuracy_table(title, part, units))
    print(_accuracy_table("lost: substitute", healed, units))
    wrong = [item for part in parts for item in part if item.stated != item.quality]
    for item in wrong:
        print(f"{item.name}: its file says {item.stated:g}, measured is {item.quality:g}")
    return 1 if wrong else 0


def _fit_table(fits: List[Fit]) -> str:
    rows = []
    for fit in fits:
        coefficients = ", ".join(f"{name} {value:.4g}" for name, value in fit.coefficients.items())
        share = f"{100.0 * fit.error / fit.span:.1f} %"
        rows.append((fit.relation, coefficients, f"{fit.error:.3g} {fit.unit}", share))
    return _table(rows, "relation", "coefficients", "RMS error", "of span")


def _accuracy_table(title: str, items: List[Accuracy], units: Mapping[str, str]) -> str:
    rows = []
    for item in items:
        share = f"{100.0 * item.error / item.span:.1f} %"
        error = f"{item.error:.2g} {units[item.output]}".strip()
        rows.append((item.name, error, share, f"{item.quality:.2f}", f"{item.stated:.2f}"))
    return _table(rows, title, "RMS error", "of span", "measured", "stated")


def _table(rows: Sequence[Sequence[str]], *columns: str) -> str:
    """The rows as they stand in the documentation."""
    return "\n" + tabulate(rows, columns, tablefmt="github", disable_numparse=True)
