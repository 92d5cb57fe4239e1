"""The reconfigurator's ROS shell: brings events to the core, and carries out its commands."""
import argparse
import os
import queue
import shlex
import subprocess
import sys
import threading
from contextlib import suppress
from dataclasses import replace
from functools import partial
from operator import attrgetter
from typing import Callable, Dict, List, Optional, Set, Tuple

import rospy
from shsa_msgs import msg

from shsa_core import dispatch
from shsa_core.analysis import budget, check, duties
from shsa_core.analysis.registrations import Part
from shsa_core.errors import ModelError, ModelErrors, ShsaError
from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.som_file import added_path, load_som, refuse_others_commands
from shsa_core.healing import events
from shsa_core.healing.events import Event
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import Settings
from shsa_core.hosts.conversation import HostCommand
from shsa_core.journal.record_file import RecordFile
from shsa_core.model.names import file_name
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.model.substitution import row_key
from shsa_core.ros import clock, diagnostics, settings
from shsa_core.ros.processes.launch import Launch, await_turn, hear_successor
from shsa_core.ros.processes.watching import Companion
from shsa_core.ros.processes.heartbeats import MONITOR, RECONFIGURATOR, Signs
from shsa_core.ros.master.master_watch import MasterWatch, Parts
from shsa_core.ros.master.node_api import FAILURES
from shsa_core.ros.processes.starting import Setup
from shsa_core.ros.trust.places import boot
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.master.som_parameter import LIVE_PARAMETERS, SomWatch, put_som
from shsa_core.ros.messages.tables import TablePublisher, TableSubscriber
from shsa_core.ros.workers import Workers, guarded
from shsa_core.ros.agent.all_hosts import AllHosts
from shsa_core.ros.processes.local import LocalHost
from shsa_core.ros.incidents import Incidents
from shsa_core.ros.node import LOG, read_parameters, recorded, run
from shsa_core.ros.services import Services
from shsa_core.ros.succession import KnowledgeFile, maintain, maintained, record_path, take_over
from shsa_core.ros.wire import healing as wire, names
from shsa_core.ros.wire.rows import own_rows, substitution_message

MOST_WAITING = 10_000
"""With more to do than this, failures that nobody signed are dropped."""


