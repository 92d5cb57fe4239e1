"""The computers whose messages are believed, and their clocks.

Ours is one. Another one is believed once a node on it has proved that it holds our secret, uses
our master and runs in that very boot. The round trip of that proof bounds how far its clock can
be from ours; no clock needs to be right.
"""
import threading
from typing import Callable, Dict, List, NamedTuple, Optional, Tuple

from shsa_core.errors import ShsaError

DRIFT = 500e-6
"""More than two clocks drift apart: quartzes have up to 100e-6, what corrects them adds as much."""
TRIES = 3
"""So often a node is asked that does not answer, and a clock each time it is renewed: the fastest
answer tells most."""
PAUSE_NS = 1_000_000_000
"""Between two questions to a node that has not proved anything, and before the first renewal."""
RENEW_NS = 60_000_000_000
OLD_NS = RENEW_NS // 2
MOST = 64
"""So many computers, with each boot counted, are known at the same time."""
MOST_FAILED = 100

Clock = Callable[[], int]


class NoAnswer(ShsaError):
    """A node does not answer: it may the next time."""


class Met(NamedTuple):
    """A computer has proved itself, in answer to a question of ours; times in ns.

    `clock`: its monotonic clock as it answered; `ahead`: the lead of its wall clock over ours, give
    or take half the round trip; `asked`, `answered`: on our monotonic clock.
    """

    boot: bytes
    host: str
    address: str
    clock: int
    ahead: int
    asked: int
    answered: int

    @property
    def round_trip(self) -> int:
        return self.answered - self.asked


Ask = Callable[[str], Met]
"""Asks the node of a name; raises NoAnswer, or ShsaError if what it answers is no proof."""


class Boot:
    """One boot of a computer, and what its monotonic clock can show. From any thread."""

    def __init__(self, boot: bytes, since: int = 0) -> None:
        self.boot = boot
        self.since = since
        """Messages sent before are refused: ns on our clock."""
        self.is_doubted = False
        """Its clock is not where it can be: it must be asked again."""
        self.sender = ""
        """The node that sent the last message."""
        self.due = 0
        self.met: Optional[Met] = None
        """Its proof; None: it is ours."""

    def was_compared(self, since: int) -> bool:
        """Return whether its clock was compared with ours since then, by ours."""
        return self.met is None or self.met.answered >= since

    def latest(self, ours: int) -> int:
        """Return what its clock shows at most when ours shows `ours`."""
        if self.met is None:
            return ours
        drift = int(abs(ours - self.met.answered) * DRIFT)
        return ours + self.met.clock - self.met.asked + drift

    def ours(self, theirs: int) -> int:
        """Return what our clock shows, about, when its shows `theirs`."""
        if self.met is None:
            return theirs
        return theirs - self.met.clock + (self.met.asked + self.met.answered) // 2

    def measured(self, met: Met) -> None:
        """Learn from an answer, unless a faster one of late tells more."""
        old = None if self.is_doubted else self.met
        if not (old and met.round_trip > old.round_trip and old.answered >= met.asked - OLD_NS):
            self.met = met
        self.is_doubted = False


class Boots:
    """Those that are known, by what their messages name as `boot`. From any thread.

    A question waits for its answer, in the thread that reads that node's connection: what comes
    after it waits in the socket, so that nothing is lost, overtaken, or piles up.
    """

    def __init__(self, own: bytes, ask: Ask, clock: Clock) -> None:
        self._ask, self._clock = ask, clock
        self.own = Boot(own)
        self._known: Dict[bytes, Boot] = {own: self.own}
        self._failed: Dict[Tuple[bytes, str], Tuple[int, str]] = {}  # the oldest first
        self._forgotten = 0
        self._lock = threading.Lock()

    def find(self, boot: bytes) -> Optional[Boot]:
        """Return the computer that a message names; None: it must prove itself, or do so again."""
        computer = self._known.get(boot)
        return None if computer is None or computer.is_doubted else computer

    def refusal(self, boot: bytes, sender: str) -> str:
        """Have the node `sender` prove that it runs in that boot. Waits for the answer.

        Return why it is not believed; empty: it is. One that is silent is asked again, once in
        PAUSE_NS at most.
        """
        if self.find(boot) is not None:
            return ""
        key, now = (boot, sender), self._clock()
        with self._lock:
            until, why = self._failed.get(key, (0, ""))
        if why and now < until:
            return why
        why = self._meet(boot, sender)
        with self._lock:
            self._failed.pop(key, None)
            if why:
                self._failed[key] = self._clock() + PAUSE_NS, why
            if len(self._failed) > MOST_FAILED:
                del self._failed[next(iter(self._failed))]
        return why

    def ours(self, boot: bytes, sent: int, sender: str) -> int:
        """Return what our clock showed, about, when `sender` sent what is believed."""
        computer = self._known.get(boot, self.own)
        computer.sender = sender
        return computer.ours(sent)

    def seen(self) -> List[Met]:
        """Return the newest proof of each other computer that is known, by its address."""
        with self._lock:
            found = [each.met for each in self._known.values() if each.met is not None]
        newest = {(met.host, met.address): met for met in sorted(found, key=lambda m: m.answered)}
        return [met for _, met in sorted(newest.items())]

    def renew(self) -> None:
        """Measure the clocks that are due. Waits for answers."""
        with self._lock:
            others = [each for each in self._known.values() if each is not self.own]
        for computer in others:
            if self._clock() >= computer.due:
                for _ in range(TRIES):
                    self._meet(computer.boot, computer.sender, 1)
                computer.due = self._clock() + RENEW_NS

    def _meet(self, boot: bytes, sender: str, tries: int = TRIES) -> str:
        for _ in range(tries):
            try:
                met = self._ask(sender)
            except NoAnswer as error:
                why = str(error)
                continue
            except ShsaError as error:
                return str(error)
            if met.boot != boot:
                return "it is of another boot or computer than its sender"
            self._learn(met, sender)
            return ""
        return why

    def _learn(self, met: Met, sender: str) -> None:
        with self._lock:
            computer = self._known.get(met.boot)
            if computer is None:
                computer = Boot(met.boot, self._forgotten)
                computer.due = met.answered + PAUSE_NS
            computer.measured(met)
            computer.sender = sender
            self._known[met.boot] = computer
            if len(self._known) > MOST + 1:
                self._forget_one()

    def _forget_one(self) -> None:
        """Forget the oldest, and its messages: none that was sent until now is believed again."""
        mets = [each.met for each in self._known.values() if each.met is not None]
        del self._known[min(mets, key=lambda met: met.answered).boot]
        self._forgotten = self._clock()
