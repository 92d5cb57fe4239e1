"""How many bad messages make a failure, and how many good ones end it."""
from typing import List

from shsa_core.model.checks import LONG_WINDOW, Checks

GAPS = 3
"""So many times must a fault have gone away before it counts as one that comes and goes. Then it is
over only after so many times the longest such gap."""


class Verdict:
    """Counts the bad messages among the last ones: noise is no fault, what comes and goes is."""

    def __init__(self, checks: Checks) -> None:
        self._bad, self._seldom, self._least = checks.bad, checks.seldom, checks.recovery
        self._short, self._long = (1 << checks.of) - 1, (1 << LONG_WINDOW * checks.of) - 1
        self._history = self._past = 0
        self.recovery = checks.recovery
        """So many good messages in a row end a failure: more if it came and went before."""

    def add(self, bad: bool) -> bool:
        """A message was bad or not; whether a bad one was one too many."""
        self._history = (self._history << 1 | bad) & self._long
        self._past = (self._past << 1 | bad) & self._long
        if not bad:
            return False
        recent = _count(self._history & self._short)
        guilty = recent >= self._bad or _count(self._history) >= self._seldom
        if guilty:
            gaps = _gaps(self._past)
            comes_and_goes = len(gaps) >= GAPS
            self.recovery = max(self._least, GAPS * max(gaps) if comes_and_goes else 0)
        return guilty

    def clear(self) -> None:
        """Forget what was bad."""
        self._history = 0


def _count(history: int) -> int:
    return bin(history).count("1")


def _gaps(history: int) -> List[int]:
    """How many good messages in a row lay between bad ones."""
    gaps = bin(history)[2:].rstrip("0").split("1")
    return [len(gap) for gap in gaps if gap]
