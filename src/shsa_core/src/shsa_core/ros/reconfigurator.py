"""The reconfigurator's ROS shell: brings events to the core, and carries out its commands."""
import argparse
import os
import queue
import shlex
import sys
import threading
from functools import partial
from typing import Any, Callable, Dict, List, Optional, Tuple

import psutil
import rospy
from shsa_msgs import msg

from shsa_core import dispatch
from shsa_core.analysis.budget import check_budgets
from shsa_core.errors import ModelErrors, ShsaError
from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.parameters import read_settings
from shsa_core.files.som_file import load_som
from shsa_core.files.trust import refuse_others_commands
from shsa_core.healing import events
from shsa_core.healing.events import Event, Level
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import Settings
from shsa_core.journal.record_file import RecordFile
from shsa_core.journal.writer import JournalWriter
from shsa_core.model.names import file_name
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.ros import diagnostics
from shsa_core.ros.graph import clock, kernel
from shsa_core.ros.graph.alone import await_turn
from shsa_core.ros.graph.coming_up import ComingUp
from shsa_core.ros.graph.companion import Companion
from shsa_core.ros.graph.fence import Fence, Known
from shsa_core.ros.graph.heartbeats import MONITOR, RECONFIGURATOR, Signs, Watch
from shsa_core.ros.graph.launch import Launch
from shsa_core.ros.graph.master_watch import MasterWatch
from shsa_core.ros.graph.processes import Processes, run_command
from shsa_core.ros.graph.protection import Protection
from shsa_core.ros.graph.restarts import Restarts
from shsa_core.ros.graph.signing import Signing
from shsa_core.ros.graph.som_parameter import SomWatch, put_som
from shsa_core.ros.graph.tables import TablePublisher, TableSubscriber
from shsa_core.ros.graph.usable import Problem, mark_unusable
from shsa_core.ros.graph.workers import Workers
from shsa_core.ros.incidents import Incidents
from shsa_core.ros.node import run
from shsa_core.ros.services import Services
from shsa_core.ros.succession import take_over
from shsa_core.ros.wire import healing as wire
from shsa_core.ros.wire import names
from shsa_core.ros.wire.rows import substitution_message

LOG: Dict[Level, Callable[..., None]] = {
    Level.INFO: rospy.loginfo,
    Level.WARN: rospy.logwarn,
    Level.ERROR: rospy.logerr,
}
LONGEST_WAIT_S = 0.2
MOST_WAITING = 10_000
"""With more to do than this, failures that nobody signed are dropped."""
ASKED_BY_API = "external shutdown request"
"""What rospy's reason begins with then."""
MOST_CALLS = 32
"""Of one kind of command, under way at the same time."""


