"""The reconfigurator's ROS shell: brings events to the core, and carries out its commands."""
import argparse
import os
import queue
import sys
import threading
from typing import Any, Callable, Dict, List, Optional, Tuple

import psutil
import rosgraph
import rospy
from shsa_msgs import msg

from shsa_core import dispatch
from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.parameters import read_settings
from shsa_core.files.som_file import load_som
from shsa_core.healing import events
from shsa_core.healing.events import Event, Level
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import Settings
from shsa_core.journal.writer import JournalWriter
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.ros.graph import clock
from shsa_core.ros.graph.fence import Fence
from shsa_core.ros.graph.launch import Launch
from shsa_core.ros.graph.processes import Processes, run_command
from shsa_core.ros.graph.restarts import Restarts
from shsa_core.ros.graph.som_parameter import SomWatch, put_som
from shsa_core.ros.graph.tables import TablePublisher, TableSubscriber
from shsa_core.ros.incidents import Incidents
from shsa_core.ros.node import run
from shsa_core.ros.services import Services
from shsa_core.ros.wire import healing as wire
from shsa_core.ros.wire import names
from shsa_core.ros.wire.rows import substitution_message

LOG: Dict[Level, Callable[..., None]] = {
    Level.INFO: rospy.loginfo,
    Level.WARN: rospy.logwarn,
    Level.ERROR: rospy.logerr,
}
LONGEST_WAIT_S = 0.2


