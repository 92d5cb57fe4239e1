"""The reconfigurator's ROS shell: brings events to the core, and carries out its commands."""
import json
import os
import queue
import threading
from concurrent.futures import Future
from typing import Callable, Dict, List, Optional, Set, Tuple

import actionlib
import rosgraph
import rospkg
import rospy
from shsa_msgs import msg, srv

from shsa_core.errors import NoSubstitute, ShsaError
from shsa_core.healing import events
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.plans import TopicPlan
from shsa_core.healing.machine import SUBSTITUTE_PREFIX, Reconfigurator
from shsa_core.healing.settings import read_settings
from shsa_core.files.ontology_file import read_ontology
from shsa_core.model.som import Som, read_som
from shsa_core.ros import wire
from shsa_core.ros.graph import clock
from shsa_core.ros.graph.fence import Fence
from shsa_core.ros.node import run
from shsa_core.ros.graph.processes import Processes, run_command
from shsa_core.ros.graph.restarts import Restarts
from shsa_core.ros.graph.som_parameter import SomWatch, put_som

SAY: Dict[str, Callable[[str], None]] = {
    "info": rospy.loginfo,
    "warn": rospy.logwarn,
    "error": rospy.logerr,
}
LEARNING = (0.0, 0.5, 2.0)  # s before each try to learn which process a node is
SETTLED = (State.HEALED, State.UNHEALED, State.SAFE, State.ENDED)


