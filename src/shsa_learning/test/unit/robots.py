"""Robots for tests of the survey: message types as mappings, and what they say."""
import random
from typing import Any, Dict, List, Mapping, Optional, Sequence, Tuple

from shsa_core import message_types
from shsa_learning.init.contents import Number, contents
from shsa_learning.init.survey import Publisher, Survey, Surveyor

TYPES: Dict[str, Dict[str, str]] = {
    "test_msgs/Number": {"header": "std_msgs/Header", "data": "float64"},
    "test_msgs/Pair": {"left": "float64", "right": "int32"},
}


def layout(name: str) -> Mapping[str, str]:
    """Return the fields of a type of these robots, or of an installed one."""
    return TYPES[name] if name in TYPES else message_types.layout(name)


def numbers(kind: str) -> Tuple[Number, ...]:
    """Return the numbers in a message type."""
    return contents(kind, layout).numbers


def times(period: float, end: float, jitter: float = 0.0, seed: int = 0) -> List[float]:
    """Moments from 0 to `end`, s, each off by at most `jitter` periods."""
    draw = random.Random(seed)
    count = int(end / period)
    return [period * (k + draw.uniform(-jitter, jitter)) for k in range(count)]


class Robot:
    """A robot whose messages go to a surveyor."""

    def __init__(self) -> None:
        self.surveyor = Surveyor()

    def says(
        self,
        topic: str,
        values: Sequence[Tuple[float, Any]],
        node: str = "/node",
        kind: str = "test_msgs/Number",
        latched: bool = False,
    ) -> None:
        """Have a node publish values, each at a time in s; of a type with several: tuples."""
        publisher = Publisher(topic, kind, node)
        for time, value in values:
            self.surveyor.heard(publisher, time, latched)
            row = value if isinstance(value, tuple) else (value,)
            if self.surveyor.wants(publisher, 8):
                self.surveyor.values(publisher, dict(zip(numbers(kind), row)))

    def is_silent(self, topic: str, node: str = "/node", kind: str = "test_msgs/Number") -> None:
        """Have a node advertise a topic."""
        publisher = Publisher(topic, kind, node)
        if self.surveyor.knows(publisher):
            said: Dict[Number, Optional[float]] = dict.fromkeys(numbers(kind))
            self.surveyor.values(publisher, said)

    def survey(self, end: float = 20.0) -> Survey:
        """Return the survey after `end` s."""
        return self.surveyor.result(0.0, end)
