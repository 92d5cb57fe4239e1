"""The names of substitutes: each is used once, and is told from the names that others give."""
import re
from typing import Iterable, Tuple

PREFIX = "substitute_"
NUMBERED = re.compile(r"[A-Za-z0-9_]+_([0-9]{1,9})")
"""The rest of a name. `[0-9]`: no digits but ours; `{1,9}`: no number that nobody reaches."""

HEALERS = ("monitor", "reconfigurator")
OF_ROS = ("/master", "/rosout")
OBSERVERS = ("/rostopic_", "/record", "/rqt_", "/shsa_")
"""Beginnings of the names of nodes that only look on."""


class Names:
    """The names of substitutes in a namespace: `substitute_`, what for, and a number.

    And those of other nodes that healing and ROS need. `next`: the number of the next name;
    `topics`: how the names of healing's topics begin.
    """

    def __init__(self, namespace: str) -> None:
        self.prefix = namespace.rstrip("/") + "/" + PREFIX
        self.topics = namespace.rstrip("/") + "/shsa/"
        self._ours = {*OF_ROS, *(namespace.rstrip("/") + "/" + name for name in HEALERS)}
        self.next = 1

    def fresh(self, of: str) -> str:
        """Return a node name that was never used before, and never is again."""
        self.next += 1
        return f"{self.prefix}{of}_{self.next - 1}"

    def of_healing(self, node: str, in_som: bool) -> bool:
        """Tell that a node has the name of a healer, or of a part of ROS.

        In another namespace, and as substitutes are named, the SOM may name nodes of the user's.
        """
        if node in self._ours or in_som:
            return node in self._ours
        name = node.rsplit("/", 1)[-1]
        substitute = name.startswith(PREFIX) and NUMBERED.fullmatch(name[len(PREFIX) :])
        return name in HEALERS or bool(substitute)

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
