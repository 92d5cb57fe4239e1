"""Names of topics and nodes: relative ones are names in the namespace in which healing runs."""
import os
from typing import Collection, Dict

KEPT = 200


def full_name(name: str, namespace: str) -> str:
    """Return a name from the root of the graph: `odom` in `/robot1` is `/robot1/odom`."""
    if name.startswith("/"):
        return name
    return "/".join(("", *filter(None, namespace.split("/")), name))


def file_name(path: str, namespace: str) -> str:
    """Map `log/a.jsonl` to `log/robot1-a.jsonl` in the namespace `/robot1`.

    roslaunch names its logs so.
    """
    folder, name = os.path.split(path)
    return os.path.join(folder, "-".join((*filter(None, namespace.split("/")), name)))


class RecentNames:
    """Names that were used: those in use, and at least the newest KEPT."""

    def __init__(self) -> None:
        self._names: Dict[str, None] = {}

    def add(self, name: str, used: Collection[str] = ()) -> None:
        """Keep a name; of the older ones those that are `used` stay."""
        self._names[name] = None
        if len(self._names) > 2 * KEPT + len(used):
            old = list(self._names)[:-KEPT]
            for each in old:
                if each not in used:
                    del self._names[each]

    def __contains__(self, name: object) -> bool:
        return name in self._names
