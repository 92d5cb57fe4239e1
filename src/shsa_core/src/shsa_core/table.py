"""A table that is shown as changes: rows by key, and what is new of them."""
from typing import Callable, Dict, Generic, List, Optional, Tuple, TypeVar

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


class Keyed:
    """A row whose key is made of it, by the form `KEY`."""

    KEY = ""

    @property
    def key(self) -> str:
        """Return the key, which tells it from all others."""
        return self.KEY.format(self)
