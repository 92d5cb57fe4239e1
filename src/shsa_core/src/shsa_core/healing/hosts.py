"""The robot's computers as they are now: which are there, and what they have to do."""
from dataclasses import dataclass
from math import inf
from typing import Dict, List, Optional

from shsa_core.agenda import Agenda, doubled
from shsa_core.healing.host_events import HostLost, HostSeen
from shsa_core.healing.settings import Settings

SETTLE_S = 2.0
"""Computers come one after the other: what stands by is placed anew once they have."""
STRAINED = 0.9
"""Of its cores: a computer that has more of them busy makes well nodes slow."""
MISSED_S = 1.5
"""A computer that was not heard for so long was cut off, though nobody said so."""


@dataclass
class _Computer:
    """`counts`: since when substitutes may be placed there; `steady`: heard without a gap since."""

    word: HostSeen
    counts: float
    steady: float
    detail: str = ""  # why it is lost; empty: it is there
    losses: int = 0  # one soon after the other
    doubted: float = -inf


class Hosts:
    """Which computers are there, by what their agents tell.

    One that comes back counts for placement after a hold-off, which doubles while it is lost again
    and again: a link that drops every few seconds moves nothing. `own`: the name in the SOM of the
    reconfigurator's computer, which is always there, and is "" here.
    """

    def __init__(self, settings: Settings, own: str = "") -> None:
        self._settings = settings
        self._own = own
        self._known: Dict[str, _Computer] = {}
        self._settling: Agenda[str] = Agenda()

    @property
    def deadline(self) -> Optional[float]:
        """When `settled` has something to tell, in s; None: never."""
        return self._settling.next()

    def settled(self, time: float) -> List[str]:
        """The computers that count from now on, and did not before."""
        return self._settling.pop_due(time)

    def name(self, host: str) -> str:
        """The name of a computer here: the reconfigurator's own has none."""
        return "" if host == self._own else host

    def in_som(self, host: str) -> str:
        """The name of a computer in the SOM; empty: it has none."""
        return host or self._own

    def known(self, host: str) -> bool:
        """Whether a computer was ever heard."""
        return host in self._known

    def lost(self, host: str) -> str:
        """Why a computer counts as lost; empty: it does not."""
        return self._known[host].detail if host in self._known else ""

    def reachable(self, host: str) -> bool:
        """Whether what is said to a computer is heard there."""
        return host == "" or (host in self._known and not self._known[host].detail)

    def counts(self, host: str, time: float) -> bool:
        """Whether substitutes may be placed on a computer."""
        if not self.reachable(host):
            return False
        computer = self._known.get(host)
        certain = computer is None or computer.word.time > computer.doubted
        return host == "" or computer is None or (certain and time >= computer.counts)

    def doubt(self, host: str, time: float) -> None:
        """Somebody on a computer fell silent: it does not count until it is heard again."""
        if host in self._known:
            self._known[host].doubted = time

    def word(self, host: str) -> Optional[HostSeen]:
        """What a computer has told of itself last."""
        return self._known[host].word if host in self._known else None

    def strained(self, host: str) -> bool:
        """Whether a computer has too much to do, by what it has told last."""
        word = self.word(host)
        return word is not None and word.load >= STRAINED * word.cores > 0.0

    def heard(self, host: str) -> float:
        """When a computer was heard last, in s."""
        return self._known[host].word.time if host in self._known else -inf

    def steady_since(self, host: str) -> float:
        """Since when a computer is heard without a gap, in s."""
        return self._known[host].steady if host in self._known else -inf

    def seen(self, event: HostSeen) -> bool:
        """A computer is there. Whether it was not before, or was cut off."""
        host, time = self.name(event.host), event.time
        computer = self._known.get(host)
        if computer is None:
            self._known[host] = _Computer(event, time, time)
            self._settling.set(host, time + SETTLE_S)
            return True
        back = bool(computer.detail)
        missed = time - computer.word.time > MISSED_S
        if back:
            settings, times = self._settings, computer.losses - 1
            longest = max(settings.hold_off, settings.hold_off_limit)
            computer.counts = time + doubled(settings.hold_off, times, longest)
            self._settling.set(host, max(computer.counts, time + SETTLE_S))
        computer.word, computer.detail = event, ""
        if back or missed:
            computer.steady = time
        return back or missed

    def lose(self, event: HostLost) -> bool:
        """A computer is not heard any more. Whether that is new."""
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
        self._settling.set(host, None)
        return True
