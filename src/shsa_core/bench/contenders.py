"""What can be done about a failed node: healing, respawn, or starting it by hand."""
import os
import signal
import time
from typing import Callable, Dict, Protocol, TypeVar

from tqdm import tqdm

from graph import PATIENCE_S, Graph, ask_to_leave, shut_down
from robot import NODE, TOPIC, Consumers, HealthyRobot, talker
from shsa_testing.graph import node_pid, node_process, publishers
from shsa_testing.waiting import wait_until
from takeover import Takeover, gap, healed

MISSES = 5
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


def kill_hard(robot: HealthyRobot) -> None:
    """`kill -9`."""
    robot.failing.kill()


def stop(robot: HealthyRobot) -> None:
    """Hang."""
    robot.failing.send_signal(signal.SIGSTOP)


def leave(robot: HealthyRobot) -> None:
    """`rosnode kill`."""
    shut_down(NODE)


def leave_range(robot: HealthyRobot) -> None:
    """Send nonsense."""
    robot.fault.publish("value 1000")


FAULTS: Dict[str, Callable[[HealthyRobot], None]] = {
    "kill -9": kill_hard,
    "rosnode kill": leave,
    "SIGSTOP": stop,
    "out of range": leave_range,
}


class Healed:
    """The small robot, healed."""

    def __init__(
        self,
        graph: Graph,
        consumers: Consumers,
        standby: str,
        period: float,
        fault: Callable[[HealthyRobot], None],
    ) -> None:
        self.period = period
        self._consumers = consumers
        self._robot = HealthyRobot(graph, consumers, standby, period)
        self._fault = fault

    def await_well(self) -> None:
        self._robot.await_well()
        wait_until(
            lambda: self._robot.fault.get_num_connections() == 1,
            PATIENCE_S,
            "obedience of the node",
        )

    def fail(self) -> Takeover:
        takeover = self.take_over()
        self.bring_back()
        return takeover

    def take_over(self) -> Takeover:
        """Fail once, without coming back. Raises AssertionError if the topic is not healed."""
        before = self._robot.healing.latest(TOPIC)
        number = 0 if before is None else before.id
        failed_at = time.monotonic()
        self._fault(self._robot)

        def is_healed() -> bool:
            incident = self._robot.healing.latest(TOPIC)
            return incident is not None and incident.id > number and incident.state == "healed"

        wait_until(is_healed, PATIENCE_S, "the topic is healed")
        incident = self._robot.healing.latest(TOPIC)
        assert incident is not None
        self._consumers.await_node(incident.substitute, failed_at)
        return healed(self._consumers, failed_at, incident)

    def bring_back(self) -> None:
        """Start the node again."""
        self._robot.bring_back()

    def end(self) -> None:
        self._robot.end()


class Respawned:
    """A node under roslaunch's `respawn="true"`, and no healing."""

    period = 0.02

    def __init__(self, graph: Graph, consumers: Consumers, executable: str) -> None:
        self._consumers = consumers
        package, arguments = "shsa_core", f"{TOPIC} {self.period}"
        if executable == "faulty_publisher":
            package = "shsa_testing"
            arguments = " ".join(talker(NODE, TOPIC, 1.0, self.period)[:-1])
        path = graph.folder / "respawn.launch"
        names = {"package": package, "executable": executable, "name": NODE[1:]}
        path.write_text(LAUNCH.format(arguments=arguments, **names))
        self._launch = graph.start("roslaunch", str(path))

    def await_well(self) -> None:
        wait_until(lambda: node_process(NODE) is not None, PATIENCE_S, "the node is up")
        self._consumers.await_node(NODE, time.monotonic())
        for consumer in self._consumers:
            consumer.forget()

    def fail(self) -> Takeover:
        pid = node_pid(NODE)
        failed_at = time.monotonic()
        os.kill(pid, signal.SIGKILL)
        wait_until(lambda: node_process(NODE) is not None, PATIENCE_S, "the node is up again")
        for consumer in self._consumers:
            wait_until(
                lambda: len(consumer.since(failed_at)) > 5, PATIENCE_S, f"{consumer.node} hears it"
            )
        rospy_ms, roscpp_ms = (gap(consumer, failed_at) for consumer in self._consumers)
        return Takeover(rospy_ms, roscpp_ms)

    def end(self) -> None:
        ask_to_leave(self._launch, 30.0)


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
