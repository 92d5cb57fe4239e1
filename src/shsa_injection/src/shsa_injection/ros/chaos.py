"""Chaos: makes the faults of a schedule one step after the other, and judges after each."""
import itertools
import os
import threading
import time
from contextlib import suppress
from dataclasses import asdict, dataclass
from typing import Dict, FrozenSet, List, Optional, Sequence, Tuple

import psutil
import rospy
from shsa_msgs.srv import Release

from shsa_core.model.names import full_name
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.ros.wire import names
from shsa_injection import findings, invariants, schedule
from shsa_injection.errors import Refused
from shsa_injection.invariants import Limits, Seen, Violation
from shsa_injection.ros import healers, targets
from shsa_injection.ros.injections import Injection, start_again
from shsa_injection.ros.injector import Injector
from shsa_injection.ros.observer import Observer, last_heard
from shsa_injection.ros.targets import Start
from shsa_injection.schedule import MASTER, Planned, Step
from shsa_injection.trace import Trace
from shsa_injection.vocabulary import FAULTS

SETTLE_S = 60.0
POLL_S = 0.2
START_S = 10.0
"""So long a node that was started again has to come up, before that is tried once more."""
QUIET_S = 1.0
"""So long the system must have been settled."""
HEALER_FAULTS = ("crash", "hang")


@dataclass(frozen=True)
class Extent:
    """The targets of chaos, and its length: `seconds` and `steps`, None: no limit."""

    seconds: Optional[float] = None
    steps: Optional[int] = None
    healers: bool = False
    master: bool = False
    only: Tuple[str, ...] = ()
    keep_going: bool = False


