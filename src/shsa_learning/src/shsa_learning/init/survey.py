"""A survey of a robot: what each publisher of each topic says, how often, and in which ranges."""
import re
from dataclasses import dataclass
from typing import Dict, Mapping, NamedTuple, Optional, Tuple

from shsa_core.model.names import Names
from shsa_learning.init.contents import LeftOut, Number
from shsa_learning.init.spread import Rhythm, RhythmTally, Spread, SpreadTally

MOST_PUBLISHERS = 5000
MOST_FIELDS = 20_000
"""Of all publishers; with 512 values each they take 100 MB."""
LARGEST_MESSAGE_B = 100_000
"""Of a larger one only the time is looked at: it is a picture, a cloud or a map."""
READ_ALL = 10_000
"""So many messages of a publisher are all read; then fewer, the more there are."""
FEWEST = 5
"""Messages without which nobody can tell whether they come regularly."""
RATES = (0.7, 1.35)
"""Rates of a regular stream, of the usual one: within those of which the monitor complains."""
PAUSE_PERIODS, PAUSE_S = 5.0, 0.25
"""A longer pause than both is what the monitor calls silence."""
PERIODS_S = (1e-4, 1e6)
"""Those that a SOM may give."""


class Publisher(NamedTuple):
    """One node on one topic."""

    topic: str
    type: str
    node: str


class Refused(NamedTuple):
    """Something on the graph that is no part of a survey, and why."""

    topic: str
    type: str
    node: str
    why: str


@dataclass(frozen=True)
class Field:
    """A number in the messages of a publisher; `spread` is None if none was read."""

    number: Number
    spread: Optional[Spread]


@dataclass(frozen=True)
class Facts:
    """The facts of a publisher.

    `period`: s between two messages, None if they do not come regularly; `why`: what tells so.
    """

    publisher: Publisher
    latched: bool
    rhythm: Rhythm
    period: Optional[float]
    why: str
    fields: Tuple[Field, ...]
    left_out: Tuple[LeftOut, ...]


@dataclass(frozen=True)
class Survey:
    """All that was seen, sorted by topic and node; `seconds`: for how long."""

    seconds: float
    facts: Tuple[Facts, ...]
    refused: Tuple[Refused, ...]


class Surveyor:
    """Takes what is heard, and tells what it makes of it."""

    def __init__(self) -> None:
        self._tallies: Dict[Publisher, _Tally] = {}
        self._types: Dict[str, str] = {}
        self._refused: Dict[Tuple[str, str, str], Refused] = {}
        self._fields = 0
        self._ends: Dict[str, float] = {}

    def has(self, publisher: Publisher) -> bool:
        """Return whether a publisher is part of the survey already."""
        return publisher in self._tallies

    def knows(self, publisher: Publisher) -> bool:
        """Add a publisher, heard or not; return whether it is part of the survey."""
        if publisher in self._tallies:
            return True
        kind = self._types.setdefault(publisher.topic, publisher.type)
        if kind != publisher.type:
            self.refuse(Refused(*publisher, f"{publisher.topic} has the type {kind}"))
            return False
        if len(self._tallies) >= MOST_PUBLISHERS:
            self.refuse(Refused("", "", "", f"there are more than {MOST_PUBLISHERS} publishers"))
            return False
        self._tallies[publisher] = _Tally()
        return True

    def refuse(self, refused: Refused) -> None:
        """Note what is left out, each once, and not without end."""
        if len(self._refused) < MOST_PUBLISHERS:
            self._refused.setdefault(refused[:3], refused)

    def heard(self, publisher: Publisher, time: float, latched: bool) -> None:
        """Count a message at `time`, s."""
        if self.knows(publisher):
            tally = self._tallies[publisher]
            tally.rhythm.add(time)
            tally.latched = tally.latched or latched

    def wants(self, publisher: Publisher, size: int) -> bool:
        """Return whether the values of the last message heard, of `size` bytes, are to be read."""
        tally = self._tallies.get(publisher)
        if tally is None or size > LARGEST_MESSAGE_B:
            return False
        tally.waits += 1
        if tally.waits * READ_ALL <= tally.read:
            return False
        tally.waits, tally.read = 0, tally.read + 1
        return True

    def values(self, publisher: Publisher, numbers: Mapping[Number, Optional[float]]) -> None:
        """Add the numbers of a message; None: the message has that number, but no value."""
        fields = self._tallies[publisher].fields
        for number, value in numbers.items():
            if number not in fields:
                if self._fields >= MOST_FIELDS:
                    self.omit(publisher, LeftOut(number.field, f"more than {MOST_FIELDS} values"))
                    continue
                self._fields += 1
                fields[number] = SpreadTally()
            if value is not None:
                fields[number].add(value)

    def omit(self, publisher: Publisher, part: LeftOut) -> None:
        """Note a part of its messages that is no value."""
        if self.knows(publisher):
            self._tallies[publisher].left_out.setdefault(part.path, part)

    def stops(self, topic: str, time: float) -> None:
        """End a topic's part of the survey at `time`, s."""
        self._ends[topic] = time

    def result(self, begin: float, end: float) -> Survey:
        """Return the survey from `begin` to `end`, in s."""
        facts = [self._facts(each, end) for each in sorted(self._tallies)]
        return Survey(end - begin, tuple(facts), tuple(sorted(self._refused.values())))

    def _facts(self, publisher: Publisher, end: float) -> Facts:
        tally = self._tallies[publisher]
        rhythm = tally.rhythm.result(self._ends.get(publisher.topic, end))
        why = irregular(rhythm)
        spreads = [(number, each.result()) for number, each in tally.fields.items()]
        return Facts(
            publisher,
            tally.latched,
            rhythm,
            None if why else nice(rhythm.period or 0.0),
            why,
            tuple(Field(number, spread if spread.count else None) for number, spread in spreads),
            tuple(tally.left_out.values()),
        )


