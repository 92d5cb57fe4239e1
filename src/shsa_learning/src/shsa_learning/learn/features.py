"""Columns that fits look at, made by the very code that a substitute runs"""
from typing import Dict, List, Optional, Sequence

import numpy as np

from shsa_core.language.expression import parse_law
from shsa_core.language.functions import STATEFUL
from shsa_core.model.ontology import TransferFunction
from shsa_learning.learn.evaluation import evaluate, evaluate_all
from shsa_learning.learn.table import Table

AT_ONCE = 50
"""Terms that one program computes."""


class Features:
    """Terms over the inputs of a table, at the rows that fits look at.

    A substitute has no value while one of its inputs has none, and what remembers does not hear
    that sample. So rows in which an input of the table has no value are none here.
    """

    def __init__(self, table: Table, rows: Optional[np.ndarray] = None) -> None:
        self._table = table
        self.rows = table.rows() if rows is None else rows
        self.time, self.target = table.time[self.rows], table.target[self.rows]
        heard = np.ones(len(table.time), dtype=bool)
        for column in table.inputs.values():
            heard &= np.isfinite(column)
        self._heard = np.flatnonzero(heard)
        self._made: Dict[str, np.ndarray] = {}

    @property
    def names(self) -> Sequence[str]:
        """The inputs."""
        return self._table.names

    def matrix(self, terms: Sequence[str]) -> np.ndarray:
        """Return a column for each term (rows, terms); NaN where it has no value."""
        self._make([term for term in dict.fromkeys(terms) if term not in self._made])
        return np.array([self._made[term] for term in terms]).reshape(len(terms), -1).T

    def _make(self, terms: Sequence[str]) -> None:
        at_once: List[TransferFunction] = []
        for number, term in enumerate(terms):
            function = function_of(self._table.name, term, f"term_{number}")
            if term in self._table.inputs:
                self._made[term] = self._table.inputs[term][self.rows]
            elif any(name + "(" in term for name in STATEFUL):
                self._made[term] = self._run(function, self._heard)[
                    np.searchsorted(self._heard, self.rows)
                ]
            else:
                at_once.append(function)
        for begin in range(0, len(at_once), AT_ONCE):
            self._make_at_once(at_once[begin : begin + AT_ONCE])

    def _make_at_once(self, functions: Sequence[TransferFunction]) -> None:
        """Run terms that remember nothing in one program, where all of them have a value."""
        columns = evaluate_all(functions, {}, self._table.at(self.rows))
        if not np.isfinite(columns).all():
            columns = np.array([self._run(each, self.rows) for each in functions])
        self._made.update(zip((each.text for each in functions), columns))

    def _run(self, function: TransferFunction, rows: np.ndarray) -> np.ndarray:
        return evaluate(function, {}, self._table.of(function.inputs).at(rows))


def function_of(output: str, text: str, name: str = "term") -> TransferFunction:
    """Return an expression over properties as a relation. Raises ExpressionError."""
    law = parse_law(text)
    return TransferFunction(name, output, law.names, law, 1.0, None, text)
