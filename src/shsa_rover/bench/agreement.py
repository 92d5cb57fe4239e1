"""Every derivation on unseen drives: the error that is predicted of it, and the real one."""
from dataclasses import dataclass
from itertools import islice
from typing import Dict, Iterator, List, Optional

import numpy as np
from scipy.stats import spearmanr

from derived import Columns
from shsa_core.codegen.prediction import predictor
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.search.derivation import SourceTable
from shsa_core.search.ranking import Ranking
from shsa_rover.dataset import PERIOD_S, Dataset

FOUND, EVALUATED = 5000, 300
"""So many derivations of a property are looked for, and of these so many evaluated, evenly."""
SETTLED_S = 60.0
COLUMNS = ("world", "property", "derivations", "rank correlation", "within p95, %")


@dataclass(frozen=True)
class Ranked:
    """A derivation in one drive; errors in the unit of its property.

    `number`: which it is among those of its property. `predicted`: rms, not a number: not known.
    `covered`: the share of moments with an error within the p95 that is stated, not a number: none
    is.
    """

    world: str
    property: str
    number: int
    by: str
    quality: float
    predicted: float
    real: float
    covered: float


def ranked(
    world: str, data: Dataset, ontology: Ontology, som: Som, seconds: float
) -> Iterator[Ranked]:
    """Yield every derivation of every property with a known truth, after filters settled."""
    rows = min(len(data.time), round(seconds / PERIOD_S))
    settled = min(round(SETTLED_S / PERIOD_S), rows // 3)
    measured = {path: column[:rows] for path, column in data.measured.items()}
    columns = Columns(ontology, data.time[:rows], measured)
    network, table = ontology.network, SourceTable(ontology.network, som.sources)
    errors_of = predictor(ontology, som.sources)
    for name in sorted(set(ontology.properties) & set(data.truth)):
        truth = data.truth[name][settled:rows]
        every = list(islice(Ranking(network, table).joint([network.number(name)]), FOUND))
        every = every[:: -(-len(every) // EVALUATED)]
        derivations = [each.derivation.inputs[0] for each in every]
        predicted: List[Optional[Error]] = [None] * len(every)
        if errors_of is not None:
            predicted = errors_of.of(derivations)
        for number, (rated, derivation, stated) in enumerate(zip(every, derivations, predicted)):
            errors = columns.of(derivation)[settled:] - truth
            errors = errors[np.isfinite(errors)]
            if not len(errors):
                continue
            within = np.nan if stated is None or stated.p95 is None else stated.p95
            yield Ranked(
                world,
                name,
                number,
                " < ".join(derivation.relations()) or "passed on",
                rated.quality,
                stated.rms if stated else np.nan,
                float(np.sqrt(np.mean(errors**2))),
                float(np.mean(np.abs(errors) <= within)) if np.isfinite(within) else np.nan,
            )


def correlation(group: List[Ranked]) -> float:
    """Of the ranks of predicted and real errors, over all drives; not a number for fewer than 3."""
    real: Dict[int, List[float]] = {}
    predicted: Dict[int, float] = {}
    for each in group:
        if np.isfinite(each.predicted):
            real.setdefault(each.number, []).append(each.real**2)
            predicted[each.number] = each.predicted
    if len(predicted) < 3:
        return float("nan")
    means = [np.mean(real[number]) for number in predicted]
    return float(spearmanr(list(predicted.values()), means)[0])


def covered(group: List[Ranked]) -> float:
    """Return the share of all moments within what was stated; not a number where nothing was."""
    shares = [each.covered for each in group if np.isfinite(each.covered)]
    return float(np.mean(shares)) if shares else float("nan")
