"""The kinds of node of docs/explanation/killing.md, as real nodes with their duties, and faults.

`python3 -m shsa_testing.killing_table` is one of these nodes: a `faulty_publisher` with duties.
"""
import os
import random
import shutil
import subprocess
import sys
from enum import Enum
from typing import Callable, List, NamedTuple, Optional, Tuple

import actionlib
import psutil
import rospy
from actionlib.msg import TestAction, TestGoal
from geometry_msgs.msg import TransformStamped, Twist
from shsa_msgs.msg import Float64Stamped
from shsa_msgs.srv import Release, ReleaseResponse

from shsa_testing.faulty_publisher import FaultHandle, FaultyPublisher
from shsa_testing.graph import node_process
from shsa_testing.processes import end_process, running

PERIOD_S, BABBLES_S = 0.05, 0.01
GOOD, WRONG = 10.0, 999.0
SELDOM = 0.7
"""Of the ticks of an event source, at random, are without an event."""
MAP_TICKS = 10
"""Between two maps."""
NOBODY = ("setpriv", "--reuid=nobody", "--clear-groups")


class Outcome(Enum):
    """The cells of the table."""

    HEALED = "healed"
    BESIDE = "healed beside it"
    ENDED = "ended, healed"
    KEPT = "kept, advice only"
    GATED = "kept, healed at the gate"
    UNSEEN = "nothing: it has no rate"


class Kind(NamedTuple):
    """A kind of node; `kept_for`: words of the decision to keep it. `duties`: beyond its topic.

    `eventful`: its topic has no rate. `launched`: roslaunch starts it, and again if `comes_back`.
    """

    words: str
    name: str
    kept_for: str = ""
    duties: Tuple[str, ...] = ()
    eventful: bool = False
    launched: bool = False
    comes_back: bool = False

    @property
    def node(self) -> str:
        """Return the name of its node."""
        return f"/{self.name}_node"

    @property
    def gated(self) -> bool:
        """Return true if it is behind a gate."""
        return self.name == "gated"

    @property
    def topic(self) -> str:
        """Return the topic that its node publishes."""
        return f"/{self.name}/raw" if self.gated else f"/{self.name}"

    def expected(self, fault: str) -> Outcome:
        """Return what the table says of a fault."""
        if fault in ("crash", "clean end"):
            return Outcome.HEALED
        if self.eventful and fault != "wrong":
            return Outcome.UNSEEN
        if fault in ("hang", "silent"):
            return Outcome.BESIDE
        if self.gated:
            return Outcome.GATED
        return Outcome.KEPT if self.kept_for else Outcome.ENDED


KINDS = (
    Kind("pure sensor", "sensor"),
    Kind("base driver", "base", "it takes /cmd_vel", ("commands", "tf", "service")),
    Kind("required node", "required", 'its launch file says required="true"', launched=True),
    Kind("latched map", "map", eventful=True),
    Kind("tf broadcaster", "frames", "it broadcasts tf", ("tf",)),
    Kind("node of another user", "foreign"),
    Kind("node behind a gate", "gated", "a gate keeps from consumers"),
    Kind("driver with two topics", "driver", "would cost /second", ("second",)),
    Kind("nodelet manager", "nodelets", "its process is a nodelet manager"),
    Kind("event source", "events", eventful=True),
    Kind("action server", "mover", "it serves the action /move", ("action",)),
    Kind("node under respawn", "respawned", launched=True, comes_back=True),
)
FAULTS = ("wrong", "babbling", "hang", "clean end", "crash", "silent")


