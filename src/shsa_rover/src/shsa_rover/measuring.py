"""The commands `fit_current` and `relation_accuracy`."""
import argparse
import sys
from pathlib import Path
from typing import List, Mapping, Optional, Sequence

from rospkg import RosPack
from tabulate import tabulate

from shsa_core.errors import ShsaError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_rover.accuracy import Accuracy, relations, services, substitutes
from shsa_rover.dataset import Dataset, random_drive, simulate
from shsa_rover.drive import Drive
from shsa_rover.fitting import Fit, f1_variants, f1_with, fit_others

FIT_SEED, TEST_SEED = 1, 2
DRIVE_SEED = 7
FIT_DURATION, TEST_DURATION = 120.0, 360.0  # s
FIT_CHARGES = (0.8, 0.95, 0.6, 0.4, 0.2)
TEST_CHARGES = (0.95, 0.8, 0.7, 0.5, 0.3)


def fit_data() -> List[Dataset]:
    """The drive that the relations are fitted to, four times round at each state of charge."""
    return [simulate(Drive(), FIT_DURATION, FIT_SEED, charge) for charge in FIT_CHARGES]


def test_data(charge: float = 0.8) -> Dataset:
    """Another drive, with another seed, that nothing was fitted to; `charge` at its beginning."""
    return simulate(random_drive(DRIVE_SEED), TEST_DURATION, TEST_SEED, charge)


def fit_main(arguments: Optional[Sequence[str]] = None) -> int:
    """Prints the fitted coefficients.

    Returns the exit status (0 done, 2 the bag cannot be used).
    """
    parser = argparse.ArgumentParser(
        prog="fit_current",
        description="Fits the rover's relations to recorded drives, and compares the paper's f1 "
        "with ours.",
    )
    parser.add_argument(
        "bags",
        nargs="*",
        metavar="BAG",
        help="rosbags of the rover's topics, at states of charge from full to flat: "
        "f1 is fitted to all of them, "
        "what else there is to the first; without any, drives are simulated",
    )
    options = parser.parse_args(arguments)
    try:
        if options.bags:
            # rosbag takes long to import, and only here is it needed.
            from shsa_rover.drive_bag import read_bag

            drives = [read_bag(bag) for bag in options.bags]
        else:
            drives = fit_data()
    except ShsaError as error:
        print(error, file=sys.stderr)
        return 2
    variants = f1_variants(drives)
    print(_fit_table(variants + fit_others(drives[0])))
    if not options.bags:
        print(_charge_table(variants))
    return 0


def accuracy_main(arguments: Optional[Sequence[str]] = None) -> int:
    """Prints the accuracies.

    Returns 1 if a stated quality is not the measured one, 2 for unusable files.
    """
    folder = Path(RosPack().get_path("shsa_rover")) / "ontology"
    parser = argparse.ArgumentParser(
        prog="relation_accuracy",
        description="Measures services, relations and substitutes on a simulated drive that "
        "nothing was fitted to.",
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


def _charge_table(variants: List[Fit]) -> str:
    """The errors of f1 on drives that nothing was fitted to, each from another state of charge."""
    drives = [[test_data(charge)] for charge in TEST_CHARGES]
    rows = [
        [fit.relation]
        + [f"{f1_with(fit.relation, fit.coefficients, drive).error:.2f}" for drive in drives]
        for fit in variants
    ]
    return _table(rows, "A on other drives, from a charge of", *map(str, TEST_CHARGES))


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