class ReconfiguratorNode:
    """Hears failures and health, kills, searches, starts and stops substitutes.

    Parameters: `~ontology` and `~som` (files), `~kill_patience` (s), `~incident_log` (file, one JSON line an
    incident), and those of shsa_core.healing.settings.
    """

    def __init__(self) -> None:
        ontology = read_ontology(_required("~ontology"))
        som = read_som(_required("~som"))
        settings, errors = read_settings(rospy.get_param("~"), rospy.get_name())
        for error in errors:
            rospy.logerr("Refused: %s. The default is used.", error)
        self._log_file = rospy.get_param("~incident_log", "") or os.path.join(
            rospkg.get_log_dir(), "shsa_incidents.jsonl"
        )
        self._queue: "queue.Queue[Callable[[], None]]" = queue.Queue()
        leftovers = _leftovers()
        self._core = Reconfigurator(ontology, som, settings, _first_free_number(leftovers))
        self._fence = Fence(rospy.get_name(), rospy.get_param("~kill_patience", 0.1))
        for node in leftovers:
            rospy.logwarn("%s was left behind; it is stopped.", node)
            self._fence.kill(node)
        self._processes = Processes(self._process_ended, self._fence.clear)
        self._restarts = Restarts()
        self._open: Dict[str, Incident] = {}
        self._incident_changed = threading.Condition()
        self._known: Set[Tuple[str, rospy.Time]] = set()

        self._incidents = rospy.Publisher("/shsa/incidents", msg.Incident, queue_size=100)
        self._substitutions = rospy.Publisher(
            "/shsa/substitutions", msg.Substitutions, queue_size=10, latch=True, tcp_nodelay=True
        )
        self._som_state = rospy.Publisher(
            "/shsa/som_state", msg.SomState, queue_size=10, latch=True
        )
        put_som(som)
        self._som_watch = SomWatch(som, self._som_changed)
        rospy.Subscriber("/shsa/failures", msg.Failure, self._failure, tcp_nodelay=True)
        rospy.Subscriber("/shsa/health", msg.Health, self._health, tcp_nodelay=True)
        rospy.Service("/shsa/find_substitute", srv.FindSubstitute, self._find_substitute)
        rospy.Service("/shsa/release", srv.Release, self._release)
        self._action = actionlib.SimpleActionServer(
            "/shsa/substitute", msg.SubstituteAction, self._substitute, auto_start=False
        )
        self._action.start()

    def spin(self) -> None:
        """Handle events in order until ROS shuts down; then stop every substitute."""
        self._tick()
        rospy.loginfo("The reconfigurator watches over %s.", ", ".join(self._core.needed()))
        while not rospy.is_shutdown():
            work = self._next()
            try:
                work()
            except Exception as error:  # whatever it is, healing goes on
                if not rospy.core.is_shutdown_requested():
                    rospy.logerr("The reconfigurator could not handle an event: %r", error)
        self._processes.stop_all()
        self._restarts.stop()
        for incident in self._open.values():
            self._log(incident)

    def _next(self) -> Callable[[], object]:
        """What to do next: an event, else a plan ahead, else to let time pass."""
        try:
            return self._queue.get_nowait()
        except queue.Empty:
            if self._core.plans_ahead:
                return self._core.prepare
        deadline = self._core.deadline
        wait = 0.2 if deadline is None else min(0.2, deadline - clock.now())
        try:
            return self._queue.get(timeout=max(0.0, wait))
        except queue.Empty:
            return self._tick

    def _enqueue(self, event: events.Event) -> None:
        self._queue.put(lambda: self._handle(event))

    def _tick(self) -> None:
        self._handle(events.Tick(clock.now()))

    def _handle(self, event: events.Event) -> None:
        commands = self._core.handle(event)
        decided = clock.now()
        for command in commands:
            self._carry_out(command, decided)

    def _carry_out(self, command: events.Command, decided: float) -> None:
        if isinstance(command, events.KillNode):
            threading.Thread(target=self._kill, args=(command,), daemon=True).start()
        elif isinstance(command, events.StartSubstitute):
            self._start(command, decided)
        elif isinstance(command, events.AssignSubstitute):
            self._enqueue(events.SubstituteStarted(clock.now(), command.node, decided))
        elif isinstance(command, events.StopSubstitute):
            self._processes.stop(command.node)
        elif isinstance(command, events.RestartNode):
            self._restart(command.node)
        elif isinstance(command, events.RunCommand):
            self._run(command)
        elif isinstance(command, events.ShowSubstitutions):
            self._substitutions.publish(wire.substitutions(command.substitutions))
        elif isinstance(command, events.ShowSom):
            self._som_state.publish(wire.som_state(command))
        elif isinstance(command, events.ShowIncident):
            self._show(command.incident)
        else:
            SAY[command.level]("%s" % command.text)

    def _kill(self, command: events.KillNode) -> None:
        if not self._fence.knows(command.node):
            self._learn(command.node)  # it failed as soon as it was there
        certain, how = self._fence.kill(command.node, command.urgent)
        self._enqueue(events.NodeKilled(clock.now(), command.node, certain, how))

    def _start(self, command: events.StartSubstitute, decided: float) -> None:
        try:
            self._processes.start(command.node, command.program)
        except OSError as error:
            self._enqueue(events.ProcessExited(clock.now(), command.node, str(error)))
            return
        self._enqueue(events.SubstituteStarted(clock.now(), command.node, decided))

    def _restart(self, node: str) -> None:
        try:
            self._restarts.start(node)
        except (ShsaError, OSError) as error:
            self._enqueue(events.RestartFailed(clock.now(), node, str(error)))

    def _run(self, command: events.RunCommand) -> None:
        program = command.words[0]
        rospy.logwarn("%s: running %s.", command.topic, program)

        def report(detail: str) -> None:
            rospy.logwarn("%s: %s has ended: %s.", command.topic, program, detail)

        run_command(command.words, report)

    def _process_ended(self, node: str, detail: str) -> None:
        self._enqueue(events.ProcessExited(clock.now(), node, detail))

    def _show(self, incident: Incident) -> None:
        self._incidents.publish(wire.incident(incident))
        if incident.state is State.ENDED:
            self._open.pop(incident.topic, None)
            self._log(incident)
        else:
            self._open[incident.topic] = incident
        with self._incident_changed:
            self._incident_changed.notify_all()

    def _log(self, incident: Incident) -> None:
        try:
            with open(self._log_file, "a", encoding="utf-8") as log:
                log.write(json.dumps(wire.incident_record(incident)) + "\n")
        except OSError as error:
            rospy.logerr("The incident log %s cannot be written: %s", self._log_file, error)

    def _failure(self, failure: msg.Failure) -> None:
        self._enqueue(wire.failure_seen(failure))

    def _health(self, health: msg.Health) -> None:
        for row in health.publishers:
            if row.state == row.HEALTHY and (row.publisher, row.since) not in self._known:
                self._known.add((row.publisher, row.since))
                threading.Thread(
                    target=self._learn_in_time, args=(row.publisher,), daemon=True
                ).start()
        self._enqueue(wire.health_seen(health))

    def _learn_in_time(self, node: str) -> None:
        """Learn a node's process before it is needed; a busy node may not answer at once."""
        for pause in LEARNING:
            rospy.rostime.wallsleep(pause)
            self._learn(node)
            if self._fence.knows(node):
                return

    def _learn(self, node: str) -> None:
        process = self._fence.learn(node)
        if process is not None:
            self._restarts.learn(node, process)

    def _release(self, request: srv.ReleaseRequest) -> srv.ReleaseResponse:
        if request.topic not in self._core.needed():
            known = ", ".join(self._core.needed())
            text = f"{request.topic} is not a needed topic; these are: {known}"
            return srv.ReleaseResponse(success=False, detail=text)
        self._enqueue(events.Released(clock.now(), request.topic))
        text = f"whatever publishes {request.topic} may return"
        return srv.ReleaseResponse(success=True, detail=text)

    def _som_changed(self, som: Som) -> None:
        self._enqueue(events.SomChanged(clock.now(), som))

    def _ask(self, question: Callable[[], TopicPlan]) -> "Future[TopicPlan]":
        """Ask the core, in turn with the events."""
        answer: "Future[TopicPlan]" = Future()

        def work() -> None:
            try:
                answer.set_result(question())
            except ShsaError as error:
                answer.set_exception(error)

        self._queue.put(work)
        return answer

    def _find_substitute(self, request: srv.FindSubstituteRequest) -> srv.FindSubstituteResponse:
        answer = self._ask(
            lambda: self._core.explain(request.topic, request.without, request.method)
        )
        try:
            return wire.found(answer.result(timeout=5.0))
        except NoSubstitute as none:
            return srv.FindSubstituteResponse(
                found=False, missing=list(none.missing), detail=str(none)
            )
        except ShsaError as error:
            return srv.FindSubstituteResponse(found=False, detail=str(error))

    def _substitute(self, goal: msg.SubstituteGoal) -> None:
        if goal.topic not in self._core.needed():
            known = ", ".join(self._core.needed())
            self._action.set_aborted(text=f"{goal.topic} is not a needed topic; these are: {known}")
            return
        asked = clock.now()
        self._enqueue(events.SubstituteRequested(asked, goal.topic))
        incident = self._await_incident(goal.topic)
        if incident is None:
            self._action.set_preempted(text="cancelled; the incident goes on")
            return
        result = msg.SubstituteResult(
            success=incident.state is State.HEALED, incident=wire.incident(incident)
        )
        self._action.set_succeeded(result, incident.detail)

    def _await_incident(self, topic: str) -> Optional[Incident]:
        """The incident of `topic` once it is healed or cannot be; None if nobody waits for it any more."""
        last: Optional[Incident] = None
        while not rospy.is_shutdown() and not self._action.is_preempt_requested():
            with self._incident_changed:
                self._incident_changed.wait(0.1)
            incident = self._open.get(topic)
            if incident is not None and incident is not last:
                last = incident
                self._action.publish_feedback(
                    msg.SubstituteFeedback(state=incident.state.value, detail=incident.detail)
                )
            if last is not None and (incident is None or incident.state in SETTLED):
                return last
        return None


def _required(name: str) -> str:
    value = rospy.get_param(name, None)
    if not isinstance(value, str) or not value:
        raise ShsaError(f"{rospy.resolve_name(name)}: not set; it must name a file")
    return value


def _leftovers() -> List[str]:
    """The substitutes that a former reconfigurator left behind."""
    publishers, _, _ = rosgraph.Master(rospy.get_name()).getSystemState()
    nodes = {node for _, names in publishers for node in names}
    return sorted(node for node in nodes if node.startswith(SUBSTITUTE_PREFIX))


def _first_free_number(leftovers: List[str]) -> int:
    """A number above those of `leftovers`: names are never used twice."""
    tails = [node.rsplit("_", 1)[-1] for node in leftovers]
    return 1 + max((int(tail) for tail in tails if tail.isdigit()), default=0)


def main() -> None:
    """Run the reconfigurator node."""
    run("reconfigurator", lambda: ReconfiguratorNode().spin())