class ReconfiguratorNode:
    """Hears failures and health, and makes the graph do what the core commands.

    Parameters: those of shsa_core.healing.settings. Raises ModelError if a file is not valid.
    """

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._files = arguments
        ontology, som = read_models(arguments.ontology, arguments.som)
        settings, errors = read_settings(Settings, rospy.get_param("~", {}), rospy.get_name())
        for error in errors:
            rospy.logerr("Refused: %s. The default is used.", error)
        setup = {
            "ontology": ontology,
            "som": som,
            "settings": settings,
            "namespace": rospy.get_namespace(),
        }
        self._core = Reconfigurator(**setup)
        self._journal: Optional[JournalWriter] = None
        if arguments.journal:
            self._journal = JournalWriter(arguments.journal, "healing", setup, rospy.logwarn)
        self._queue: "queue.Queue[Callable[[], object]]" = queue.Queue()
        self._launch = Launch()
        self._ends = False
        self._fence = Fence(rospy.get_name())
        self._processes = Processes(
            lambda node, detail: self._put(events.ProcessExited(clock.now(), node, detail)),
            self._fence.clear,
            _substitute_journals(arguments.journal),
        )
        self._restarts = Restarts(lambda node: self._put(events.StarterEnded(clock.now(), node)))
        self._incidents = Incidents(arguments.incident_log)
        self._substitutions = TablePublisher(
            names.SUBSTITUTIONS,
            msg.Substitutions,
            "substitutions",
            lambda row: row.node or row.service,
        )
        self._som_state = TablePublisher(
            names.SOM_STATE, msg.SomState, "services", lambda row: row.service
        )
        self._carry_out: dispatch.Table[object] = dispatch.table(
            events.Command,
            {
                events.LearnNode: self._in_thread(self._learn),
                events.FindNode: self._in_thread(self._find),
                events.AskToLeave: self._in_thread(self._ask_to_leave),
                events.EndProcess: self._in_thread(self._end_process),
                events.ClearNode: self._in_thread(lambda c: self._fence.clear(c.node)),
                events.StartSubstitute: self._start,
                events.AssignSubstitute: self._assigned,
                events.StopSubstitute: self._awaited(lambda c: self._processes.stop(c.node)),
                events.RestartNode: self._restart,
                events.StopNode: self._awaited(lambda c: self._restarts.stop(c.node)),
                events.RunCommand: self._run_command,
                events.ShowSubstitutions: self._show_substitutions,
                events.ShowSom: self._show_som,
                events.ShowIncident: lambda command: self._incidents.show(command.incident),
                events.Log: lambda command: LOG[command.level]("%s", command.text),
            },
        )
        self._endings: List[threading.Thread] = []
        self._decided = clock.now()
        put_som(som)
        self._som_watch = SomWatch(som, lambda s: self._put(events.SomChanged(clock.now(), s)))
        rospy.Subscriber(names.FAILURES, msg.Failure, self._failure, tcp_nodelay=True)
        TableSubscriber(names.HEALTH, msg.Health, self._health)
        self._services = Services(
            self._core, self._queue.put, self._put, self._incidents, self.reload
        )

    def spin(self) -> None:
        """Handle events in order until ROS shuts down; then stop every substitute."""
        # First of all: no substitute may take the name of one that was left behind.
        self._handle(events.Started(clock.now(), _leftovers(self._core.prefix)))
        needed = ", ".join(service.topic for service in self._core.needed())
        rospy.loginfo("Reconfigurator ready, healing: %s.", needed or "nothing")
        while not rospy.is_shutdown():
            work = self._next()
            try:
                work()
            except Exception as error:  # whatever it is, healing goes on
                if not rospy.core.is_shutdown_requested():
                    rospy.logerr("The reconfigurator could not handle an event: %r", error)
        for node in self._restarts.left_alone():
            self._handle(events.StarterEnded(clock.now(), node))
        self._handle(events.ShuttingDown(clock.now()))
        for thread in self._endings:
            thread.join()
        self._incidents.close()
        if self._journal is not None:
            self._journal.close()

    def reload(self) -> str:
        """Read ontology and SOM again; what was read. Raises ModelError, with every error."""
        ontology, som = read_models(self._files.ontology, self._files.som)
        self._som_watch.replace(som)
        put_som(som)
        self._put(events.ModelsReloaded(clock.now(), ontology, som))
        relations = len({function.relation for function in ontology.functions})
        return f"{relations} relations and {len(som)} services were read"

    def _next(self) -> Callable[[], object]:
        """What to do next: an event, else a plan ahead, else to let time pass."""
        try:
            return self._queue.get_nowait()
        except queue.Empty:
            if self._core.plans_ahead:
                return lambda: self._handle(events.Idle(clock.now()))
        deadline = self._core.deadline
        wait = LONGEST_WAIT_S if deadline is None else deadline - clock.now()
        try:
            return self._queue.get(timeout=min(LONGEST_WAIT_S, max(0.0, wait)))
        except queue.Empty:
            return lambda: self._handle(events.Tick(clock.now()))

    def _put(self, event: Event) -> None:
        self._queue.put(lambda: self._handle(event))

    def _handle(self, event: Event) -> None:
        if not self._ends and self._launch.ending():
            self._ends = True
            self._decide(events.LaunchEnding(event.time))
        self._decide(event)

    def _decide(self, event: Event) -> None:
        if self._journal is not None:
            self._journal.record(event)
        commands = self._core.handle(event)
        self._decided = clock.now()
        if self._journal is not None:
            self._journal.answered(commands)
        for command in commands:
            self._carry_out[type(command)](command)

    def _in_thread(self, work: Callable[[Any], object]) -> Callable[[Any], None]:
        """Work that waits for others must not hold the events up."""

        def start(command: Any) -> None:
            threading.Thread(target=work, args=(command,), daemon=True).start()

        return start

    def _awaited(self, work: Callable[[Any], object]) -> Callable[[Any], None]:
        """The same, and we do not end before it is done."""

        def start(command: Any) -> None:
            thread = threading.Thread(target=work, args=(command,), daemon=True)
            thread.start()
            self._endings = [each for each in self._endings if each.is_alive()] + [thread]

        return start

    def _learn(self, command: events.LearnNode) -> None:
        known = self._fence.learn(command.node)
        if known is not None and known.process is not None:
            self._restarts.learn(command.node, known.process)
        self._put(events.NodeLearned(clock.now(), command.node, known is not None))

    def _find(self, command: events.FindNode) -> None:
        where = self._fence.find(command.node, command.successor)
        self._put(events.NodeFound(clock.now(), command.node, where))

    def _ask_to_leave(self, command: events.AskToLeave) -> None:
        self._fence.ask_to_leave(command.node, lambda: self._left(command.node))

    def _end_process(self, command: events.EndProcess) -> None:
        try:
            self._fence.end_process(command.node, lambda: self._left(command.node))
        except psutil.AccessDenied:
            self._put(events.ProcessUntouchable(clock.now(), command.node))

    def _left(self, node: str) -> None:
        self._put(events.NodeLeft(clock.now(), node))

    def _start(self, command: events.StartSubstitute) -> None:
        try:
            self._processes.start(command)
        except OSError as error:
            self._put(events.ProcessExited(clock.now(), command.node, str(error)))
            return
        self._put(events.SubstituteStarted(clock.now(), command.node, self._decided))

    def _assigned(self, command: events.AssignSubstitute) -> None:
        self._put(events.SubstituteStarted(clock.now(), command.node, self._decided))

    def _restart(self, command: events.RestartNode) -> None:
        try:
            with_us = self._restarts.start(command.node)
        except (ShsaError, OSError) as error:
            self._put(events.RestartFailed(clock.now(), command.node, str(error)))
            return
        self._put(events.NodeRestarted(clock.now(), command.node, with_us))

    def _run_command(self, command: events.RunCommand) -> None:
        program = command.words[0]
        rospy.logwarn("%s: running %s.", command.service, program)

        def report(detail: str) -> None:
            rospy.logwarn("%s: %s has ended: %s.", command.service, program, detail)

        run_command(command.words, report)

    def _show_substitutions(self, command: events.ShowSubstitutions) -> None:
        self._substitutions.update(map(substitution_message, command.rows), command.removed)

    def _show_som(self, command: events.ShowSom) -> None:
        self._som_state.update(map(wire.service_state, command.rows), command.removed)

    def _failure(self, message: msg.Failure) -> None:
        try:
            self._put(wire.failure_seen(message))
        except ShsaError as error:
            rospy.logerr("Refused a message on %s: %s.", names.FAILURES, error)

    def _health(self, message: msg.Health) -> None:
        try:
            self._put(wire.health_seen(message))
        except ShsaError as error:
            rospy.logerr("Refused a message on %s: %s.", names.HEALTH, error)


