"""Remedies for a failed node: healing, respawn, or starting it by hand."""
import os
import signal
import time
from typing import Callable, Protocol, Sequence, TypeVar

from tqdm import tqdm

from shsa_core.monitoring.settings import RATE_SECONDS

from faults import FAULTS, Fault, Patient
from graph import PATIENCE_S, Graph, ask_to_leave, shut_down
from robot import NODE, TOPIC, Consumers, HealthyRobot, talker
from shsa_testing.faulty_publisher import FaultHandle
from shsa_testing.graph import node_pid, node_process, publishers
from shsa_testing.waiting import wait_until
from takeover import NEVER, Takeover, measured, with_steps, with_substitute

MISSES = 5
LASTS_S = 2.0
"""Healing does not end what comes and goes: so long it is looked at before it is eased."""
WAITED_S = 5.0
"""So long nobody answers a failure before it is taken that nobody ever does."""
LAUNCH = """
<launch>
  <node pkg="{package}" type="{executable}" name="{name}" args="{arguments}" respawn="true" />
</launch>
"""


class Endable(Protocol):
    """Something that was started."""

    def end(self) -> None:
        """Stop everything."""


class Contender(Endable, Protocol):
    """Something that brings a failed topic back."""

    period: float

    def await_well(self) -> None:
        """Wait until it is ready for the next failure.

        Raises AssertionError if it does not become so.
        """

    def fail(self) -> Takeover:
        """Fail once. Raises AssertionError if the topic does not come back."""


Subject = TypeVar("Subject", bound=Endable)


def repeat(
    graph: Graph,
    make: Callable[[], Subject],
    once: Callable[[Subject], None],
    enough: Callable[[], bool],
) -> int:
    """Measure until it is enough; a new subject after each miss, an AssertionError.

    The number of misses.
    """
    misses = 0
    subject = make()
    while not enough() and misses < MISSES:
        try:
            once(subject)
        except AssertionError as error:
            misses += 1
            tqdm.write(f"missed: {error}")
            tqdm.write(graph.last_words())
            subject.end()
            subject = make()
    subject.end()
    return misses


class Healed:
    """The small robot, healed; `more`: what the SOM says of its topic besides."""

    def __init__(
        self,
        graph: Graph,
        consumers: Consumers,
        standby: str,
        period: float,
        fault: Fault = FAULTS["kill -9"],
        **more: object,
    ) -> None:
        self.period = period
        self._consumers = consumers
        self._robot = HealthyRobot(graph, consumers, standby, period, **more)
        self._fault = fault

    def await_well(self) -> None:
        self._robot.await_well()
        if self._fault.eased:  # nobody is blamed for a rate that was never good
            began, count = time.monotonic(), 2.0 * RATE_SECONDS / self.period
            paced = lambda: len(self._consumers.rospy.since(began)) > count
            wait_until(paced, PATIENCE_S, "the monitor knows the rate")

    def fail(self) -> Takeover:
        takeover = self.take_over()
        self.bring_back()
        return takeover

    def take_over(self) -> Takeover:
        """Fail once, without coming back. Raises AssertionError if the topic is not healed."""
        robot, consumers = self._robot, self._consumers
        before = robot.healing.latest(robot.topic)
        number = 0 if before is None else before.id
        patient = Patient(NODE, robot.failing.pid, self.period, robot.fault)
        failed_at = time.monotonic()
        self._fault.cause(patient)

        def is_healed() -> bool:
            incident = robot.healing.latest(robot.topic)
            return incident is not None and incident.id > number and incident.state == "healed"

        wait_until(is_healed, PATIENCE_S, "the topic is healed")
        if self._fault.eased:
            time.sleep(LASTS_S)
            self._fault.eased(patient)
        if robot.heard != NODE:  # a gate is heard whoever publishes
            return _once_over(consumers, failed_at, self.period)
        incident = robot.healing.latest(robot.topic)
        assert incident is not None
        consumers.await_node(incident.substitute, failed_at)
        takeover = _once_over(consumers, failed_at, self.period)
        takeover = with_substitute(takeover, consumers, failed_at, incident)
        if not self._fault.eased:
            takeover = with_steps(takeover, consumers, failed_at, incident)
        return takeover

    def bring_back(self) -> None:
        """Start the node again."""
        self._robot.bring_back()

    def end(self) -> None:
        self._robot.end()


