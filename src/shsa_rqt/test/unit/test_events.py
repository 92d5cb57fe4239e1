"""The document that follows from the live view's events."""
import json
from typing import Any

from shsa_rqt.events import Events

WHOLE = {"now": 1.0, "services": {"a": {"state": "well"}, "b": {}}, "incidents": [{"key": "1"}]}


def event(kind: str, **document: Any) -> bytes:
    return f"id: 1\nevent: {kind}\ndata: {json.dumps(document)}\n\n".encode()


def test_changes_are_put_into_the_document() -> None:
    events = Events()
    assert events.feed(event("state", **WHOLE))
    assert events.document == WHOLE
    changes = {"services": {"a": {"state": "failed"}, "b": None}, "now": 2.0}
    assert events.feed(event("change", **changes, incidents=[{"key": "2"}, {"key": "1", "id": 7}]))
    assert events.document["services"] == {"a": {"state": "failed"}}
    assert events.document["incidents"] == [{"key": "2"}, {"key": "1", "id": 7}]
    assert events.document["now"] == 2.0


def test_an_event_counts_once_it_is_whole() -> None:
    events, text = Events(), event("state", **WHOLE, text="ä: b") + b": alive\n\n"
    heard = [events.feed(text[at : at + 1]) for at in range(len(text))]
    assert heard.count(True) == 1
    assert events.document["text"] == "ä: b"
