"""What the monitors tell: failures and health, and what follows where one is lost.

A monitor of one computer is lost with it. Nobody tells then of what only it watched, and nobody
says so: the monitor is asked for its whole table, and if that does not come, those that it watched
count as silent. When the computer is back, it is asked again: what did not change it never tells.
"""
from typing import Any, Dict, Iterable, List, Optional, Tuple

from shsa_core.agenda import Agenda
from shsa_core.healing.events import (
    AskMonitor,
    Command,
    FailureSeen,
    HealthSeen,
    Level,
    Log,
)
from shsa_core.healing.host_events import HostLost, HostSeen
from shsa_core.healing.reach import Reach
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Service
from shsa_core.monitoring.events import PublisherState

TRIGGER_S = 0.1
"""So long after the table a trigger may come: they travel on two connections."""
ANSWER_S = 0.5
"""So long a monitor may take to tell its whole table, when its computer seems lost."""


class Hearing(Reach):
    """Keeps up how everybody does, and has the services decide whom that concerns."""

    def __init__(self, *told: Any) -> None:
        super().__init__(*told)
        self._ending = self._over = False
        self._untold: Agenda[str] = Agenda()  # failures in the table, by their service
        self._asked: Agenda[str] = Agenda()  # computers whose monitor owes its table

    def _failure_seen(self, event: FailureSeen) -> List[Command]:
        if self._ending:
            return []
        service = self._service_of(event)
        if service is None or self._is_old_substitute(event.publisher, service.name):
            return []
        if event.kind is Kind.NO_VALUE and event.publisher not in self._concern.by_process:
            return []  # only a substitute of ours can tell that of itself
        if not event.detail:
            who = event.publisher or "nobody"
            text = f"{event.topic}: a failure of {who} is told without saying what was seen."
            return [Log(Level.WARN, f"{text} Nothing is healed without evidence.")]
        if not service.needed:
            why = event.detail.rstrip(".")
            text = f"{event.topic} failed: {why}. It is not marked `needed`, ignored."
            return [Log(Level.WARN, text)]
        # Whoever is asked about does well, and so does a substitute that tells of its law.
        if event.kind not in (Kind.REQUESTED, Kind.NO_VALUE):
            self._doubt(service, event)
            self._nodes.note(event)
            self._note_health(event.topic, event.publisher)
        self._unsettle([service.name, *self._concerned(event.topic, event.publisher)])
        return self._ask(service.name, lambda healing, now: healing.failed(now, event))

    def _service_of(self, event: FailureSeen) -> Optional[Service]:
        if event.service:
            return self._som.services.get(event.service)
        for name in self._substituted(event.topic, event.publisher)[:1]:
            return self._som.services.get(name)
        return self._som.service_of(event.topic, event.publisher)

    def _is_old_substitute(self, publisher: str, service: str) -> bool:
        known = publisher in self._nodes.substitutes
        return known and service not in self._concern.served(publisher)

    def _substituted(self, topic: str, process: str) -> List[str]:
        """The services of a topic that the substitutes in a process work for.

        One that is nobody else's may have advertised other topics before it was set to work.
        """
        served = self._concern.served(process)
        if len(served) == 1:
            return list(served)
        return [name for name in served if self._som.services[name].topic == topic]

    def _health_seen(self, event: HealthSeen) -> List[Command]:
        if event.whole:
            self._asked.set(self._hosts.name(event.host), None)
        return self._health_changed(event.time, self._nodes.heed(event))

    def _host_seen(self, event: HostSeen) -> List[Command]:
        host = self._hosts.name(event.host)
        lost = bool(self._hosts.lost(host))
        commands = super()._host_seen(event)
        return commands + self._ask_monitor(host) if lost else commands

    def _host_lost(self, event: HostLost) -> List[Command]:
        host = self._hosts.name(event.host)
        lost = bool(self._hosts.lost(host))
        commands = super()._host_lost(event)
        if lost or not self._hosts.lost(host):
            return commands
        asked = self._ask_monitor(host)
        if asked:
            self._asked.set(host, event.time + ANSWER_S)
        return commands + asked

    def _ask_monitor(self, host: str) -> List[Command]:
        self._asked.set(host, None)
        in_som = self._hosts.in_som(host)
        return [AskMonitor(in_som)] if self._nodes.has_monitor(in_som) else []

    def _monitors_lost(self, time: float) -> List[Command]:
        """Monitors that were asked have not answered: nobody tells of what they watched."""
        commands: List[Command] = []
        for host in self._asked.pop_due(time):
            why = f"{host} is lost, and its monitor: {self._hosts.lost(host).rstrip('.')}"
            processes = self._concern.by_process
            elsewhere = [node for node in processes if self._where.host_of(node) != host]
            changed = self._nodes.lose_monitor(time, host, why, elsewhere)
            commands += self._silent(time, changed)
            for name in list(self._where.working_on(host)):  # who was heard so far is not now
                commands += self._ask(name, lambda healing, now: healing.host_lost(now, why))
        return commands

    def _silent(self, time: float, keys: Iterable[Tuple[str, str]]) -> List[Command]:
        """Some count as silent, and no trigger will come."""
        commands = self._health_changed(time, keys)
        for name in dict.fromkeys(name for key in keys for name in self._concerned(*key)):
            missed = self._missed_failure(time, name)
            commands += [] if missed is None else self._failure_seen(missed)
        return commands

    def _health_changed(self, time: float, keys: Iterable[Tuple[str, str]]) -> List[Command]:
        """Tell whom the health of some publishers of topics concerns."""
        commands: List[Command] = []
        concerned: Dict[str, None] = {}
        judged: Dict[str, None] = {}
        for topic, publisher in keys:
            row = self._nodes.health(topic).get(publisher)
            self._note_health(topic, publisher)
            if publisher in self._concern.by_process:
                concerned.update(dict.fromkeys(self._substituted(topic, publisher)))
            elif publisher not in self._nodes.substitutes:
                services = self._concerned(topic, publisher)
                concerned.update(dict.fromkeys(services))
                self._unsettle(services)
                blaming = self._concern.blaming(publisher)
                judged.update(dict.fromkeys(name for name in blaming if name in self._concern.kept))
                commands += self._acquaint(publisher, row)
        for name in concerned:
            self._expect_trigger(time, name)
            commands += self._ask(name, lambda healing, now: healing.changed(now))
        for name in judged:
            commands += self._ask(name, lambda healing, now: healing.reconsider(now))
        return commands

    def _expect_trigger(self, time: float, name: str) -> None:
        """A trigger tells more than the table, and may come a moment after it."""
        if self._missed_failure(time, name) is None:
            self._untold.set(name, None)
        else:
            self._untold.bring_forward(name, time + TRIGGER_S)

    def _missed_failure(self, time: float, name: str) -> Optional[FailureSeen]:
        """The failure that the table tells of, and no trigger, as when we start late."""
        service = self._som.services.get(name)
        if self._ending or service is None or not service.needed or self._open(name):
            return None
        rows = self._rows(service)
        if any(row.state is PublisherState.HEALTHY for row in rows):
            return None
        for row in rows:
            excluded = row.publisher in self._nodes.excluded or row.publisher in self._kills.nodes
            if row.state is PublisherState.FAILED and not excluded:
                kind = row.kind or Kind.OTHER
                detail = row.detail or f"the monitor's table says {kind}"
                return FailureSeen(
                    time, name, row.topic, row.publisher, kind, detail, row.last_good
                )
        return None
