"""The robot's computers as they are now: which are there, and what they have to do."""
from dataclasses import dataclass, replace
from math import inf
from typing import Dict

from shsa_core.agenda import Agenda, doubled
from shsa_core.healing.events import HostLost, HostSeen
from shsa_core.healing.settings import CERTAIN_S, MISSED_S, SETTLE_S, STRAINED, Settings


@dataclass
class Computer:
    """A computer of the robot, by what it has told of itself last.

    `counts`: since when substitutes may be placed there; `steady`: heard without a gap since.
    """

    word: HostSeen = HostSeen(-inf, "", 0.0, 0.0)
    counts: float = -inf
    steady: float = -inf
    detail: str = ""  # why it is lost; empty: it is there
    losses: int = 0  # one soon after the other
    doubted: float = -inf


UNKNOWN = Computer()


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
        self._known: Dict[str, Computer] = {}
        self.settling: Agenda[str] = Agenda()

    def name(self, host: str) -> str:
        """Return the name of a computer here: the reconfigurator's own has none."""
        return "" if host == self._own else host

    def in_som(self, host: str) -> str:
        """Return the name of a computer in the SOM; empty: it has none."""
        return host or self._own

    def of(self, host: str) -> Computer:
        """Return what is known of a computer."""
        return self._known.get(host, UNKNOWN)

    def lost(self, host: str) -> str:
        """Return why a computer counts as lost; empty: it does not."""
        return self.of(host).detail

    def reachable(self, host: str) -> bool:
        """Tell that what is said to a computer is heard there."""
        return host == "" or (host in self._known and not self.lost(host))

    def counts(self, host: str, time: float) -> bool:
        """Tell that substitutes may be placed on a computer."""
        computer = self.of(host)
        settled = computer.word.time > computer.doubted and time >= computer.counts
        return host == "" or (settled and not computer.detail)

    def doubt(self, host: str, time: float) -> None:
        """Somebody on a computer fell silent: it does not count until it is heard again."""
        if host in self._known:
            self._known[host].doubted = time

    def doubted(self, host: str, time: float) -> bool:
        """Tell that somebody on a computer fell silent since it was heard, or that it was lost."""
        computer = self.of(host)
        if computer.word.time == -inf:
            return False
        back = computer.losses > 0 and time <= computer.steady + CERTAIN_S
        return back or computer.doubted >= computer.word.time

    def strained(self, host: str) -> bool:
        """Tell that a computer has too much to do, by what it has told last."""
        word = self.of(host).word
        return word.load >= STRAINED * word.cores > 0.0

    def seen(self, event: HostSeen) -> bool:
        """Note that a computer is there. Returns that it was not before, or was cut off."""
        host, time = self.name(event.host), event.time
        computer = self._known.get(host)
        if computer is None:
            self._known[host] = Computer(event, time, time)
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
        computer = self._known.setdefault(host, replace(UNKNOWN, steady=event.time))
        if computer.detail:
            return False
        calm = event.time - computer.steady > self._settings.stable
        computer.losses = 1 if calm else computer.losses + 1
        computer.detail = event.detail or "nothing is heard of it"
        self.settling.set(host, None)
        return True