class TableNode(FaultyPublisher):
    """A node with duties; parameters: ~duties, ~map, ~event."""

    def __init__(self) -> None:
        self.ticks, self.commanded = 0, 0.0
        self.seldom = rospy.get_param("~event", False)
        super().__init__()
        self.duties: List[Callable[[], None]] = []
        for duty in rospy.get_param("~duties", "").split():
            getattr(self, f"_begin_{duty}")()

    def advertise(self) -> rospy.Publisher:
        """Advertise the topic; of a map it is latched."""
        self.latched = rospy.get_param("~map", False)
        return rospy.Publisher(self.topic, Float64Stamped, queue_size=100, latch=self.latched)

    def publish(self) -> None:
        """Publish once, if there is anything new."""
        self.ticks += 1
        if self.latched and self.ticks % MAP_TICKS:
            return
        if self.seldom and random.random() < SELDOM:
            return
        super().publish()

    def _begin_commands(self) -> None:
        def take(command: Twist) -> None:
            self.commanded = command.linear.x

        rospy.Subscriber("/cmd_vel", Twist, take)

    def _begin_tf(self) -> None:
        publisher = rospy.Publisher("/tf", TransformStamped, queue_size=10)

        def broadcast(_: rospy.timer.TimerEvent) -> None:
            told = TransformStamped(child_frame_id=rospy.get_name())
            told.transform.translation.x = self.commanded
            publisher.publish(told)

        rospy.Timer(rospy.Duration(PERIOD_S), broadcast)

    def _begin_service(self) -> None:
        rospy.Service("~stop", Release, lambda _: ReleaseResponse(success=True))

    def _begin_second(self) -> None:
        publisher = rospy.Publisher("/second", Float64Stamped, queue_size=10)
        tell = lambda _: publisher.publish(Float64Stamped(data=GOOD))
        rospy.Timer(rospy.Duration(PERIOD_S), tell)

    def _begin_action(self) -> None:
        def move(goal: TestGoal) -> None:
            server.set_succeeded()

        server = actionlib.SimpleActionServer("/move", TestAction, move, auto_start=False)
        server.start()


class TriedNode:
    """A node of a kind that fails, and is mended after that."""

    def __init__(self, kind: Kind, folder: str, launch: str = "") -> None:
        self.kind, self._folder = kind, folder
        self._launch = launch
        self._faults = FaultHandle(kind.node)
        self._started: Optional["subprocess.Popen[bytes]"] = None
        self.process: Optional[psutil.Process] = None
        """As it was before its fault."""

    def start(self) -> None:
        """Start it unless it runs, or is started by roslaunch anyway."""
        if node_process(self.kind.node) is not None or (self.kind.launched and not self._launch):
            return
        self.end()
        if self._launch:
            self._started = subprocess.Popen(["roslaunch", self._launch, f"period:={PERIOD_S}"])
            return
        name = self.kind.name
        given = {
            "topic": self.kind.topic,
            "value": GOOD,
            "period": PERIOD_S,
            "duties": " ".join(self.kind.duties),
            "map": name == "map",
            "event": name == "events",
        }
        words = [f"__name:={name}_node", *(f"_{key}:={value}" for key, value in given.items())]
        program, before = sys.executable, []
        if name == "foreign":
            shutil.chown(self._folder, "nobody")
            before = [*NOBODY, "env", f"HOME={self._folder}", f"ROS_LOG_DIR={self._folder}"]
        if name == "nodelets":  # by its words the process is a manager of nodelets
            script = os.path.join(self._folder, "manager")
            with open(script, "w", encoding="utf-8") as file:
                file.write("from shsa_testing.killing_table import main\n\nmain()\n")
            command = ["nodelet", script, *words]
        else:
            command = [*before, program, "-m", "shsa_testing.killing_table", *words]
        executable = None if before else program
        self._started = subprocess.Popen(command, executable=executable)

    def fail(self, fault: str) -> None:
        """Let it fail."""
        self.process = node_process(self.kind.node)
        assert self.process is not None, f"{self.kind.node} is up"
        if fault == "crash":
            self.process.kill()
        elif fault == "hang":
            self.process.suspend()
        else:
            # Two nodes that are out of range together accuse the SOM.
            wrong = WRONG if KINDS.index(self.kind) < len(KINDS) // 2 else float("nan")
            said = {
                "clean end": "leave",
                "wrong": f"value {wrong}",
                "babbling": f"period {BABBLES_S}",
                "silent": "mute",
            }
            self._faults.fault(said[fault])

    @property
    def lives(self) -> bool:
        """True if the process that failed still runs, or is stopped."""
        return self.process is not None and running(self.process)

    def mend(self) -> None:
        """Undo its fault; start it again if it has ended."""
        if self.lives:
            assert self.process is not None
            self.process.resume()
            for command in (f"value {GOOD}", f"period {PERIOD_S}", "publish"):
                self._faults.fault(command)
        self.start()

    def end(self) -> None:
        """End it for certain."""
        if self._started is not None:
            if self._launch and self._started.poll() is None:
                for node in psutil.Process(self._started.pid).children():
                    node.kill()  # one that hangs is waited for by roslaunch
                self._started.terminate()
                self._started.wait()
            end_process(self._started)


def main() -> None:
    """Run a node."""
    rospy.init_node("killing_table")
    TableNode().spin()


if __name__ == "__main__":
    main()
