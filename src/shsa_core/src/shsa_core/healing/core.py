"""Has services decide, and keeps up what follows from their answers.

What an event does not concern stays as it is: a decision costs the same on a large robot.
"""
from typing import Callable, Dict, Iterable, List, Optional

from shsa_core.agenda import Agenda
from shsa_core.healing import events
from shsa_core.healing.events import Command
from shsa_core.healing.incident import WELL, Incident
from shsa_core.healing.kill import KillOver
from shsa_core.healing.node import Nodes
from shsa_core.healing.process import Processes
from shsa_core.healing.records import ServiceRecord
from shsa_core.healing.robot import Robot
from shsa_core.healing.service import ServiceMachine
from shsa_core.healing.transitions import TRANSITIONS
from shsa_core.model.service import Service
from shsa_core.model.substitution import row_key

Ask = Callable[[ServiceMachine], List[Command]]


class Core:
    """The machines of all services, nodes and processes.

    `asked`: computers whose monitor owes its table.
    """

    def __init__(self, robot: Robot) -> None:
        self.robot = robot
        self.nodes = Nodes(robot, self._kill_over)
        self.processes = Processes(robot)
        self.services: Dict[str, ServiceMachine] = {}
        self.asked: Agenda[str] = Agenda()
        self.agenda: Agenda[str] = Agenda()  # services by when their timers are due
        self._unsettled: Dict[str, None] = {}  # services whose availability may have changed
        self._ended: Dict[str, str] = {}  # records whose incident has ended, and the services

    def add(self, service: Service) -> None:
        """Heal a service from now on."""
        parts = self.robot, self.nodes, self.processes
        self.services[service.name] = ServiceMachine(service, *parts, TRANSITIONS)
        self.unsettle([service.name])

    def incident(self, service: str) -> Optional[Incident]:
        """Return the open incident of a service."""
        machine = self.services.get(service)
        return machine.incident if machine and machine.incident is not WELL else None

    def ask(self, name: str, ask: Ask) -> List[Command]:
        """Have a service decide, and keep up what follows."""
        machine, robot = self.services.get(name), self.robot
        service = robot.spec(name)
        if machine is None or service is None:
            return []
        machine.spec, before = service, machine.incident
        commands = ask(machine)
        incident, substitute = machine.incident, machine.substitute
        row, accused = machine.row(), machine.accusation
        shown = None if incident is WELL else incident
        for each in commands:
            shown = each.incident if isinstance(each, events.ShowIncident) else shown
        message = b"" if row else machine.last_message
        record = ServiceRecord(name, service.topic, shown, accused.kind, accused.fate, row, message)
        robot.indexes.follow(incident, name, substitute.plan, substitute.tried)
        self.agenda.set(name, min(machine.timers.values(), default=None))
        if row is not None:
            self.processes.wanted.set(row_key(row), row)
        if shown is not None and incident is WELL:  # it is kept until it is told, and logged
            self._ended[record.key] = name
            robot.calibrations.healed(name)
        empty = record == ServiceRecord(name, record.topic)
        robot.records.set(record.key, None if empty else record)
        if (before is WELL) != (incident is WELL):
            self.unsettle([name])
        return commands

    def ask_all(self, names: Iterable[str], ask: Ask) -> List[Command]:
        """Have some services decide."""
        return [command for name in list(names) for command in self.ask(name, ask)]

    def _kill_over(self, kill: KillOver) -> List[Command]:
        self.unsettle_node(kill.node)
        return self.ask_accusers(kill.node, lambda service: service.heed(kill))

    def ask_accusers(self, node: str, ask: Ask) -> List[Command]:
        """Have those services decide that accuse a node."""
        return self.ask_all(self.nodes.accusers(node), ask)

    def settle(self) -> List[Command]:
        """See which services come and go by what has happened, and tell those whom it concerns."""
        commands: List[Command] = []
        robot, indexes = self.robot, self.robot.indexes
        while self._unsettled:
            names, self._unsettled = self._unsettled, {}
            look = robot.availability.look
            looks = [look(robot.som, name, self.missing(name)) for name in names]
            gone = [before for before, _ in looks if before is not None]
            come = [after for _, after in looks if after is not None]
            robot.planner.plans.change(gone, come)
            readers = indexes.readers(each.name for each in gone)
            commands += self.ask_all(readers, lambda each: each.changed())
            if come:
                waiting = dict.fromkeys((*indexes.stuck, *indexes.kept))
                commands += self.ask_all(waiting, lambda each: each.replan())
        return commands

    def missing(self, name: str) -> str:
        """Return why a service is not available whoever is well; empty: it may be."""
        machine, service = self.services.get(name), self.robot.som.services.get(name)
        if machine is not None and machine.incident is not WELL:
            return "failed"
        if service is None or not service.host or not service.event_driven:
            return ""
        # No silence tells of one that is due at no time.
        lost = self.robot.computers.lost(service.host)
        return f"{service.host} is lost: {lost}" if lost else ""

    def unsettle(self, names: Iterable[str]) -> None:
        """Look again whether some services are available."""
        self._unsettled.update(dict.fromkeys(names))

    def unsettle_node(self, node: str) -> None:
        """Look again at the services that a node publishes."""
        for topic in self.robot.health.topics.get(node, ()):
            self.unsettle(self.concerned(topic, node))

    def concerned(self, topic: str, publisher: str) -> List[str]:
        """Return the services that a publisher of a topic may be of."""
        som = self.robot.som
        service = som.service_of(topic, publisher)
        return [service.name] if service else [each.name for each in som.of_topic(topic)]

    def forget_ended(self) -> None:
        """Forget the incidents that have ended with the event before: they are logged by now."""
        ended, self._ended = self._ended, {}
        for key, name in ended.items():
            self.robot.records.set(key, None)
            self.ask(name, lambda each: [])  # what else is to be known of it