class ReconfiguratorNode:
    """Hears failures and health, and makes the graph do what the core commands.

    Parameters: those of shsa_core.healing.settings. Raises ModelError if a file is not valid.
    """

    def __init__(self, arguments: argparse.Namespace, followed: Callable[[], bool]) -> None:
        self._files = arguments
        self._added = 0.0  # when `shsa add` wrote what was read
        self._reloading = threading.Lock()
        self._said: List[events.Log] = []
        signing = Signing(arguments.secret)
        ontology, som = read_models(arguments.ontology, arguments.som)
        parameters = read_parameters(Settings)
        setup = {
            "ontology": ontology,
            "som": self._usable(som),
            "settings": parameters,
            "namespace": rospy.get_namespace(),
            "dry_run": arguments.dry_run,
            "restarts": arguments.restart_as_root or os.geteuid() != 0,
            "host": arguments.host,
        }
        if not setup["restarts"]:
            for service in (each for each in som if each.policy.restarts):
                text = "%s is not started again: that would be as root (restart_as_root:=true)."
                rospy.logerr(text, service.node)
        for late in budget.check_budgets(som, parameters):
            rospy.logwarn("%s: %s. %s.", *late, budget.TODO)
        self._core = Reconfigurator(**setup)
        journal = arguments.journal and file_name(arguments.journal, rospy.get_namespace())
        self._answer, self._close = recorded(journal, "healing", setup, self._core.handle)
        self._queue: "queue.Queue[Callable[[], object]]" = queue.Queue()
        self._launch = Launch()
        self._followed = followed
        prefix = self._core.names.prefix
        self._listed: List[Dict[str, Tuple[str, ...]]] = [{}, {}]
        self._spins, self._stopped = False, threading.Event()
        self._healed: Optional[Set[str]] = None  # topics, as far as people were told
        self._is_monitored = False
        kept = KnowledgeFile(record_path(rospy.get_namespace(), "master"), boot())
        watched = self._core.names, self._see_graph, kept.read(), kept.write
        self._master = MasterWatch(*watched, acts=self._core.robot.acts(som))
        signs = Signs(RECONFIGURATOR, lambda: str(self._master.pid or "").encode())
        self._companion = Companion(MONITOR, signs)
        types = sorted({service.type for service in som if service.type})
        ready = lambda: self._put(events.Prepared(clock.now()))
        # Beside our own journal.
        journals = os.path.splitext(journal)[0] + ".substitute_" if journal else ""
        given = signing.path, journals, arguments.sandbox
        how = Setup(prefix, *given, forks=not arguments.rosrun, types=types, ready=ready)
        self._local = LocalHost(self._put, signs, how)
        host_of = self._core.robot.host_of
        self._hosts = AllHosts(self._local.carry_out, signing, self._put, host_of, arguments.host)
        rospy.core.add_preshutdown_hook(self._stop_elsewhere)
        self._incidents = Incidents(arguments.incident_log, signing)
        table = names.SUBSTITUTIONS, msg.Substitutions, "substitutions", row_key, signing
        self._substitutions = TablePublisher(*table, opened=False, concerning=own_rows(prefix))
        key = attrgetter("service")
        som_state = names.SOM_STATE, msg.SomState, "services", key, signing
        self._som_state = TablePublisher(*som_state, opened=False)
        self._records: RecordFile
        self._commands = Workers("command", settings.MOST_CALLS)
        self._carry_out: dispatch.Table[object] = dispatch.table(
            events.Command,
            {
                **dict.fromkeys(dispatch.members(HostCommand), self._hosts.carry_out),
                events.WriteDown: lambda c: self._records.write(c.records, c.removed),
                events.AskMonitor: lambda command: self._monitors[command.host].ask_again(),
                events.RunCommand: lambda c: self._commands.put(lambda: self._run_command(c)),
                events.ShowSubstitutions: self._show_substitutions,
                events.ShowSom: self._show_som,
                events.ShowIncident: lambda command: self._incidents.show(command.incident),
                events.Log: lambda command: LOG[command.level]("%s", command.text),
            },
        )
        ask = lambda: self._queue.put(self._report)
        shown = ask, diagnostics.healing_rows, signing, self._companion
        self._diagnostics = diagnostics.Diagnostics(*shown)
        # First of all: what runs goes on, and no substitute may take a name that was used.
        self._may_act(som)
        self._listen(som, taking_up=True)
        known, elsewhere = self._master.known, self._hosts.take_up()
        started, self._records = take_over(self._local, som, self._core.names, known, elsewhere)
        self._listed = [dict(started.subscribers), dict(started.duties)]
        if maintained(rospy.get_namespace()):  # known before anything is started
            self._heed_maintenance()
        self._decide(replace(started, preparing=self._local.substitutes.forking is not None))
        self._substitutions.open()
        self._som_state.open()
        put_som(som)
        self._som_watch = SomWatch(
            som,
            lambda s: self._put(events.SomChanged(clock.now(), self._usable(s))),
            arguments.live_parameters,
        )
        self._master.introduce(names.FAILURES, names.SUBSTITUTIONS, names.SOM_STATE)
        self._monitors: Dict[str, TableSubscriber] = {}
        self._signing = signing
        self._hear_monitors(som)
        failures = signing.checked(names.FAILURES, msg.Failure, arguments.unsigned_failures)
        signing.subscribe(names.FAILURES, failures, self._failure)
        self._services = Services(
            self._core,
            self._queue.put,
            self._put,
            self._incidents,
            self.reload,
            self._maintain,
            not arguments.no_operator,
        )

    def spin(self) -> None:
        """Handle events in order until ROS shuts down; then stop every substitute.

        Unless another reconfigurator follows, which takes them up.
        """
        self._spins = True
        while not rospy.is_shutdown():
            self._companion.beat()
            guarded("The reconfigurator", self._next())
        self._spins = False
        if not self._followed():
            self._stop_all()
        self._incidents.close()
        self._records.close()
        self._close()

    def _stop_elsewhere(self, _: str) -> None:
        """Agents are told while our topics are open; with one computer nobody is waited for."""
        if self._spins and self._hosts.remote and not self._followed():
            self._queue.put(self._stop_all)
            self._stopped.wait(settings.ANSWER_S)

    def _stop_all(self) -> None:
        if self._stopped.is_set():
            return
        for node in self._local.restarts.abandoned(ending=True):
            self._handle(events.StarterEnded(clock.now(), node))
        self._handle(events.ShuttingDown(clock.now()))
        self._local.await_stops()
        self._hosts.await_quiet()
        self._stopped.set()

    def _may_act(self, som: Som) -> None:
        self._master.acts = self._core.robot.acts(som)
        if not som.act:
            rospy.logwarn("Healing only advises. It acts by `act: true` in %s.", self._files.som)

    def reload(self) -> str:
        """Read ontology and SOM again; what was read. Raises ModelError, with every error.

        From any thread but that of the events: what was read counts, then the master is awaited.
        Raises another ShsaError if that does not answer.
        """
        with self._reloading:
            ontology, som = read_models(self._files.ontology, self._files.som)
            self._som_watch.replace(som)
            self._may_act(som)
            self._put(events.SomChanged(clock.now(), self._usable(som), ontology))
            self._listen(som)
            self._hear_monitors(som)
            try:
                put_som(som)
            except FAILURES as error:
                raise ShsaError(f"it counts, but is not shown at shsa/som: {error}") from error
        relations = len({function.relation for function in ontology.functions})
        return f"{relations} relations and {len(som)} services were read"

    def _usable(self, som: Som) -> Som:
        """The SOM as far as it can be used here; what cannot be is said once."""
        marked, problems = check.mark_unusable(som)
        for problem in problems:
            if problem not in self._said:
                LOG[problem.level]("%s.", problem.text)
        self._said = problems
        return marked

    def _next(self) -> Callable[[], object]:
        """Return the next thing to do: an event, else a plan ahead, else to let time pass."""
        ahead, wait = self._core.plans_ahead, 0.0
        if self._queue.empty() and not ahead:
            wait = min(settings.TURN_S, max(0.0, self._core.deadline - clock.now()))
        try:
            return self._queue.get(timeout=wait)
        except queue.Empty:
            kind = events.Idle if ahead else events.Tick
            return lambda: self._handle(kind(clock.now()))

    def _put(self, event: Event) -> None:
        self._queue.put(lambda: self._handle(event))

    def _handle(self, event: Event) -> None:
        if self._launch.ending():
            self._decide(events.LaunchEnding(event.time))
        self._decide(event)

    def _decide(self, event: Event) -> None:
        for command in self._answer(event):
            guarded(type(command).__name__, self._carry_out[type(command)], command)

    def _listen(self, som: Som, taking_up: bool = False) -> None:
        """Hear the agents, and see to it that both ends hear of each other."""
        hosts = [name for name in som.hosts if name != self._files.host]
        self._hosts.listen(hosts, taking_up)
        ends = names.host_commands, names.host_events
        self._master.introduce(*(topic(host) for host in hosts for topic in ends))

    def _run_command(self, command: events.RunCommand) -> None:
        """Run a user's program, given as a list and through no shell, and wait for it."""
        service, words = command.service, command.words
        rospy.logwarn("%s: running %s.", service, words[0])
        try:
            process = subprocess.Popen(words, stdin=subprocess.DEVNULL, start_new_session=True)
            detail = f"exit status {process.wait()}"
        except OSError as error:
            detail = str(error)
        rospy.logwarn("%s: %s has ended: %s.", service, words[0], detail)

    def _see_graph(self, registered: Parts) -> None:
        """Tell the core who subscribes to services, and what else their nodes do.

        Not before it was told what was taken over, which may be older.
        """
        if not self._spins:
            return
        som, names = self._core.robot.som, self._core.names
        parts = [registered[each] for each in (Part.PUBLISHER, Part.SUBSCRIBER, Part.SERVICE)]
        now = [
            duties.subscribers_of(som, parts[1]),
            duties.duties_of(som, names, *parts, had=self._listed[1]),
        ]
        new = [
            tuple((k, b.get(k, ())) for k in sorted({*a, *b}) if a.get(k) != b.get(k, ()))
            for a, b in zip(self._listed, now)
        ]
        self._listed = now
        if any(new) or self._healed is None:
            self._put(events.GraphSeen(clock.now(), *new))
            self._queue.put(self._tell_healed)

    def _tell_healed(self) -> None:
        """Say what is healed, once it is watched and needed, and again when that is more."""
        if not self._is_monitored:
            return
        topics = [service.topic for service in self._core.robot.som.needed()]
        if self._healed is None or not self._healed.issuperset(topics):
            does = "healing" if self._master.acts else "advising (nothing is killed or started) on"
            rospy.loginfo("Reconfigurator ready, %s: %s.", does, ", ".join(topics) or "nothing")
            self._healed = {*topics, *(self._healed or ())}

    def _show_substitutions(self, command: events.ShowSubstitutions) -> None:
        for node in (row.node for row in command.rows if row.publishing):
            self._local.hurry(node)
        self._substitutions.update(map(substitution_message, command.rows), command.removed)

    def _show_som(self, command: events.ShowSom) -> None:
        self._master.introduce(*(topic for row in command.rows for topic in row.service.topics))
        self._som_state.update(map(wire.service_state, command.rows), command.removed)

    def _heed_added(self) -> None:
        """Read the models again once `shsa add` has written its file, which only we may write."""
        written = 0.0
        with suppress(OSError):  # nothing was added
            written = os.path.getmtime(added_path(self._files.som))
        waits = self._reloading.locked() or not self._master.answers
        if written != self._added and not waits:
            self._commands.put(partial(self._reload_added, written))

    def _reload_added(self, written: float) -> None:
        try:
            rospy.loginfo("Read anew after `shsa add`: %s.", self.reload())
        except ModelError as error:
            rospy.logerr("Refused: %s", error)
        except ShsaError as error:  # again once it does
            rospy.logwarn_throttle(10.0, f"The master does not answer: {error}")
            return
        self._added = written

    def _maintain(self, on: bool) -> None:
        maintain(rospy.get_namespace(), on)
        self._heed_maintenance()

    def _heed_maintenance(self) -> None:
        """Tell whether the robot is maintained, as the file says it."""
        self._decide(events.MaintenanceSet(clock.now(), maintained(rospy.get_namespace())))

    def _report(self) -> None:
        self._heed_added()
        self._heed_maintenance()
        core, found, listed = self._core, self._incidents.open(), self._listed[1]
        open_ = {name: replace(each, errors=core.errors(name)) for name, each in found.items()}
        done = core.robot.som.needed(), open_, self._master, self._hosts.remote, listed
        self._diagnostics.show((*done, core.robot.maintained))

    def _failure(self, message: msg.Failure) -> None:
        monitors = (rospy.resolve_name(names.monitor_of(host)) for host in self._monitors)
        if message._connection_header["callerid"] in monitors:
            return  # its table has told that
        if not message.sent and self._queue.qsize() > MOST_WAITING:
            rospy.logerr_throttle(10.0, "Unsigned failures come too fast: dropped.")
            return
        if not message.sent and message.kind == msg.Failure.NO_VALUE:
            return  # only a substitute of ours can tell that, and it signs
        self._heard(names.FAILURES, wire.failure_seen, message)

    def _heard(self, topic: str, read: Callable[..., Event], *message: object) -> None:
        try:
            self._put(read(*message))
        except ShsaError as error:
            rospy.logerr("Refused a message on %s: %s.", topic, error)

    def _hear_monitors(self, som: Som) -> None:
        """Hear the monitors of more computers, if they have one; no host: that of all others."""
        for host in {"", *som.hosts} - self._monitors.keys():
            health, calibrations = names.told_by_monitor(host)
            self._master.introduce(health, calibrations)
            calibrated = partial(self._heard, names.CALIBRATIONS, wire.calibrations_heard)
            TableSubscriber(calibrations, msg.Calibrations, calibrated, self._signing)
            heard = partial(self._health, host)
            self._monitors[host] = TableSubscriber(health, msg.Health, heard, self._signing)

    def _health(self, host: str, message: msg.Health) -> None:
        self._is_monitored = True
        self._heard(names.HEALTH, wire.health_seen, message, host)


