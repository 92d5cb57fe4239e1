"""What the reconfigurator shows and writes down, as changes."""
from typing import Callable, Dict, Generic, List, Optional, Tuple, TypeVar

from shsa_core.healing.events import ServiceState, ShowSom, ShowSubstitutions, WriteDown
from shsa_core.healing.records import Record
from shsa_core.model.substitution import Substitution

Row = TypeVar("Row")
Shown = TypeVar("Shown")


class Table(Generic[Row, Shown]):
    """Rows by key, and which of them differ from what `show` was made of last."""

    def __init__(self, show: Callable[[Tuple[Row, ...], Tuple[str, ...]], Shown]) -> None:
        self.rows: Dict[str, Row] = {}
        self._show = show
        self._before: Dict[str, Optional[Row]] = {}  # of those that were set

    def set(self, key: str, row: Optional[Row]) -> None:
        """Put the row of a key; None: it has none."""
        before = self.rows.get(key)
        if row == before:
            return
        self._before.setdefault(key, before)
        if row is None:
            del self.rows[key]
        else:
            self.rows[key] = row

    def change(self) -> List[Shown]:
        """Return what is to be shown now: one change, or none."""
        set_, self._before = self._before, {}
        keys = [key for key, before in set_.items() if self.rows.get(key) != before]
        changed = tuple(self.rows[key] for key in keys if key in self.rows)
        removed = tuple(key for key in keys if key not in self.rows)
        return [self._show(changed, removed)] if keys else []


def substitutions() -> "Table[Substitution, ShowSubstitutions]":
    """Return the table of substitutions; rows without a node go by their service."""
    return Table(ShowSubstitutions)


def running_som() -> "Table[ServiceState, ShowSom]":
    """Return the running SOM."""
    return Table(ShowSom)


def records() -> "Table[Record, WriteDown]":
    """Return the records for the next reconfigurator."""
    return Table(WriteDown)
