"""Looks at the node that a substitute stands in for."""
from typing import Any, Dict, FrozenSet, NamedTuple, Optional

from shsa_core.ros.master.node_api import FAILURES, ask, master_api


class _Seen(NamedTuple):
    """Where an original is, and who is at the other end of its connections, by their numbers."""

    uri: str
    ends: Dict[Any, str]


class Originals:
    """Where the originals are; for one thread."""

    def __init__(self) -> None:
        self._seen: Dict[str, _Seen] = {}

    def served_consumers(self, topic: str, original: str) -> Optional[FrozenSet[str]]:
        """The consumers to which the node `original` has published on a topic already.

        None if it does not answer, or not as nodes do. A node that connects to its consumers is
        slow to answer, and messages wait for it: it is asked who they are only where that is not
        known.
        """
        seen = self._seen.pop(original, None)
        try:
            seen = seen or _Seen(master_api().lookupNode(original), {})
            served = _served(topic, seen.uri)
            if not served <= seen.ends.keys():
                seen = _Seen(seen.uri, _ends(topic, seen.uri))
            consumers = frozenset(seen.ends[each] for each in served if each in seen.ends)
        except (*FAILURES, LookupError, TypeError):
            return None
        self._seen[original] = seen  # the master is asked again only once it does not answer there
        return consumers


def _served(topic: str, uri: str) -> FrozenSet[Any]:
    """The numbers of the connections on which messages were sent.

    Raises one of FAILURES, LookupError or TypeError: see above.
    """
    # A row of a publication ends with its connections: id, bytes sent, and what has been sent of
    # messages.
    rows = [row for entry in ask(uri, "getBusStats")[0] if entry[0] == topic for row in entry[-1]]
    return frozenset(row[0] for row in rows if row[2] > 0)


def _ends(topic: str, uri: str) -> Dict[Any, str]:
    """Raises as `_served`."""
    info = ask(uri, "getBusInfo")
    return {row[0]: str(row[1]) for row in info if row[2] == "o" and row[4] == topic}