class Respawned:
    """A node under `respawn="true"` of a launch `program`, and no healing.

    `patience` in s: how long a failure is watched that roslaunch does not see.
    """

    period = 0.02

    def __init__(
        self,
        graph: Graph,
        consumers: Consumers,
        executable: str,
        fault: Fault = FAULTS["kill -9"],
        patience: float = WAITED_S,
        program: Sequence[str] = ("roslaunch",),
    ) -> None:
        self._consumers = consumers
        self._fault = fault
        self._patience = patience
        package, arguments = "shsa_core", f"{TOPIC} {self.period} 1.0"
        self._obeys = executable == "faulty_publisher"
        if self._obeys:
            package = "shsa_testing"
            arguments = " ".join(talker(NODE, TOPIC, 1.0, self.period)[:-1])
        path = graph.folder / "respawn.launch"
        names = {"package": package, "executable": executable, "name": NODE[1:]}
        path.write_text(LAUNCH.format(arguments=arguments, **names))
        self._commands = FaultHandle(NODE)
        self._launch = graph.start(*program, str(path))

    def await_well(self) -> None:
        wait_until(lambda: node_process(NODE) is not None, PATIENCE_S, "the node is up")
        self._consumers.await_node(NODE, time.monotonic())
        for consumer in self._consumers:
            consumer.forget()

    def fail(self) -> Takeover:
        patient = Patient(NODE, node_pid(NODE), self.period, self._commands)
        failed_at = time.monotonic()
        self._fault.cause(patient)
        if self._fault.ends:
            return _once_over(self._consumers, failed_at, self.period)
        time.sleep(self._patience)
        takeover = measured(self._consumers, failed_at, time.monotonic(), self.period)
        # Somebody else than roslaunch ends it, so that there is a new one for the next failure.
        os.kill(patient.pid, signal.SIGKILL)
        pid_of = lambda process: patient.pid if process is None else process.pid
        is_new = lambda: pid_of(node_process(NODE)) != patient.pid
        wait_until(is_new, PATIENCE_S, "there is a new node")
        return takeover

    def end(self) -> None:
        ask_to_leave(self._launch, 30.0)


def _once_over(consumers: Consumers, failed_at: float, period: float) -> Takeover:
    """Return what was heard of a failure, as soon as it is over."""
    look = lambda: measured(consumers, failed_at, time.monotonic(), period)
    wait_until(lambda: look().over_ms != NEVER, PATIENCE_S, "the topic is as it was")
    return look()


class ByHand:
    """`rosrun` of a rospy node: from the command to the first message. The yardstick for cold."""

    period = 0.02

    def __init__(self, graph: Graph, consumers: Consumers) -> None:
        self._graph = graph
        self._consumers = consumers

    def await_well(self) -> None:
        wait_until(lambda: not publishers(TOPIC), PATIENCE_S, "nobody publishes")

    def fail(self) -> Takeover:
        started = time.monotonic()
        process = self._graph.start(
            *("rosrun", "shsa_testing", "faulty_publisher"), *talker(NODE, TOPIC, 1.0, self.period)
        )
        self._consumers.await_node(NODE, started)
        rospy_at, roscpp_at = (consumer.since(started)[0].at for consumer in self._consumers)
        shut_down(NODE)
        process.wait(PATIENCE_S)
        return Takeover(1e3 * (rospy_at - started), 1e3 * (roscpp_at - started))

    def end(self) -> None:
        pass
