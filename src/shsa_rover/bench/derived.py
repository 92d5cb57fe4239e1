"""Derivations on a recorded drive, each relation evaluated once for the same inputs."""
from typing import Dict, Mapping

import numpy as np

from shsa_core.model.ontology import Ontology
from shsa_core.search.derivation import Derivation
from shsa_learning.learn.evaluation import evaluate
from shsa_learning.learn.table import inputs_alone


class Columns:
    """The columns of derivations, by those of their sources; `measured` is by topic and field."""

    def __init__(
        self, ontology: Ontology, time: np.ndarray, measured: Mapping[str, np.ndarray]
    ) -> None:
        self._ontology, self._time, self._measured = ontology, time, measured
        self._known: Dict[Derivation, np.ndarray] = {}

    def of(self, derivation: Derivation) -> np.ndarray:
        """Return its value at each moment; NaN where it has no output."""
        if derivation.source is not None:
            return self._measured[derivation.source.path]
        if derivation not in self._known:
            assert derivation.function is not None
            function, constants = derivation.function, self._ontology.constants
            inputs = {name: self.of(x) for name, x in zip(function.inputs, derivation.inputs)}
            self._known[derivation] = evaluate(
                function, constants, inputs_alone(self._time, inputs)
            )
        return self._known[derivation]
