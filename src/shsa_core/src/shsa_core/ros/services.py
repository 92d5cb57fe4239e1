"""The reconfigurator's ROS services and its action, for people and programs."""
import time
from concurrent.futures import Future, TimeoutError as Late
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Callable, Tuple

import actionlib
import rospy
from shsa_msgs import msg, srv
from std_srvs.srv import SetBool, SetBoolRequest

from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.incident import Incident, State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.model.service import Service
from shsa_core.ros import clock, settings
from shsa_core.ros.incidents import Incidents
from shsa_core.ros.rospy_patches.inbound import charge_also
from shsa_core.ros.rospy_patches.subscribing import bound_messages, subscribe
from shsa_core.ros.wire import healing as wire, names

NO_OPERATOR = (
    "refused: this reconfigurator was started with operator:=false, and does nothing on request"
)


@dataclass
class Services:
    """Asks the core in turn with its events, by `enqueue`; `put` hands it an event.

    ROS cannot tell who calls. `operator`: whether what changes something is done for anybody.
    """

    _core: Reconfigurator
    _enqueue: Callable[[Callable[[], object]], None]
    _put: Callable[[events.Event], None]
    _incidents: Incidents
    _reload: Callable[[], str]
    _maintain: Callable[[bool], None]
    _operator: bool

    def __post_init__(self) -> None:
        for name, kind, answer in (
            (names.FIND_SUBSTITUTE, srv.FindSubstitute, self._find_substitute),
            (names.RELEASE, srv.Release, self._acting(self._release)),
            (names.RELOAD, srv.Reload, self._acting(lambda _: self._reload())),
            (names.MAINTENANCE, SetBool, self._acting(self._set_maintenance)),
        ):
            bound_messages(rospy.Service(name, kind, answer), settings.LARGEST_CALL_B)
        goal = msg.SubstituteActionGoal
        for end, kind in (("goal", goal), ("cancel", type(goal().goal_id))):
            topic = f"{names.SUBSTITUTE_ACTION}/{end}"
            subscribe(topic, kind, lambda _: None, settings.LARGEST_CALL_B)
        self._action = actionlib.SimpleActionServer(
            names.SUBSTITUTE_ACTION, msg.SubstituteAction, self._substitute, auto_start=False
        )
        self._action.start()

    def _ask(self, question: Callable[[], Any]) -> Any:
        """Return the core's answer. Raises ShsaError."""
        answer: "Future[Any]" = Future()

        def work() -> None:
            began = time.thread_time()
            try:
                found = question()
            except ShsaError as error:
                found = error
            except Exception as error:  # as a full disk: who asked is told, and the log
                answer.set_result((ShsaError(f"{type(error).__name__}: {error}"), 0.0))
                raise
            answer.set_result((found, time.thread_time() - began))

        self._enqueue(work)
        try:
            found, spent = answer.result(timeout=settings.ANSWER_S)
        except Late as error:
            raise ShsaError(f"no answer within {settings.ANSWER_S:g} s") from error
        charge_also(spent)
        if isinstance(found, ShsaError):
            raise found
        return found

    def _needed(self, name: str) -> Service:
        """Return the needed service of a name or topic. Raises ShsaError."""
        service: Service = self._ask(lambda: self._core.find(name))
        if not service.needed:
            known = ", ".join(each.topic for each in self._core.robot.som.needed())
            raise ShsaError(f"{name} is not a needed service; these are: {known}")
        return service

    def _find_substitute(self, request: srv.FindSubstituteRequest) -> srv.FindSubstituteResponse:
        asked = request.topic, request.without, request.method
        try:
            return wire.found(self._ask(lambda: self._core.explain(*asked)))
        except ShsaError as none:
            missing = list(none.missing)
            return srv.FindSubstituteResponse(found=False, missing=missing, detail=str(none))

    def _acting(self, act: Callable[[Any], str]) -> Callable[[Any], Tuple[bool, str]]:
        """Return what answers calls that change something: what was done, or why not."""

        def answer(request: Any) -> Tuple[bool, str]:
            try:
                if not self._operator:
                    raise ShsaError(NO_OPERATOR)
                return True, act(request)
            except ShsaError as error:
                return False, str(error)

        return answer

    def _release(self, request: srv.ReleaseRequest) -> str:
        service = self._needed(request.topic)
        self._put(events.Released(clock.now(), service.name))
        return f"whatever publishes {service.topic} may return"

    def _set_maintenance(self, request: SetBoolRequest) -> str:
        self._ask(lambda: self._maintain(request.data))
        return f"maintenance is {'on' if request.data else 'off'}"

    def _substitute(self, goal: msg.SubstituteGoal) -> None:
        try:
            if not self._operator:
                raise ShsaError(NO_OPERATOR)
            service = self._needed(goal.topic)
            if self._core.robot.maintained:
                raise ShsaError("refused: maintenance is on, and nothing is started")
        except ShsaError as error:
            self._action.set_aborted(text=str(error))
            return
        last = wire.last_message(_one_message(service))
        self._put(events.SubstituteRequested(clock.now(), service.name, last))
        incident = self._incidents.await_settled(
            service.name, self._feedback, self._action.is_preempt_requested
        )
        if incident is None:
            self._action.set_preempted(text="cancelled; the incident goes on")
            return
        healed = incident.state is State.HEALED
        result = msg.SubstituteResult(success=healed, incident=wire.incident(incident))
        self._action.set_succeeded(result, incident.detail)

    def _feedback(self, incident: Incident) -> None:
        state, detail = incident.state.value, incident.detail
        self._action.publish_feedback(msg.SubstituteFeedback(state=state, detail=detail))


def _one_message(service: Service) -> bytes:
    """Return the next message, which no monitor sends; empty if another comes, or none in time."""
    with suppress(rospy.ROSException):
        message = rospy.wait_for_message(service.topic, rospy.AnyMsg, settings.CALL_S)
        header = message._connection_header
        if (header["callerid"], header["type"]) == (service.node, service.type):
            return bytes(message._buff)
    return b""