class ReconfiguratorNode:
    """Hears failures and health, and makes the graph do what the core commands.

    Parameters: those of shsa_core.healing.settings. Raises ModelError if a file is not valid.
    """

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._files = arguments
        self._said: List[Problem] = []
        signing = Signing(arguments.secret)
        ontology, som = read_models(arguments.ontology, arguments.som)
        settings, errors = read_settings(Settings, rospy.get_param("~", {}), rospy.get_name())
        for error in errors:
            rospy.logerr("Refused: %s. The default is used.", error)
        setup = {
            "ontology": ontology,
            "som": self._usable(som),
            "settings": settings,
            "namespace": rospy.get_namespace(),
            "dry_run": arguments.dry_run,
            "restarts": os.geteuid() != 0 or arguments.restart_as_root,
        }
        if not setup["restarts"]:
            for service in (each for each in som if each.policy.restarts):
                text = "%s is not started again: that would be as root (restart_as_root:=true)."
                rospy.logerr(text, service.node)
        for finding in check_budgets(som, settings):
            rospy.logwarn("%s", finding)
        self._core = Reconfigurator(**setup)
        self._journal: Optional[JournalWriter] = None
        journal = arguments.journal and file_name(arguments.journal, rospy.get_namespace())
        if journal:
            self._journal = JournalWriter(journal, "healing", setup, rospy.logwarn)
        self._queue: "queue.Queue[Callable[[], object]]" = queue.Queue()
        self._launch = Launch()
        self._ends = self._is_followed = False
        rospy.core.add_preshutdown_hook(self._asked_to_end)
        self._clearing = self._workers("clear")
        self._fence = Fence()
        self._protection = Protection()
        self._processes = Processes(
            lambda node, detail: self._put(events.ProcessExited(clock.now(), node, detail)),
            lambda node: self._clearing.put(lambda: self._fence.clear(node)),
            _substitute_journals(journal),
            signing.path,
            arguments.sandbox,
        )
        self._restarts = Restarts(lambda node: self._put(events.StarterEnded(clock.now(), node)))
        self._coming_up = ComingUp(self._restarts.started_again, self._came_up)
        self._incidents = Incidents(arguments.incident_log)
        self._substitutions = TablePublisher(
            names.SUBSTITUTIONS,
            msg.Substitutions,
            "substitutions",
            lambda row: row.node or row.service,
            signing,
            opened=False,
        )
        self._som_state = TablePublisher(
            names.SOM_STATE, msg.SomState, "services", lambda row: row.service, signing, False
        )
        self._records: Optional[RecordFile] = None
        self._signs = Signs(RECONFIGURATOR)
        self._companion = Companion(MONITOR, self._signs)
        self._life = Watch(
            self._signs,
            lambda node: self._put(events.ProcessSilent(clock.now(), node)),
            lambda node: self._put(events.ProcessHung(clock.now(), node)),
            lambda node: self._put(events.ProcessHeard(clock.now(), node)),
            self._core.names.prefix,
        )
        stops = self._workers("stop")
        self._carry_out: dispatch.Table[object] = dispatch.table(
            events.Command,
            {
                events.WriteDown: self._write_down,
                events.LearnNode: self._by(self._workers("learn"), self._learn),
                events.WatchNodes: self._by(
                    self._workers("watch"), lambda c: self._coming_up.watch(c.nodes)
                ),
                events.FindNode: self._by(self._workers("find"), self._find),
                events.AskToLeave: self._by(self._workers("ask to leave"), self._ask_to_leave),
                events.EndProcess: self._by(self._workers("end process"), self._end_process),
                events.ClearNode: self._by(self._clearing, self._clear),
                events.StartSubstitute: self._start,
                events.AssignSubstitute: self._assigned,
                events.StopSubstitute: self._by(stops, self._stop, True),
                events.RestartNode: self._restart,
                events.StopNode: self._by(stops, lambda c: self._restarts.stop(c.node), True),
                events.RunCommand: self._by(self._workers("command"), self._run_command),
                events.ShowSubstitutions: self._show_substitutions,
                events.ShowSom: self._show_som,
                events.ShowIncident: lambda command: self._incidents.show(command.incident),
                events.Log: lambda command: LOG[command.level]("%s", command.text),
            },
        )
        self._endings: List[threading.Event] = []
        self._diagnostics = diagnostics.Diagnostics(
            diagnostics.healing_rows, signing.refusals, self._companion
        )
        diagnostics.every_period(lambda: self._queue.put(self._report))
        self._decided = clock.now()
        # First of all: what runs goes on, and no substitute may take a name that was used.
        prefix = self._core.names.prefix
        self._master = MasterWatch(lambda node: node.startswith(prefix), not arguments.dry_run)
        heritage = take_over(prefix, self._fence, self._processes, self._restarts)
        self._records = heritage.file
        self._decide(heritage.started)
        self._substitutions.open()
        self._som_state.open()
        put_som(som)
        self._som_watch = SomWatch(
            som, lambda s: self._put(events.SomChanged(clock.now(), self._usable(s)))
        )
        tables = (names.FAILURES, names.SUBSTITUTIONS, names.SOM_STATE)
        self._master.introduce(*map(rospy.resolve_name, tables))
        failures = signing.checked(names.FAILURES, msg.Failure, arguments.unsigned_failures)
        signing.subscribe(names.FAILURES, failures, self._failure)
        self._health_began: Dict[str, int] = {}
        for host in ("", *som.hosts):
            self._hear_monitor(host, signing)
        self._services = Services(
            self._core,
            self._queue.put,
            self._put,
            self._incidents,
            self.reload,
            not arguments.no_operator,
        )

    def spin(self) -> None:
        """Handle events in order until ROS shuts down; then stop every substitute.

        Unless another reconfigurator follows, which takes them up.
        """
        needed = ", ".join(service.topic for service in self._core.needed())
        does = "advising (nothing is killed or started) on" if self._files.dry_run else "healing"
        rospy.loginfo("Reconfigurator ready, %s: %s.", does, needed or "nothing")
        while not rospy.is_shutdown():
            self._companion.beat()
            work = self._next()
            try:
                work()
            except Exception as error:  # whatever it is, healing goes on
                if not rospy.core.is_shutdown_requested():
                    rospy.logerr("The reconfigurator could not handle an event: %r", error)
        if not self._is_followed:
            self._stop_all()
        self._incidents.close()
        if self._records is not None:
            self._records.close()
        if self._journal is not None:
            self._journal.close()

    def _stop_all(self) -> None:
        for node in self._restarts.left_alone():
            self._handle(events.StarterEnded(clock.now(), node))
        self._handle(events.ShuttingDown(clock.now()))
        for ended in self._endings:
            ended.wait()

    def _asked_to_end(self, reason: str) -> None:
        """Anybody may ask us by our API, or by taking our name; where another one follows, as a
        launch starts it, what publishes goes on.
        """
        self._is_followed = reason.startswith(ASKED_BY_API) and kernel.started_by_launch(
            psutil.Process()
        )

    def reload(self) -> str:
        """Read ontology and SOM again; what was read. Raises ModelError, with every error."""
        ontology, som = read_models(self._files.ontology, self._files.som)
        self._som_watch.replace(som)
        put_som(som)
        self._put(events.ModelsReloaded(clock.now(), ontology, self._usable(som)))
        relations = len({function.relation for function in ontology.functions})
        return f"{relations} relations and {len(som)} services were read"

    def _usable(self, som: Som) -> Som:
        """The SOM as far as it can be used here; what cannot be is said once."""
        marked, problems = mark_unusable(som)
        for problem in problems:
            if problem not in self._said:
                LOG[Level.ERROR if problem.needed else Level.WARN]("%s.", problem.text)
        self._said = problems
        return marked

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
            try:
                self._carry_out[type(command)](command)
            except Exception as error:  # whatever it is, the commands after it are carried out
                self._failed(command, error)

    def _failed(self, command: events.Command, error: Exception) -> None:
        """Say that a command could not be carried out, and answer it, so that nobody waits."""
        what = f"{type(command).__name__} {getattr(command, 'node', '')}".strip()
        why = f"{type(error).__name__}: {error}"
        rospy.logerr_throttle(10.0, f"{what} could not be carried out: {why}")
        if isinstance(command, events.LearnNode):
            self._put(events.NodeLearned(clock.now(), command.node, False))
        elif isinstance(command, events.StartSubstitute):
            self._put(events.ProcessExited(clock.now(), command.node, why))
        elif isinstance(command, events.RestartNode):
            self._put(events.RestartFailed(clock.now(), command.node, why))
        elif isinstance(error, OSError):
            return  # this computer lacks the means now; a kill without an answer is tried again
        elif isinstance(command, (events.FindNode, events.AskToLeave, events.EndProcess)):
            self._untouchable(command.node, f"it could not be looked at: {why}")

    def _workers(self, name: str) -> Workers:
        return Workers(name, MOST_CALLS, lambda text: rospy.logerr("%s", text))

    def _by(
        self, workers: Workers, work: Callable[[Any], object], awaited: bool = False
    ) -> Callable[[Any], None]:
        """Work that waits for others must not hold the events up.

        `awaited`: we do not end before it is done.
        """

        def put(command: Any) -> None:
            done = threading.Event()

            def call() -> None:
                try:
                    work(command)
                except Exception as error:  # whatever it is, the next command is carried out
                    self._failed(command, error)
                finally:
                    done.set()

            if awaited:
                self._endings = [each for each in self._endings if not each.is_set()] + [done]
            workers.put(call)

        return put

    def _learn(self, command: events.LearnNode) -> None:
        known = self._fence.learn(command.node, command.topic)
        protected = ""
        if known is not None and known.process is not None:
            self._restarts.learn(command.node, known.process)
            protected = self._protection.reason(command.node, known.process)
            for other in self._protection.sharing(command.node, known.process):
                why = self._protection.reason(other, known.process)
                self._put(events.NodeLearned(clock.now(), other, True, why))
        self._put(events.NodeLearned(clock.now(), command.node, known is not None, protected))

    def _came_up(self, node: str, process: Optional[psutil.Process]) -> None:
        if process is not None:
            self._fence.adopt(node, Known("", process))
        self._put(events.NodeCameUp(clock.now(), node))

    def _find(self, command: events.FindNode) -> None:
        found = self._fence.find(command.node, command.topic, command.successor)
        starter = self._fence.starter(command.node)
        self._put(events.NodeFound(clock.now(), command.node, *found, starter))

    def _ask_to_leave(self, command: events.AskToLeave) -> None:
        node = command.node
        failed = lambda why: self._untouchable(node, why)
        self._fence.ask_to_leave(node, lambda: self._left(node), failed)

    def _end_process(self, command: events.EndProcess) -> None:
        node = command.node
        failed = lambda why: self._untouchable(node, why)
        self._fence.end_process(node, lambda: self._left(node), failed)

    def _clear(self, command: events.ClearNode) -> None:
        if not self._fence.clear(command.node):
            self._put(events.NodeUnregistered(clock.now(), command.node))

    def _left(self, node: str) -> None:
        self._put(events.NodeLeft(clock.now(), node))

    def _untouchable(self, node: str, why: str) -> None:
        self._put(events.ProcessUntouchable(clock.now(), node, why))

    def _start(self, command: events.StartSubstitute) -> None:
        self._processes.start(command)
        self._put(events.SubstituteStarted(clock.now(), command.node, self._decided))

    def _stop(self, command: events.StopSubstitute) -> None:
        self._processes.stop(command.node, answers=not self._life.is_silent(command.node))

    def _assigned(self, command: events.AssignSubstitute) -> None:
        self._put(events.SubstituteStarted(clock.now(), command.node, self._decided))

    def _restart(self, command: events.RestartNode) -> None:
        try:
            process, with_us = self._restarts.start(command.node)
            self._fence.adopt(command.node, Known("", process))
        except (ShsaError, OSError) as error:
            self._put(events.RestartFailed(clock.now(), command.node, str(error)))
            return
        identities = self._restarts.identities(command.node)
        self._put(events.NodeRestarted(clock.now(), command.node, with_us, *identities))

    def _write_down(self, command: events.WriteDown) -> None:
        assert self._records is not None
        self._records.write(command.records, command.removed)

    def _run_command(self, command: events.RunCommand) -> None:
        program = command.words[0]
        rospy.logwarn("%s: running %s.", command.service, program)

        def report(detail: str) -> None:
            rospy.logwarn("%s: %s has ended: %s.", command.service, program, detail)

        run_command(command.words, report)

    def _show_substitutions(self, command: events.ShowSubstitutions) -> None:
        self._substitutions.update(map(substitution_message, command.rows), command.removed)

    def _show_som(self, command: events.ShowSom) -> None:
        self._master.introduce(*(row.service.topic for row in command.rows))
        self._som_state.update(map(wire.service_state, command.rows), command.removed)

    def _report(self) -> None:
        told = self._core.needed(), self._incidents.open(), self._master.told()
        self._diagnostics.show(told)

    def _failure(self, message: msg.Failure) -> None:
        if not message.sent and self._queue.qsize() > MOST_WAITING:
            rospy.logerr_throttle(10.0, "Failures that nobody signed come too fast: dropped.")
            return
        if not message.sent and message.kind == msg.Failure.NO_VALUE:
            return  # only a substitute of ours can tell that, and it signs
        try:
            self._put(wire.failure_seen(message))
        except ShsaError as error:
            rospy.logerr("Refused a message on %s: %s.", names.FAILURES, error)

    def _hear_monitor(self, host: str, signing: Signing) -> None:
        """Hear the monitor of a computer, if it has one; no host: the monitor of all others."""
        health, calibrations = (
            names.told_at(table, host) for table in (names.HEALTH, names.CALIBRATIONS)
        )
        self._master.introduce(*map(rospy.resolve_name, (health, calibrations)))
        TableSubscriber(health, msg.Health, partial(self._health, host), signing)
        TableSubscriber(calibrations, msg.Calibrations, self._calibrated, signing)

    def _health(self, host: str, message: msg.Health) -> None:
        before = self._health_began.get(host, 0)
        anew = before not in (0, message.began)  # another monitor
        self._health_began[host] = message.began
        try:
            self._put(wire.health_seen(message, anew, host))
        except ShsaError as error:
            rospy.logerr("Refused a message on %s: %s.", names.HEALTH, error)

    def _calibrated(self, message: msg.Calibrations) -> None:
        try:
            self._put(wire.calibrations_heard(message))
        except ShsaError as error:
            rospy.logerr("Refused a message on %s: %s.", names.CALIBRATIONS, error)


