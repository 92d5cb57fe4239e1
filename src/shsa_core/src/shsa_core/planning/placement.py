"""The robot's computers as they are now, and where substitutes are placed.

Section IV-A of the paper: a substitute may run on dedicated hardware.
"""
from dataclasses import dataclass
from math import inf
from typing import Callable, Collection, Dict, Iterable, List, Optional, Tuple

from shsa_core.agenda import Agenda
from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.model.cost import Cost, Host, cost, traffic
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.planning.settings import CERTAIN_S, STRAINED

OWN = "the reconfigurator's computer"


@dataclass
class Computer:
    """A computer of the robot, by what it has told of itself when it was `heard` last.

    How many of its `cores` are `busy`, and bytes/s on its `link`. `counts`: since when substitutes
    may be placed there; `steady`: heard without a gap since.
    """

    heard: float = -inf
    busy: float = 0.0
    cores: float = 0.0
    link: float = 0.0
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
    reconfigurator's computer, which is always there, and is "" here. `hold_off`: in s, after so
    many losses before; `calm`: s after which they are forgotten. `settling`: those that count for
    placement soon.
    """

    def __init__(
        self, own: str = "", hold_off: Callable[[int], float] = lambda times: 0.0, calm: float = inf
    ) -> None:
        self._own, self._hold_off, self._calm = own, hold_off, calm
        self._known: Dict[str, Computer] = {}
        self.settling: Agenda[str] = Agenda()

    def name(self, host: str) -> str:
        """Return the name of a computer here: the reconfigurator's own has none."""
        return "" if host == self._own else host

    def in_som(self, host: str) -> str:
        """Return the name of a computer in the SOM; empty: it has none."""
        return host or self._own

    def of(self, host: str) -> Computer:
        """Return what is known of a computer, by its name here or in the SOM."""
        return self._known.get(self.name(host), UNKNOWN)

    def lost(self, host: str) -> str:
        """Return why a computer counts as lost; empty: it does not."""
        return self.of(host).detail

    def reachable(self, host: str) -> bool:
        """Tell that what is said to a computer is heard there."""
        return host == "" or (host in self._known and not self.lost(host))

    def counts(self, host: str, time: float) -> bool:
        """Tell that substitutes may be placed on a computer."""
        computer = self.of(host)
        settled = computer.heard > computer.doubted and time >= computer.counts
        return host == "" or (settled and not computer.detail)

    def doubt(self, host: str, time: float) -> None:
        """Somebody on a computer fell silent: it does not count until it is heard again."""
        if host in self._known:
            self._known[host].doubted = time

    def doubted(self, host: str, time: float) -> bool:
        """Tell that somebody on a computer fell silent since it was heard, or that it was lost."""
        computer = self.of(host)
        if computer.heard == -inf:
            return False
        back = computer.losses > 0 and time <= computer.steady + CERTAIN_S
        return back or computer.doubted >= computer.heard

    def strained(self, host: str) -> bool:
        """Tell that a computer has too much to do, by what it has told last."""
        computer = self.of(host)
        return computer.busy >= STRAINED * computer.cores > 0.0

    def seen(self, time: float, host: str, busy: float, cores: float, link: float = 0.0) -> None:
        """Note that a computer is there; it is steady from now on if it was cut off before."""
        host = self.name(host)
        computer = self._known.setdefault(host, Computer())
        if computer.detail:
            computer.counts = time + self._hold_off(computer.losses - 1)
        if computer.detail or time - computer.heard > CERTAIN_S:
            computer.steady = time
            self.settling.set(host, max(computer.counts, time + CERTAIN_S))
        computer.heard, computer.busy, computer.cores, computer.link = time, busy, cores, link
        computer.detail = ""

    def lose(self, host: str, time: float, why: str) -> bool:
        """Note that a computer is not heard any more. Returns that this is new."""
        host = self.name(host)
        computer = self._known.setdefault(host, Computer(steady=time))
        if host == "" or computer.detail:
            return False
        calm = time - computer.steady > self._calm
        computer.losses = 1 if calm else computer.losses + 1
        computer.detail = why or "nothing is heard of it"
        self.settling.set(host, None)
        return True


@dataclass(frozen=True)
class Place:
    """A computer, empty: the reconfigurator's own; `passed_over`: who had no room, with the sum."""

    host: str = ""
    passed_over: Tuple[str, ...] = ()

    @property
    def words(self) -> str:
        """Return where a substitute runs and why not elsewhere; empty: nothing is to be said."""
        said = f" It runs on {self.host}." if self.host else ""
        if self.passed_over:
            said = said or f" It runs on {OWN}."
            said += "".join(f" {each}." for each in self.passed_over)
        return said


HERE = Place()


