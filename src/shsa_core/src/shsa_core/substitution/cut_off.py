"""What a substitute does by itself: while its computer cannot reach the reconfigurator, and after.

It publishes while nobody else does, as far as is heard on its side: so each side of a cut has one
publisher. Whoever publishes as well when the sides meet again is heard, and it yields at once: it
is the one that is spare. In reach of the reconfigurator it does as its row says, and yields if that
says so: then it is the original that was cut off.
"""
import math

from shsa_core.model.kinds import OnPartition
from shsa_core.model.substitution import Substitution
from shsa_core.substitution.overhearing import Overhearing


class CutOff:
    """Whether a substitute publishes otherwise than its row says. Times in s."""

    def __init__(self, others: Overhearing) -> None:
        self.listens = False  # others are listened for
        self._others = others
        self._says = self._yields = False
        self._deadline = math.inf
        self._topic = ""
        self._cut = False
        self._heard = False  # somebody else was, so that silence tells something
        self._yielded = False

    def follow(self, row: Substitution, topic: str) -> None:
        """The row is another one; `topic`: that of its program."""
        self.listens = row.on_partition is OnPartition.HEAL and topic != ""
        self._yields = row.yields
        if topic != self._topic or not self.listens:
            self._heard = False
        if topic != self._topic:
            self._yielded = False
        if row.publishing is not self._says:
            self._yielded = False
        self._topic, self._says = topic, row.publishing
        deadline = row.outputs[0].deadline if row.outputs else None
        self._deadline = math.inf if deadline is None else deadline

    def reach(self, cut: bool) -> None:
        """The reconfigurator is out of reach, or in reach again."""
        self._cut = cut

    def heard(self) -> None:
        """Somebody else has published."""
        if self.listens:
            self._heard = True
            self._yielded = self._yielded or self._cut or self._yields

    def pass_time(self) -> None:
        """Time has passed."""
        if self._is_silent:
            self._yielded = False

    @property
    def publishes(self) -> bool:
        """Whether it publishes now."""
        if self._yielded:
            return False
        takes_over = self._cut and self.listens and self._is_silent
        return self._says or takes_over

    @property
    def next(self) -> float:
        """When to look again how long others are silent, if that matters now; else infinite."""
        waits = self.listens and self._heard and (self._yielded or (self._cut and not self._says))
        if not waits or self._deadline == math.inf or self._is_silent:
            return math.inf
        return self._others.silent_at(self._deadline)

    @property
    def _is_silent(self) -> bool:
        """Whether those are silent who were heard."""
        return self._heard and self._others.are_silent(self._deadline)
