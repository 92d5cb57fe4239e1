"""The command `relation_accuracy`."""
import argparse
import sys
from pathlib import Path
from typing import List, Mapping, Optional, Sequence

from rospkg import RosPack
from tabulate import tabulate

from shsa_core.errors import ShsaError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_rover.accuracy import (
    Accuracy,
    errors,
    relations,
    services,
    substitutes,
    usual_ranges,
)
from shsa_rover.dataset import Dataset, random_drive, simulate

TEST_SEED = 2
DRIVE_SEED = 7
TEST_DURATION = 360.0  # s
ERROR_CHARGES = (0.95, 0.75, 0.55, 0.35)  # at which relations are measured: from full to flat


def test_data(charge: float = 0.8) -> Dataset:
    """Another drive, with another seed, that nothing was fitted to; `charge` at its beginning."""
    return simulate(random_drive(DRIVE_SEED), TEST_DURATION, TEST_SEED, charge)


def error_data() -> List[Dataset]:
    """Drives on level ground from full to flat, by which the errors of relations are stated."""
    drives = enumerate(ERROR_CHARGES, 101)
    return [simulate(random_drive(seed), TEST_DURATION, seed, charge) for seed, charge in drives]


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
        drives = error_data()
        stated, usual = errors(ontology, som, drives), usual_ranges(ontology, drives)
    except ShsaError as error:
        print(error, file=sys.stderr)
        return 2
    units = {name: prop.unit for name, prop in ontology.properties.items()}
    for title, part in zip(("service", "relation"), parts):
        print(_accuracy_table(title, part, units))
    print(_accuracy_table("lost: substitute", healed, units))
    rows = [
        (
            f"{relation}: {output}",
            *(f"{x:.3g}" for x in (e.rms, e.bias, e.p95 or 0.0, e.baseline or 0.0)),
        )
        for (relation, output), e in stated.items()
    ]
    print(_table(rows, "relation, with usual inputs", "rms", "bias", "p95", "baseline"))
    rows = [(name, *(f"{x:.3g}" for x in limits)) for name, limits in usual.items()]
    print(_table(rows, "property, 5 to 95 % of its values", "lowest", "highest"))
    wrong = [item for part in parts for item in part if item.stated != item.quality]
    for item in wrong:
        print(f"{item.name}: its file says {item.stated:g}, measured is {item.quality:g}")
    return 1 if wrong else 0


def _accuracy_table(title: str, items: List[Accuracy], units: Mapping[str, str]) -> str:
    rows = []
    for item in items:
        share = f"{100.0 * item.error / item.span:.1f} %"
        error = f"{item.error:.2g} {units[item.output]}".strip()
        rows.append((item.name, error, share, f"{item.quality:.2f}", f"{item.stated:.2f}"))
    return _table(rows, title, "RMS error", "of span", "measured", "stated")


def _table(rows: Sequence[Sequence[str]], *columns: str) -> str:
    """Return the rows as they stand in the documentation."""
    return "\n" + tabulate(rows, columns, tablefmt="github", disable_numparse=True)
