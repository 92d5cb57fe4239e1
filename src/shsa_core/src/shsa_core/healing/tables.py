"""The tables that the reconfigurator shows, as changes."""
from typing import Callable, Dict, Generic, List, Optional, Tuple, TypeVar

from shsa_core.healing.events import ServiceState, ShowSom, ShowSubstitutions
from shsa_core.model.substitution import Substitution

Row = TypeVar("Row")
Shown = TypeVar("Shown")


class _Table(Generic[Row, Shown]):
    """Rows by key, and which of them differ from what was shown."""

    show: Callable[[Tuple[Row, ...], Tuple[str, ...]], Shown]

    def __init__(self) -> None:
        self._shown: Dict[str, Row] = {}
        self._new: Dict[str, Optional[Row]] = {}

    def set(self, key: str, row: Optional[Row]) -> None:
        """The row of a key; None: it has none."""
        self._new[key] = row

    def change(self) -> Optional[Shown]:
        """What is to be shown now; None: nothing has changed."""
        changed: List[Row] = []
        removed: List[str] = []
        for key, row in self._new.items():
            if row is None:
                if key in self._shown:
                    del self._shown[key]
                    removed.append(key)
            elif self._shown.get(key) != row:
                self._shown[key] = row
                changed.append(row)
        self._new.clear()
        return self.show(tuple(changed), tuple(removed)) if changed or removed else None

    def rows(self) -> Tuple[Row, ...]:
        """All rows, as they were shown."""
        return tuple(self._shown.values())


class SubstitutionTable(_Table[Substitution, ShowSubstitutions]):
    """The table of substitutions; rows without a node go by their service."""

    show = ShowSubstitutions


class SomTable(_Table[ServiceState, ShowSom]):
    """The running SOM."""

    show = ShowSom
