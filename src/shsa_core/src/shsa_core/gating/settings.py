"""The numbers by which a gate decides; times in periods of its service unless said otherwise."""
from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """`late`: so long after the last message the substitute speaks; a standby gate waits `silence`
    for the first gate, and at least `least_silence` s, not counting those in which it was not
    scheduled itself.

    A substitute's value is `fresh` for so long. Two voices are at least `apart`. Of a publisher
    that is too fast at most `burst` messages pass at once. `start`: in s,
    until a standby gate is connected to the first, and misses it. `standby_for`: the gate that this
    one stands by for; empty: it is the first.
    """

    late: float = 1.5
    silence: float = 2.0
    least_silence: float = 0.05
    fresh: float = 2.0
    apart: float = 0.5
    burst: float = 5.0
    start: float = 2.0
    standby_for: str = ""