def read_models(ontology: str, som: str) -> Tuple[Ontology, Som]:
    """The ontology and the SOM in two files.

    Raises ModelError that names every error by which they cannot be used, or why a SOM that starts
    programs is not believed.
    """
    read_ontology, errors = load_ontology(ontology)
    read_som, som_errors = load_som(som, rospy.get_namespace())
    models, errors = (read_ontology, read_som), [*errors, *som_errors]
    errors = errors or [*check.function_errors(read_ontology), *check.name_errors(*models)]
    if errors:
        raise ModelErrors(errors)
    refuse_others_commands(read_som, som)
    return models


def main() -> None:
    """Run the reconfigurator node."""
    parser = argparse.ArgumentParser(prog="reconfigurator", description=main.__doc__)
    parser.add_argument("--ontology", required=True, help="the ontology file")
    parser.add_argument("--som", required=True, help="the service-to-ontology mapping file")
    parser.add_argument("--incident-log", default="", help="a file for one JSON line an incident")
    parser.add_argument("--dry-run", action="store_true", help="advise: kill and start nothing")
    parser.add_argument("--journal", default="", help="a file for every event, to be replayed")
    parser.add_argument("--live-parameters", action="store_true", help=LIVE_PARAMETERS)
    parser.add_argument("--secret", default="", help="the file with the secret of healing")
    parser.add_argument("--unsigned-failures", action="store_true", help="believe unsigned ones")
    parser.add_argument("--rosrun", action="store_true", help="start substitutes by it: no forks")
    refuses = "refuse calls of release, reload, substitute"
    parser.add_argument("--no-operator", action="store_true", help=refuses)
    parser.add_argument("--restart-as-root", action="store_true", help="also if we are root")
    parser.add_argument("--host", default="", help="what the SOM calls this computer")
    sandbox = "a program and its arguments to run the substitutes in"
    parser.add_argument("--sandbox", type=shlex.split, default="", help=sandbox)
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    await_turn("reconfigurator")
    followed = hear_successor()
    run("reconfigurator", lambda: ReconfiguratorNode(arguments, followed).spin())
