"""Names of topics and nodes: relative ones are names in the namespace in which healing runs."""
import os
import re
from typing import Collection, Dict, Iterable, Tuple

KEPT = 200

PREFIX = "substitute_"
NUMBERED = re.compile(r"[A-Za-z0-9_]+_([0-9]{1,9})")
"""The rest of a name. `[0-9]`: no digits but ours; `{1,9}`: no number that nobody reaches."""

HEALERS = ("monitor", "reconfigurator")
OF_ROS = ("/master", "/rosout")
OBSERVERS = ("/rostopic_", "/record", "/rqt_", "/shsa_")
"""Beginnings of the names of nodes that only look on."""


def full_name(name: str, namespace: str) -> str:
    """Return a name from the root of the graph: `odom` in `/robot1` is `/robot1/odom`."""
    if name.startswith("/"):
        return name
    return "/".join(("", *filter(None, namespace.split("/")), name))


def is_substitute(node: str) -> bool:
    """Return whether a node is a substitute by its name, in whichever namespace."""
    name = node.rsplit("/", 1)[-1]
    return name.startswith(PREFIX) and bool(NUMBERED.fullmatch(name[len(PREFIX) :]))


def file_name(path: str, namespace: str) -> str:
    """Map `log/a.jsonl` to `log/robot1-a.jsonl` in the namespace `/robot1`, as roslaunch does."""
    folder, name = os.path.split(path)
    return os.path.join(folder, "-".join((*filter(None, namespace.split("/")), name)))


class RecentNames(Dict[str, None]):
    """Names that were used: those in use, and at least the newest KEPT."""

    def add(self, name: str, used: Collection[str] = ()) -> None:
        """Keep a name; of the older ones those that are `used` stay."""
        self[name] = None
        if len(self) > 2 * KEPT + len(used):
            for each in list(self)[:-KEPT]:
                if each not in used:
                    del self[each]


class Names:
    """The names of substitutes in a namespace: `substitute_`, what for, and a number.

    And those of other nodes that healing and ROS need. `next`: the number of the next name;
    `topics`: how the names of healing's topics begin; `hosts`: those with a monitor of their own.
    """

    def __init__(self, namespace: str) -> None:
        self.prefix = namespace.rstrip("/") + "/" + PREFIX
        self.topics = namespace.rstrip("/") + "/shsa/"
        self._ours = {*OF_ROS, *(namespace.rstrip("/") + "/" + name for name in HEALERS)}
        self._monitor = f"{namespace.rstrip('/')}/{HEALERS[0]}_"
        self.hosts: Collection[str] = ()
        self.next = 1

    def fresh(self, of: str) -> str:
        """Return a node name that was never used before, and never is again."""
        self.next += 1
        return f"{self.prefix}{of}_{self.next - 1}"

    def of_healing(self, node: str, in_som: bool) -> bool:
        """Tell that a node is healing's, or of ROS, by its name; the SOM may have named it."""
        if node in self._ours or in_som:
            return node in self._ours
        if node.startswith(self._monitor) and node[len(self._monitor) :] in self.hosts:
            return True
        return node.rsplit("/", 1)[-1] in HEALERS or is_substitute(node)

    def consumers(self, subscribers: Iterable[str]) -> Tuple[str, ...]:
        """Return the subscribers that rely on a topic: not healing's own, and none that records."""
        others = (node for node in sorted(subscribers) if not self.of_healing(node, False))
        return tuple(node for node in others if not node.startswith(OBSERVERS))

    def avoid(self, node: str) -> bool:
        """Use no number up to that in a node name; False: the name has another form."""
        rest = node[len(self.prefix) :] if node.startswith(self.prefix) else ""
        found = NUMBERED.fullmatch(rest)
        if found is None:
            return False
        self.next = max(self.next, 1 + int(found.group(1)))
        return True