class Placement:
    """Chooses the computer of a substitute.

    Never one that the service forbids, or that is not heard. Rather one that it prefers, in order;
    else the one beside its inputs: whose services give the most bytes/s of them, and of equal ones
    the one with the smallest share of its cores busy; else the reconfigurator's own. Each input
    that crosses a link is late by it and lost with it; load is no harm as long as there is room.
    Where nobody has room, only the limits that the SOM says are kept.

    `lately`: what was placed on a computer since a moment, which its load does not show yet.
    """

    def __init__(
        self,
        computers: Computers,
        lately: Callable[[str, float], Iterable[Cost]],
        som: Callable[[], Som],
    ) -> None:
        self._computers, self._lately, self._som = computers, lately, som

    def place(
        self,
        time: float,
        service: Service,
        inputs: List[Service],
        ready: str = "",
        idle: Collection[str] = (),
    ) -> Place:
        """Return the computer for a substitute that reads `inputs`, services that differ.

        Rather one where an idle process can be set to work: `idle` are those, and `ready` is the
        one on which they have prepared for this service. They need not have room now: any other
        process has to start first. Raises ShsaError if there is no computer.
        """
        if not self._som().hosts:
            return HERE
        passed_over: List[str] = []
        order = self._order(time, service, inputs)
        why_not = lambda host, said: self._no_room(host, inputs, service, said)
        for host in sorted(order, key=lambda each: each != ready):
            if host in idle and not why_not(host, True):
                return Place(host)
        for host in order:
            why = why_not(host, False)
            if not why:
                return Place(host, tuple(passed_over))
            passed_over.append(f"{host or OWN} has no room: {why}")
        for host in order:
            if not why_not(host, True):
                return Place(host, tuple(passed_over))
        reasons = "; ".join(passed_over) or self._none_there(time, service)
        raise ShsaError(f"no computer can run the substitute: {reasons}")

    def stands_by(self, time: float, service: Service, inputs: List[Service]) -> str:
        """Return the computer where a process is to stand by for a plan; empty: our own.

        The first that the limits of the SOM allow: what is busy for a while moves no process.
        """
        order = self._order(time, service, inputs) if self._som().hosts else []
        fit = (host for host in order if not self._no_room(host, inputs, service, True))
        return next(fit, "")

    def allowed(self, service: Service, host: str) -> bool:
        """Tell that a substitute of a service may be on a computer, as the SOM is now."""
        hosts = [self._computers.name(each) for each in self._som().hosts]
        forbidden = [self._computers.name(each) for each in service.placement.forbid]
        return host not in forbidden and (host == "" or host in hosts)

    def _order(self, time: float, service: Service, inputs: List[Service]) -> List[str]:
        """Return the computers that may be used, best first."""
        computers = self._computers
        names = dict.fromkeys(("", *map(computers.name, self._som().hosts)))
        there = [each for each in names if computers.counts(each, time)]
        preferred = [computers.name(each) for each in service.placement.prefer]
        near: Dict[str, float] = {}
        for source in inputs:
            host = computers.name(source.host)
            near[host] = near.get(host, 0.0) + traffic(source)

        def rank(host: str) -> Tuple[int, float, bool, float, str]:
            place = preferred.index(host) if host in preferred else len(preferred)
            beside = near.get(host, 0.0)
            busy = computers.of(host).busy / (self._cores(host) or inf)
            return place, -beside, host != "" and not beside, busy, host

        return sorted((each for each in there if self.allowed(service, each)), key=rank)

    def inputs(self, plan: Plan) -> List[Service]:
        """Return the services that a plan reads, each once, where they are as the SOM is now."""
        services = self._som().services
        named = {each.service.name: each.service for each in plan.inputs}
        return [services.get(name, each) for name, each in named.items()]

    def _said(self, host: str) -> Host:
        return self._som().hosts.get(self._computers.in_som(host), Host(host))

    def _cores(self, host: str) -> Optional[float]:
        """Return the cores of a computer, as the SOM says or else it itself; None: not known."""
        said = self._said(host).cores
        return self._computers.of(host).cores or None if said is None else said

    def _no_room(self, host: str, inputs: List[Service], service: Service, said: bool) -> str:
        """Return why a substitute does not fit, `said`: by the SOM's limits; empty: it does."""
        computer, limits = self._computers.of(host), self._said(host)
        if computer.heard == -inf:
            return ""
        takes = cost(inputs, service, {host, self._computers.in_som(host)})
        lately = list(self._lately(host, computer.heard))
        cores, link = sum(each.cores for each in lately), sum(each.link for each in lately)
        most = limits.cores if said else self._cores(host)
        for what, limit, busy, more, needed in (
            ("cores", most, computer.busy, cores, takes.cores),
            ("bytes/s", limits.link, computer.link, link, takes.link),
        ):
            total = busy + more + needed
            if limit is not None and total > limit:
                placed = f" + {more:.4g} placed lately" if lately else ""
                sums = f"{busy:.4g} busy{placed} + {needed:.4g} for it = {total:.4g} {what}"
                return f"{sums} of {limit:.4g}"
        return ""

    def _none_there(self, time: float, service: Service) -> str:
        reasons = []
        for name in self._som().hosts:
            host = self._computers.name(name)
            if not self.allowed(service, host):
                reasons.append(f"{name} is forbidden")
            elif not self._computers.counts(host, time):
                reasons.append(f"{name} is {self._computers.lost(host) or 'not heard'}")
        return "; ".join(reasons)
