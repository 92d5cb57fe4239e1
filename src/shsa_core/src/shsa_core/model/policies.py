"""What is done about a failed topic beside a substitute: the node started again, a last resort, a node kept out."""
from collections import deque
from dataclasses import dataclass
from typing import Deque, Dict, List, Optional, Tuple, Union

from shsa_core.model.document import Value

SUBSTITUTE = "substitute"
RESTART = "restart"
RESTART_AND_SUBSTITUTE = "restart_and_substitute"
POLICIES = (SUBSTITUTE, RESTART, RESTART_AND_SUBSTITUTE)
MINUTE = 60.0
_LONGEST_COMMAND = 100


@dataclass(frozen=True, order=True)
class LastResort:
    """What is done when nothing can substitute: publish `value` (in the property's unit), and run `command`.

    With neither, the topic is silent. `command` is a program and its arguments; it goes through no shell.
    """

    value: Optional[float] = None
    command: Tuple[str, ...] = ()

    def parameters(self) -> Dict[str, Union[float, str, List[str]]]:
        """As it lies on the parameter server, where no command is put."""
        return {} if self.value is None else {"value": self.value}


def read_last_resort(value: Value, key: str) -> LastResort:
    """`stop`, or a mapping with a value, a command, or both. Raises ModelError."""
    if value.data == "stop":
        return LastResort()
    if not isinstance(value.data, dict):
        raise value.error(
            f"{key} must be stop, {{value: NUMBER}} or {{command: [PROGRAM, ARGUMENT, ...]}}, "
            f"not {value.describe()}"
        )
    entry = value.entry(key, ("value", "command"))
    safe = entry["value"].number("value") if "value" in entry else None
    words: List[str] = []
    if "command" in entry:
        items = entry["command"].sequence("command (a program and its arguments)")
        words = [item.string("a word of command") for item in items]
        if not 0 < len(words) <= _LONGEST_COMMAND or not words[0]:
            raise value.error(f"command must have 1 to {_LONGEST_COMMAND} words, the program first")
    if any("\0" in word for word in words):
        raise value.error("a word of command cannot hold a zero byte")
    return LastResort(safe, tuple(words))


class Intensity:
    """Whether a topic is healed too often: more than `most` times in a minute; 0: any number will do.

    Once it was too often, it stays so until it is forgotten.
    """

    def __init__(self, most: int) -> None:
        self.most = most
        self.exceeded = False
        self._moments: Deque[float] = deque()

    def healed(self, time: float) -> None:
        """The topic is to be healed once more."""
        self._moments.append(time)
        while self._moments[0] <= time - MINUTE:
            self._moments.popleft()
        self.exceeded = self.exceeded or 0 < self.most < len(self._moments)

    def forget(self) -> None:
        """Start counting anew."""
        self._moments.clear()
        self.exceeded = False
