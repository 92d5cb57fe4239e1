"""Samples that the checks of a service judge: values, rates, stamps, forms, and what others say."""
from dataclasses import dataclass
from typing import NamedTuple, Optional, Tuple, Union


class Hold(NamedTuple):
    """A value may stay the same for `messages`, and for `seconds`; `longest`: messages, so far."""

    messages: int
    seconds: float
    longest: int


@dataclass(frozen=True)
class ValueSample:
    """One value of a message: of which property, in its unit; `still`: s since it changed.

    `last_good`: the one before it that was. `run`: the messages that it came with in a row; `hold`:
    how long it may, as learned, None: for ever. `angle`: it is one, in rad.
    """

    name: str
    value: float
    range: Optional[Tuple[float, float]] = None
    still: float = 0.0
    last_good: Optional[float] = None
    run: int = 1
    hold: Optional[Hold] = None
    angle: bool = False


@dataclass(frozen=True)
class RateSample:
    """`count` periods of `period` s (too many: `fastest`) passed in `shortest` to `longest` s."""

    count: int
    period: float
    longest: float
    shortest: float
    fastest: Optional[float] = None


@dataclass(frozen=True)
class StampSample:
    """A message arrived `age` s after its stamp.

    It may have waited `waited` s of these for its reader. `usual`: the age as learned, which may
    differ by `allowed` s; None: not known. `again`: the stamp is not newer than the one before,
    though it always was.
    """

    age: float
    waited: float = 0.0
    usual: Optional[float] = None
    allowed: float = 0.0
    again: bool = False


Part = Union[str, int]
Parts = Tuple[Tuple[str, Part], ...]
"""The frames of a message, and the lengths of its arrays, each by its name."""


@dataclass(frozen=True)
class FormSample:
    """A part of a message, by its name: what it is, and what it always was before."""

    name: str
    found: Part
    usual: Part


@dataclass(frozen=True)
class FormulaSample:
    """A formula of the service with these values; `holds` is None while that is not known."""

    holds: Optional[bool]
    values: Tuple[Tuple[str, float], ...]


@dataclass(frozen=True)
class IntruderSample:
    """A publisher that nobody names has published for `lasted` s beside `rightful` ones."""

    lasted: float
    rightful: Tuple[str, ...]


@dataclass(frozen=True)
class WitnessSample:
    """A value, and what was derived from other `nodes`; for 2 s they differed by `mean`.

    `allowed`: as their errors are known; None: they are not.
    """

    name: str
    value: float
    derived: float
    mean: float
    nodes: str
    allowed: Optional[float] = None


OF_VALUE = (ValueSample, WitnessSample)
"""Samples of one value: their checks stand with the property in the SOM."""