def read_models(ontology: str, som: str) -> Tuple[Ontology, Som]:
    """The ontology and the SOM in two files. Raises ModelError that names every error in them."""
    read_ontology, errors = load_ontology(ontology)
    read_som, som_errors = load_som(som)
    errors = [*errors, *som_errors]
    if errors:
        raise ModelError(errors[0].where, "; ".join([errors[0].what, *map(str, errors[1:])]))
    return read_ontology, read_som


def _substitute_journals(journal: str) -> str:
    """What the journals of the substitutes begin with, beside the reconfigurator's own."""
    return os.path.splitext(journal)[0] + ".substitute_" if journal else ""


def _leftovers(prefix: str) -> Tuple[str, ...]:
    """The substitutes that a former reconfigurator left behind."""
    publishers, _, _ = rosgraph.Master(rospy.get_name()).getSystemState()
    nodes = {node for _, names_ in publishers for node in names_}
    return tuple(sorted(node for node in nodes if node.startswith(prefix)))


def main() -> None:
    """Run the reconfigurator node."""
    parser = argparse.ArgumentParser(prog="reconfigurator", description=main.__doc__)
    parser.add_argument("--ontology", required=True, help="the ontology file")
    parser.add_argument("--som", required=True, help="the service-to-ontology mapping file")
    parser.add_argument("--incident-log", default="", help="a file for one JSON line an incident")
    parser.add_argument("--journal", default="", help="a file for every event, to be replayed")
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    run("reconfigurator", lambda: ReconfiguratorNode(arguments).spin())
