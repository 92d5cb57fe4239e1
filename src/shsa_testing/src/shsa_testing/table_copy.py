"""A table of healing, as a test sees it."""
from typing import Any, Dict, Type

import genpy

from shsa_core.ros.messages.tables import Key, TableSubscriber


class TableCopy:
    """A copy of a table that is kept up: `rows` by key."""

    def __init__(
        self, topic: str, message_class: Type[genpy.Message], rows_field: str, key: Key
    ) -> None:
        self.rows: Dict[str, Any] = {}
        self._field, self._key = rows_field, key
        self._subscriber = TableSubscriber(topic, message_class, self._heard)
        self.get_num_connections = self._subscriber.get_num_connections

    def _heard(self, message: Any) -> None:
        rows = {} if message.whole else dict(self.rows)
        for key in message.removed:
            rows.pop(key, None)
        rows.update({self._key(row): row for row in getattr(message, self._field)})
        self.rows = rows  # a new one each time: readers need no lock
