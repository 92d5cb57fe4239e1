"""Fields of messages as text: one grammar for the SOM and for a substitute's three strings.

    field     PATH | min(PATH) | max(PATH) | mean(PATH) | count(PATH) | yaw(PATH) | roll(PATH) | ...
    PATH      steps with dots between them, in the three strings with slashes
    step      NAME | NAME[3] | NAME[name=left_wheel], and at the end of a reduction NAME[10:50]
"""
import functools
import re
from dataclasses import dataclass
from math import isfinite, remainder, tau
from typing import List, Optional, Tuple, Union

from shsa_core.errors import ShsaError
from shsa_core.text import short

REDUCTIONS = ("min", "max", "mean", "count")
ANGLES = ("roll", "pitch", "yaw")
LONGEST = 255  # characters of a field

_FUNCTION = re.compile(r"(\w+)\((.*)\)\Z", re.ASCII | re.DOTALL)
_STEP = re.compile(
    r"(?P<name>[A-Za-z]\w*)"
    r"(?:\[(?:(?P<index>\d{1,6})"
    r"|(?P<key>[A-Za-z]\w*)=(?P<value>[\w./:-]{1,100})"
    r"|(?P<start>\d{1,6})?:(?P<stop>\d{1,6})?)\])?",
    re.ASCII,
)
# REP 117: the fields whose NaN and infinite values tell of a sensor that works.
_DISTANCES = {
    "sensor_msgs/LaserScan": "ranges",
    "sensor_msgs/MultiEchoLaserScan": "ranges",
    "sensor_msgs/Range": "range",
}


@dataclass(frozen=True)
class Named:
    """The element of an array at the place where the array `names` beside it holds `name`."""

    names: str
    name: str

    def __str__(self) -> str:
        return f"{self.names}={self.name}"


@dataclass(frozen=True)
class Span:
    """The elements of an array from `start` to before `stop`; None: to its end."""

    start: int
    stop: Optional[int]

    def __str__(self) -> str:
        return f"{self.start or ''}:{'' if self.stop is None else self.stop}"


Selector = Union[None, int, Named, Span]
"""A number is the place of an element, the first one is 0."""


@dataclass(frozen=True)
class Step:
    """A field of a message, or a part of one that is an array."""

    name: str
    part: Selector = None

    def __str__(self) -> str:
        return self.name + ("" if self.part is None else f"[{self.part}]")


@dataclass(frozen=True)
class FieldText:
    """A field as its text says; `function`: one of REDUCTIONS or ANGLES, or empty."""

    steps: Tuple[Step, ...]
    function: str = ""

    def __str__(self) -> str:
        path = ".".join(map(str, self.steps))
        return f"{self.function}({path})" if self.function else path


@functools.lru_cache(maxsize=1024)
def parse_field(text: str, separator: str = ".") -> FieldText:
    """Return the field that a text names, with dots, or slashes. Raises ShsaError if it is none."""
    if len(text) > LONGEST:
        raise ShsaError(f"a field has at most {LONGEST} characters, not {len(text)}")
    call = _FUNCTION.match(text)
    function, path = call.groups() if call is not None else ("", text)
    if function and function not in REDUCTIONS + ANGLES:
        known = ", ".join(REDUCTIONS + ANGLES)
        raise ShsaError(f"{text!a} is not a field: the functions are {known}")
    steps: List[Step] = []
    at = -1
    while at < len(path):
        match = _STEP.match(path, at + 1)
        if match is None or path[match.end() : match.end() + 1] not in ("", separator):
            raise ShsaError(
                f"{short(text)!a} is not a field; fields are written like data, pose.position.x, "
                "ranges[3], velocity[name=left_wheel], min(ranges[10:50]) or "
                "yaw(pose.pose.orientation)"
            )
        steps.append(Step(match["name"], _part(match)))
        at = match.end()
    return FieldText(_checked(text, steps, function), function)


def _part(match: "re.Match[str]") -> Selector:
    if match["index"] is not None:
        return int(match["index"])
    if match["key"] is not None:
        return Named(match["key"], match["value"])
    if not match[0].endswith("]"):
        return None
    stop = match["stop"]
    return Span(int(match["start"] or 0), None if stop is None else int(stop))


def _checked(text: str, steps: List[Step], function: str) -> Tuple[Step, ...]:
    before = steps[:-1] if function in REDUCTIONS else steps
    if any(isinstance(step.part, Span) for step in before):
        raise ShsaError(
            f"{text!a} is not a field: a slice stands at the end of {', '.join(REDUCTIONS)} alone"
        )
    last = steps[-1]
    if function in REDUCTIONS and not isinstance(last.part, (Span, type(None))):
        raise ShsaError(f"{text!a} is not a field: {function} is of an array, or of a slice of one")
    if isinstance(last.part, Span):
        start, stop = last.part.start, last.part.stop
        if stop is not None and stop <= start:
            raise ShsaError(f"{text!a} is not a field: the slice [{last.part}] is empty")
        if last.part == Span(0, None):
            last = Step(last.name)
    return (*steps[:-1], last)


def reduces(field: str) -> bool:
    """Return true if a field is one number of many, so that it cannot be written."""
    return parse_field(field).function in REDUCTIONS


def is_angle(field: str) -> bool:
    """Return true if a field is an angle of a quaternion."""
    return parse_field(field).function in ANGLES


def difference(one: float, other: float, angle: bool) -> float:
    """Return `one` less `other`; of an `angle` in rad, the shorter way round."""
    off = one - other
    return remainder(off, tau) if angle and isfinite(off) else off


def to_path(field: str) -> str:
    """Return the text of a field in the SOM, as it stands in one of the three strings."""
    return re.sub(r"\.(?![^\[]*\])", "/", field)


def is_distance(message_type: str, field: str) -> bool:
    """Return true if a field is a distance, whose NaN and infinite values tell much (REP 117)."""
    return _DISTANCES.get(message_type) == parse_field(field).steps[0].name
