"""Bags and CSV files for tests, as vehicles record them."""
from pathlib import Path
from typing import Any, Dict, List, Optional, Sequence, Tuple

import rosbag
import rospy
from std_msgs.msg import Float64

from shsa_core.files.document import from_parameters
from shsa_core.files.som_file import read_tree
from shsa_core.model.som import Som
from shsa_learning.recordings.recording import Recording, Series

BEGIN_S = 1000.0
"""Begin of a bag."""
CURRENT = ("/current", "std_msgs/Float64", "/amperemeter", {"current": "data"})
SPEED = ("/odom", "nav_msgs/Odometry", "/wheels", {"speed": "twist.twist.linear.x"})


class BagWriter:
    """Writes a bag with a connection for each publisher of a topic, as `rosbag record` does."""

    def __init__(self, path: Path) -> None:
        self._bag = rosbag.Bag(str(path), "w")
        self._connections: Dict[Tuple[str, str], Any] = {}

    def __enter__(self) -> "BagWriter":
        return self

    def __exit__(self, *_: object) -> None:
        self._bag.close()

    def write(self, topic: str, message: Any, time: float, publisher: str = "/node") -> None:
        """Write a message of a publisher, recorded at a time (s); empty: of nobody."""
        own = self._bag._topic_connections  # one a topic: whoever comes second would be the first
        own.pop(topic, None)
        if (topic, publisher) in self._connections:
            own[topic] = self._connections[topic, publisher]
        header = {
            "topic": topic,
            "type": message._type,
            "md5sum": message._md5sum,
            "message_definition": message._full_text,
        }
        if publisher:
            header["callerid"] = publisher
        self._bag.write(topic, message, rospy.Time.from_sec(time), connection_header=header)
        self._connections[topic, publisher] = own[topic]

    def floats(
        self, topic: str, samples: Sequence[Tuple[float, float]], publisher: str = "/node"
    ) -> None:
        """Write numbers, each with the time of recording (s)."""
        for time, value in samples:
            self.write(topic, Float64(value), time, publisher)


def som_of(**services: Any) -> Som:
    """Make a SOM of services by name: each `topic, type, node, {property: field}`, or a mapping."""
    plain: Dict[str, Any] = {}
    for name, given in services.items():
        if isinstance(given, tuple):
            topic, type_, node, fields = given
            provides = {key: {"field": field} for key, field in fields.items()}
            given = {"topic": topic, "type": type_, "node": node, "provides": provides}
        plain[name] = {"period": 0.1, **given}
    som, errors = read_tree(from_parameters({"services": plain}, "som"))
    assert not errors, errors
    return som


def write_csv(path: Path, columns: Sequence[str], rows: Sequence[Sequence[Optional[float]]]) -> str:
    """Write a CSV file; None is an empty cell."""
    lines: List[str] = [",".join(columns)]
    lines += [",".join("" if cell is None else repr(float(cell)) for cell in row) for row in rows]
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text("\n".join(lines) + "\n")
    return str(path)


def only(recording: Recording) -> Series:
    """Return the only series of a recording."""
    (series,) = recording.series
    return series


def told(recording: Recording, text: str) -> bool:
    """Return whether a note on a recording has that text."""
    return any(text in note for note in recording.notes)
