"""The live view's stream of events, kept as the document that it tells of."""
import json
from typing import Any, Dict

Document = Dict[str, Any]


class Events:
    """The document of a stream; empty until its first event has come."""

    def __init__(self) -> None:
        self.document: Document = {}
        self._rest = b""

    def feed(self, data: bytes) -> bool:
        """Take bytes as they come. Return whether the document changed."""
        *events, self._rest = (self._rest + data).split(b"\n\n")
        return any([self._take(event.decode("utf-8")) for event in events])

    def _take(self, event: str) -> bool:
        fields = dict(line.split(": ", 1) for line in event.splitlines() if ": " in line)
        if fields.get("event") == "state":
            self.document = json.loads(fields["data"])
        elif fields.get("event") == "change":
            self._change(json.loads(fields["data"]))
        else:
            return False
        return True

    def _change(self, changes: Document) -> None:
        """Change the document; a service that is null is gone."""
        services = {**self.document["services"], **changes.pop("services", {})}
        new = {each["key"]: each for each in changes.pop("incidents", ())}
        kept = [new.pop(each["key"], each) for each in self.document["incidents"]]
        self.document.update(changes)
        self.document["services"] = {name: row for name, row in services.items() if row is not None}
        self.document["incidents"] = [*new.values(), *kept]
