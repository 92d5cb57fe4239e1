"""Every property lost on unseen drives: what is chosen for it, and what had been best."""
from dataclasses import dataclass
from typing import Iterator, List, Optional, Tuple

import numpy as np

from derived import Columns
from shsa_core.codegen.choice import compare
from shsa_core.codegen.prediction import predictor
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.search.derivation import Derivation, SourceTable
from shsa_rover.dataset import PERIOD_S, Dataset

SETTLED_S = 60.0
THERE = 0.5
"""Of the moments at which a derivation must have a value to be the best."""


@dataclass(frozen=True)
class Regret:
    """The rms errors of a property in one drive, in its unit: of what was chosen, and the best."""

    world: str
    lost: str
    chosen_by: str
    chosen: float
    best_by: str
    best: float

    @property
    def ratio(self) -> float:
        """By how much more the choice erred."""
        return self.chosen / self.best if self.best > 0.0 else 1.0


def regrets(
    world: str, data: Dataset, ontology: Ontology, som: Som, seconds: float
) -> Iterator[Regret]:
    """Yield every property with a known truth that can be derived without the service it has."""
    rows = min(len(data.time), round(seconds / PERIOD_S))
    settled = min(round(SETTLED_S / PERIOD_S), rows // 3)
    measured = {path: column[:rows] for path, column in data.measured.items()}
    columns = Columns(ontology, data.time[:rows], measured)
    network, errors_of = ontology.network, predictor(ontology, som.sources)
    assert errors_of is not None
    for name in sorted(set(ontology.properties) & set(data.truth)):
        table = SourceTable(network, som.sources).excluding(_lost(som, name))
        usable = network.executable
        compared = compare(network, table, usable, network.number(name), errors_of).rated
        truth = data.truth[name][settled:rows]
        found: List[Tuple[float, str]] = []
        for rated in compared:
            error = _rms(columns.of(rated.derivation)[settled:] - truth)
            found.append((error if error is not None else np.inf, _words(rated.derivation)))
        if found and np.isfinite(found[0][0]):
            best = min(found)
            yield Regret(world, name, found[0][1], found[0][0], best[1], best[0])


def _lost(som: Som, name: str) -> Tuple[str, ...]:
    """Return the service of a property that healing would replace, and its node."""
    having = [service for service in som if name in service.properties]
    having.sort(key=lambda service: not service.needed)
    return (having[0].name, having[0].node) if having else ()


def _rms(errors: np.ndarray) -> Optional[float]:
    there = errors[np.isfinite(errors)]
    return float(np.sqrt(np.mean(there**2))) if len(there) >= THERE * len(errors) else None


def _words(derivation: Derivation) -> str:
    inputs = ", ".join(source.path for source in derivation.sources())
    return f"{' < '.join(derivation.relations()) or 'passed on'} of {inputs}"
