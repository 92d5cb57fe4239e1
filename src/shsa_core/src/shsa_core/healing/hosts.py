"""The robot's computers as they are now: which are there, and what they have to do."""
from dataclasses import dataclass
from math import inf
from typing import Dict, Optional

from shsa_core.agenda import Agenda, doubled
from shsa_core.healing.events import HostLost, HostSeen
from shsa_core.healing.settings import CERTAIN_S, MISSED_S, SETTLE_S, STRAINED, Settings


@dataclass
class _Computer:
    """`counts`: since when substitutes may be placed there; `steady`: heard without a gap since."""

    word: HostSeen
    counts: float
    steady: float
    detail: str = ""  # why it is lost; empty: it is there
    losses: int = 0  # one soon after the other
    doubted: float = -inf


class Computers:
    """The computers that are there, by what their agents tell.

    One that comes back counts for placement after a hold-off, which doubles while it is lost again
    and again: a link that drops every few seconds moves nothing. `own`: the name in the SOM of the
    reconfigurator's computer, which is always there, and is "" here. `settling`: those that
    count for placement soon.
    """

    def __init__(self, settings: Settings, own: str = "") -> None:
        self._settings = settings
        self._own = own
        self._known: Dict[str, _Computer] = {}
        self.settling: Agenda[str] = Agenda()

    def name(self, host: str) -> str:
        """Return the name of a computer here: the reconfigurator's own has none."""
        return "" if host == self._own else host

    def in_som(self, host: str) -> str:
        """Return the name of a computer in the SOM; empty: it has none."""
        return host or self._own

    def lost(self, host: str) -> str:
        """Return why a computer counts as lost; empty: it does not."""
        return self._known[host].detail if host in self._known else ""

    def reachable(self, host: str) -> bool:
        """Tell that what is said to a computer is heard there."""
        return host == "" or (host in self._known and not self._known[host].detail)

    def counts(self, host: str, time: float) -> bool:
        """Tell that substitutes may be placed on a computer."""
        computer = self._known.get(host)
        if host == "" or computer is None or computer.detail:
            return host == ""
        return computer.word.time > computer.doubted and time >= computer.counts

    def doubt(self, host: str, time: float) -> None:
        """Somebody on a computer fell silent: it does not count until it is heard again."""
        if host in self._known:
            self._known[host].doubted = time

    def doubted(self, host: str, time: float) -> bool:
        """Tell that somebody on a computer fell silent since it was heard, or that it was lost."""
        computer = self._known.get(host)
        if computer is None or computer.word.time == -inf:
            return False
        back = computer.losses > 0 and time <= computer.steady + CERTAIN_S
        return back or computer.doubted >= computer.word.time

    def word(self, host: str) -> Optional[HostSeen]:
        """Return what a computer has told of itself last."""
        return self._known[host].word if host in self._known else None

    def strained(self, host: str) -> bool:
        """Tell that a computer has too much to do, by what it has told last."""
        word = self.word(host)
        return word is not None and word.load >= STRAINED * word.cores > 0.0

    def heard(self, host: str) -> float:
        """Return when a computer was heard last, in s."""
        return self._known[host].word.time if host in self._known else -inf

    def steady_since(self, host: str) -> float:
        """Return since when a computer is heard without a gap, in s."""
        return self._known[host].steady if host in self._known else -inf

    def seen(self, event: HostSeen) -> bool:
        """Note that a computer is there. Returns that it was not before, or was cut off."""
        host, time = self.name(event.host), event.time
        computer = self._known.get(host)
        if computer is None:
            self._known[host] = _Computer(event, time, time)
            self.settling.set(host, time + SETTLE_S)
            return True
        back = bool(computer.detail)
        if back:
            pause, longest = self._settings.hold_off, self._settings.longest_hold_off
            computer.counts = time + doubled(pause, computer.losses - 1, longest)
            self.settling.set(host, max(computer.counts, time + SETTLE_S))
        back = back or time - computer.word.time > MISSED_S
        computer.word, computer.detail = event, ""
        if back:
            computer.steady = time
        return back

    def lose(self, event: HostLost) -> bool:
        """Note that a computer is not heard any more. Returns that this is new."""
        host = self.name(event.host)
        if host == "":
            return False
        never = _Computer(HostSeen(-inf, host, 0.0, 0.0), -inf, event.time)
        computer = self._known.setdefault(host, never)
        if computer.detail:
            return False
        calm = event.time - computer.steady > self._settings.stable
        computer.losses = 1 if calm else computer.losses + 1
        computer.detail = event.detail or "nothing is heard of it"
        self.settling.set(host, None)
        return True