def read_models(ontology: str, som: str) -> Tuple[Ontology, Som]:
    """The ontology and the SOM in two files.

    Raises ModelError that names every error in them, or why a SOM that starts programs is not
    believed.
    """
    read_ontology, errors = load_ontology(ontology)
    read_som, som_errors = load_som(som, rospy.get_namespace())
    errors = [*errors, *som_errors]
    if errors:
        raise ModelErrors(errors)
    refuse_others_commands(read_som, som)
    return read_ontology, read_som


def _substitute_journals(journal: str) -> str:
    """What the journals of the substitutes begin with, beside the reconfigurator's own."""
    return os.path.splitext(journal)[0] + ".substitute_" if journal else ""


def main() -> None:
    """Run the reconfigurator node."""
    parser = argparse.ArgumentParser(prog="reconfigurator", description=main.__doc__)
    parser.add_argument("--ontology", required=True, help="the ontology file")
    parser.add_argument("--som", required=True, help="the service-to-ontology mapping file")
    parser.add_argument("--incident-log", default="", help="a file for one JSON line an incident")
    parser.add_argument("--dry-run", action="store_true", help="advise: kill and start nothing")
    parser.add_argument("--journal", default="", help="a file for every event, to be replayed")
    parser.add_argument("--secret", default="", help="the file with the secret of healing")
    parser.add_argument(
        "--unsigned-failures", action="store_true", help="believe failures that nobody signed"
    )
    parser.add_argument(
        "--no-operator",
        action="store_true",
        help="refuse whoever calls release, reload, substitute",
    )
    parser.add_argument("--restart-as-root", action="store_true", help="also if we are root")
    sandbox = "a program and its arguments to run the substitutes in"
    parser.add_argument("--sandbox", type=shlex.split, default="", help=sandbox)
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    await_turn("reconfigurator")
    run("reconfigurator", lambda: ReconfiguratorNode(arguments).spin())