class _Tally:
    """The tallies of a publisher."""

    def __init__(self) -> None:
        self.rhythm = RhythmTally()
        self.latched = False
        self.fields: Dict[Number, SpreadTally] = {}
        self.left_out: Dict[str, LeftOut] = {}
        self.read = self.waits = 0


def irregular(rhythm: Rhythm) -> str:
    """Return why messages have no period that the monitor could use; empty: they have one."""
    if rhythm.count == 0:
        return "no message came"
    if rhythm.count < FEWEST:
        return f"{rhythm.count} message{'s' if rhythm.count > 1 else ''} came: too few to tell"
    if rhythm.period is None or rhythm.longest is None or rhythm.jitter is None:
        return "they come at the same moment"
    if rhythm.longest > max(PAUSE_PERIODS * rhythm.period, PAUSE_S):
        return f"pauses of up to {rhythm.longest:.3g} s"
    slowest, fastest = rhythm.slowest, rhythm.fastest
    if slowest is None or fastest is None or slowest < RATES[0] or fastest > RATES[1]:
        return "the rate changes"
    if not PERIODS_S[0] <= rhythm.period <= PERIODS_S[1]:
        return f"every {rhythm.period:.3g} s, which no SOM can say"
    return ""


def nice(period: float) -> float:
    """Round a period as a person would: to two digits, or three where these are 2 % off."""
    two = float(f"{period:.2g}")
    return two if abs(two - period) <= 0.02 * period else float(f"{period:.3g}")


_NAME = re.compile(r"(/[A-Za-z0-9_]+)+", re.ASCII)
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*", re.ASCII)
_LONGEST = 255
LOGS = ("/rosout", "/rosout_agg")
_OF_ROS = {
    **dict.fromkeys(LOGS, "lines of the log"),
    "/clock": "the simulated time: healing goes by it, and heals none",
    "/diagnostics": "for display: no decision should read it",
    "/diagnostics_agg": "for display: no decision should read it",
    "/diagnostics_toplevel_state": "for display: no decision should read it",
}
_ACTION = ("ActionGoal", "ActionResult", "ActionFeedback")
_PICTURES = (
    *("sensor_msgs/Image", "sensor_msgs/CompressedImage", "stereo_msgs/DisparityImage"),
    *("sensor_msgs/PointCloud", "sensor_msgs/PointCloud2", "nav_msgs/OccupancyGrid"),
    *("theora_image_transport/Packet", "sensor_msgs/CameraInfo", "visualization_msgs/MarkerArray"),
)
"""Many a node makes them only while somebody listens: a survey must not load the robot."""
_FRAMES = ("tf2_msgs/TFMessage", "tf/tfMessage")
_NAMES = Names("/")


def outside(topic: str, kind: str, node: str) -> str:
    """Return why a publisher is no part of a survey; empty if it is. `node` may be empty."""
    if not _NAME.fullmatch(topic) or len(topic) > _LONGEST:
        return "that is no full name of a topic"
    if topic in _OF_ROS:
        return _OF_ROS[topic]
    if "/shsa/" in topic:
        return "healing's own"
    if not _TYPE.fullmatch(kind) or len(kind) > _LONGEST:
        return "that is no type of messages"
    if kind.endswith(_ACTION) or kind.startswith("actionlib_msgs/"):
        return "an action is a dialogue with its server, not a value"
    if kind in _PICTURES:
        return "images, clouds, maps and their settings are not computed from numbers"
    if kind in _FRAMES:
        return "a tf frame has one parent: nobody else can publish it"
    if node and (not _NAME.fullmatch(node) or len(node) > _LONGEST):
        return "that is no full name of a node"
    return "a node of healing's" if node and _NAMES.of_healing(node, in_som=False) else ""
