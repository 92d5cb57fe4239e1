"""What a node sends on its own computer, and whether that shows that it fails by itself.

A link makes nobody silent, or quick, on his own computer. Slow there is a well node as well while
its computer has too much to do, and for a moment at any time.
"""
from typing import Dict, NamedTuple, Optional, Tuple

from shsa_core.model.checks import RateHigh, RateLow

USUAL = RateLow.usual, RateHigh.usual
"""Of its usual rate: who sends about that much on its own computer does well there."""
STEADY_S = 4.0
"""Who is slow at each look for so long is slow by itself."""
FORGET_S = 10.0
"""Looks that are farther apart tell nothing of the time between them."""
LINK = "so it is its link that fails"
STRAINED = "and its computer has too much to do"
PASSES = "and that may pass"


class Doubt(NamedTuple):
    """Why a node is not killed: what was `seen` on its own computer, and the `cause` of that."""

    seen: str
    cause: str


class SentThere:
    """What nodes were found to send where they run. Times in s."""

    def __init__(self) -> None:
        self._slow: Dict[str, Tuple[float, float]] = {}  # since when, and when seen last

    def doubt(
        self, time: float, node: str, rate: Optional[float], period: float, strained: bool
    ) -> Optional[Doubt]:
        """Why a node may not fail by itself, though it fails here; None: it does.

        `rate`: messages/s that it sends there, every `period` s by the SOM; None: it cannot be
        told. `strained`: its computer has too much to do.
        """
        since, last = self._slow.pop(node, (time, time))
        if rate is None:
            return Doubt("nobody is connected to it on its own computer", LINK)
        seen = f"on its own computer it sends {rate:.0f} messages/s"
        if rate == 0.0 or rate * period > USUAL[1]:
            return None
        if rate * period >= USUAL[0]:
            return Doubt(seen, LINK)
        if strained:
            return Doubt(seen, STRAINED)
        since = time if time - last > FORGET_S else since
        if time - since >= STEADY_S:
            return None
        self._slow[node] = since, time
        return Doubt(seen, PASSES)