class Chaos:
    """A run of chaos. It needs rospy to be initialised."""

    def __init__(self, som: Som, namespace: str, seed: int, extent: Extent, trace: Trace) -> None:
        self._som, self._namespace, self._seed = som, namespace, seed
        self._extent, self._trace = extent, trace
        self._injector = Injector(som)
        self._observer = Observer(som, namespace, trace.write)
        self._services: Dict[str, Service] = {each.name: each for each in som}
        self._starts: Dict[str, Start] = {}
        self._processes: Dict[str, psutil.Process] = {}
        self._tried: Dict[str, float] = {}
        self.violations: List[Violation] = []
        self.steps = 0

    def run(self) -> bool:
        """Go on until the extent is reached; whether everything held.

        Raises Refused if the system does not settle at the beginning.
        """
        self._learn()
        deck = self._deck()
        possible = [f"{card.target} {card.fault}" for card in deck]
        self._trace.write("begin", seed=self._seed, extent=asdict(self._extent), possible=possible)
        left = self._settle()
        if left:
            raise Refused(
                "the system is not settled before the first fault: " + "; ".join(map(_text, left))
            )
        try:
            self._steps(deck, self._observer.seen())
        finally:
            self._bring_back()
        self._trace.write("end", steps=self.steps, violations=len(self.violations))
        return not self.violations

    def _steps(self, deck: Sequence[schedule.Card], first: Seen) -> None:
        start = time.monotonic()
        for step in itertools.islice(schedule.schedule(self._seed, deck), self._extent.steps):
            if self._extent.seconds is not None:
                if time.monotonic() - start > self._extent.seconds:
                    break
            found = self._step(step, first)
            self.steps += 1
            self.violations += found
            if found and not self._extent.keep_going:
                break

    def _learn(self) -> None:
        """Remember how every node was started: healing kills those that fail."""
        for service in self._som:
            with suppress(Refused):
                process = targets.find(service).process
                self._starts[service.node] = targets.start_of(process)
                self._processes[service.node] = process

    def _deck(self) -> List[schedule.Card]:
        possible: Dict[str, Sequence[str]] = {}
        nodes: Dict[str, str] = {}
        for service in self._som:
            if service.period is None or service.node not in self._starts:
                continue
            nodes[service.name] = service.node
            possible[service.name] = self._allowed(self._injector.possible(service))
        if self._extent.healers:
            for name in healers.HEALERS:
                possible["/" + name], nodes["/" + name] = self._allowed(HEALER_FAULTS), "/" + name
        if self._extent.master:
            possible[MASTER], nodes[MASTER] = self._allowed(["master_restart"]), MASTER
        deck = schedule.cards(possible, nodes)
        if not deck:
            raise Refused("no node of the SOM can be made to fail here")
        return deck

    def _allowed(self, words: Sequence[str]) -> List[str]:
        return [word for word in words if not self._extent.only or word in self._extent.only]

    def _step(self, step: Step, first: Seen) -> List[Violation]:
        """Make the faults of a step, take them back, and judge."""
        before = self._observer.seen()
        since = time.monotonic()
        found: List[Violation] = []
        lock = threading.Lock()

        def make(planned: Planned) -> None:
            violations = self._make(step, planned)
            with lock:
                found.extend(violations)

        threads = [threading.Thread(target=make, args=(each,)) for each in step.faults]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        found += self._judge(step, before, since)
        self._bring_back()
        found += self._settle()
        after = self._observer.seen()
        found += self._judge(step, before, since, after)
        found += invariants.grown(first, after, Limits())
        found = list(dict.fromkeys(found))
        for each in found:
            self._trace.write("violation", step=step.number, **asdict(each))
        self._trace.write(
            "step",
            number=step.number,
            held=not found,
            load=round(os.getloadavg()[0], 1),
            heard=last_heard(after, self._observer.topics),
        )
        self._observer.forget()
        return found

    def _make(self, step: Step, planned: Planned) -> List[Violation]:
        """One fault, from its beginning to its end."""
        time.sleep(planned.after)
        about = {"step": step.number, **asdict(planned)}
        try:
            with self._injection(planned) as injection:
                details = {"node": injection.node, "pid": injection.pid, "detail": injection.detail}
                self._trace.write("fault", **about, **details)
                injection.wait()
                seen = self._observer.seen()
            self._trace.write("taken_back", **about, told=injection.told)
        except Refused as why:
            self._trace.write("refused", **about, why=str(why))
            return []
        service = self._services.get(planned.target)
        if service is None:
            return []
        found: List[Violation] = []
        if all(each.target in self._services for each in step.faults):  # healing itself is well
            found += self._not_found(planned, service, injection, seen.now)
        if FAULTS[planned.fault].innocent:
            return found
        failed = {service.topic: injection.began}
        return found + invariants.unanswered(self._observer.topics, seen, failed)

    def _not_found(
        self, planned: Planned, service: Service, injection: Injection, now: float
    ) -> List[Violation]:
        deadline = next(t.deadline for t in self._observer.topics if t.name == service.topic)
        told = self._observer.failures(injection.began)
        return findings.not_found(planned.fault, service, deadline, injection.began, now, told)

    def _injection(self, planned: Planned) -> Injection:
        if planned.target == MASTER:
            return self._injector.restart_master(planned.seconds)
        service = self._services.get(planned.target)
        if service is None:
            return self._injector.harm_healer(planned.target[1:], planned.fault, planned.seconds)
        return self._injector.inject(
            service.topic, planned.fault, planned.seconds, planned.seed, service.node
        )

    def _judge(
        self, step: Step, before: Seen, since: float, after: Optional[Seen] = None
    ) -> List[Violation]:
        faulty, doubled = self._concerned(step)
        return invariants.during(
            self._observer.topics, before, after or self._observer.seen(), since, faulty, doubled
        )

    def _concerned(self, step: Step) -> Tuple[FrozenSet[str], FrozenSet[str]]:
        """Return the nodes that a step makes fail, and the topics with a foreign publisher."""
        faulty, doubled = set(), set()
        for each in step.faults:
            service = self._services.get(each.target)
            if service is None:
                continue
            if not FAULTS[each.fault].innocent:
                faulty.add(service.node)
            elif each.fault != "hung_subscriber":
                doubled.add(service.topic)
        return frozenset(faulty), frozenset(doubled)

    def _bring_back(self) -> None:
        """Start the nodes again that have ended, as their launch would."""
        for node, start in self._starts.items():
            if targets.lives(self._processes[node]):
                continue
            service = next(each for each in self._som if each.node == node)
            with suppress(Refused):
                self._processes[node] = targets.find(service).process
                self._tried.pop(node, None)
                continue
            if time.monotonic() < self._tried.get(node, 0.0) + START_S:
                continue
            self._tried[node] = time.monotonic()
            try:
                self._trace.write("started_again", node=node, pid=start_again(start))
            except Refused as why:
                self._trace.write("not_started_again", node=node, why=str(why))

    def _settle(self) -> List[Violation]:
        """Wait until everything is as before the faults; what is not, at the deadline."""
        deadline = time.monotonic() + SETTLE_S
        quiet: Optional[float] = None
        told: List[str] = []
        while True:
            seen = self._observer.seen(nodes=False)
            left = invariants.unsettled(self._observer.topics, seen)
            if not left:
                quiet = seen.now if quiet is None else quiet
                if seen.now - quiet >= QUIET_S:
                    return []
            else:
                quiet = None
                waits = [f"{each.rule}: {each.about}" for each in left]
                if waits != told:
                    self._trace.write("waits", seconds=SETTLE_S, unsettled=waits)
                    told = waits
                self._release(seen)
                if seen.now > deadline:
                    return left
                self._bring_back()
            time.sleep(POLL_S)

    def _release(self, seen: Seen) -> None:
        """Let nodes back that are kept out, as an operator would."""
        for case in invariants.newest(seen.cases).values():
            if case.kept_out and case.state != "ended":
                self._trace.write("released", topic=case.topic)
                release = rospy.ServiceProxy(full_name(names.RELEASE, self._namespace), Release)
                with suppress(rospy.ServiceException):
                    release(case.topic)


def _text(violation: Violation) -> str:
    return f"{violation.rule}: {violation.about}: {violation.seen}"
