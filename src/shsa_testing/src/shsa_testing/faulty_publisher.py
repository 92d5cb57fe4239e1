"""A node that fails on command (`rosrun shsa_testing faulty_publisher`), and a test's handle."""
import errno
import math
import random
import socket
import subprocess
import sys
import threading
import time
from functools import partialmethod
from urllib.parse import urlparse

import rosgraph
import rospy
from rospy.impl import registration
from rospy.impl.masterslave import ROSHandler
from shsa_msgs.msg import Float64Stamped
from std_msgs.msg import Header

from shsa_core.ros.rospy_patches.inbound import only_if_meant
from shsa_testing.processes import end_process
from shsa_testing.waiting import wait_until


BETWEEN = 5
"""Messages between two silences."""


class Silences:
    """Short silences, again and again, of `least` to `most` periods; 0: none."""

    def __init__(self, least: int = 0, most: int = 0) -> None:
        self._bounds = (least, most)
        self._left = 0

    def skip(self) -> bool:
        """Return whether the message that is due now is left out."""
        if not self._bounds[1]:
            return False
        if not self._left:
            # A pause of n periods lacks n - 1 messages.
            self._left = random.randint(*self._bounds) - 1 + BETWEEN
        self._left -= 1
        return self._left >= BETWEEN


def _address(node: str) -> str:
    """Return the socket on which a node hears its faults: ROS, and so healing, sees none of it.

    It is an abstract one: no file outlives a killed node, to be in the way of another user's.
    """
    port = urlparse(rosgraph.get_master_uri()).port
    return f"\0shsa_fault_{port}{node}"


class FaultyPublisher:
    """Publishes shsa_msgs/Float64Stamped and obeys what a FaultHandle tells it.

    Parameters: ~topic, ~period in s, ~value, ~frame, ~mute, ~well (another topic, on which it
    publishes the first value and never fails), ~ros_time (its period is of ROS time), ~takes (a
    topic that it subscribes to), ~farewell (a file that it writes 3 s after it was told to leave).

    Commands: `value X`, `period S`, `stamp S` (seconds added to the stamp), `ramp X` (added to the
    value at every message), `noise X` (of each message, a standard deviation), `nan N` (every Nth
    value, 0: none), `intermittent LEAST MOST` (silences of so many periods, at random, with five
    messages between them), `mute`, `publish`, `burst N`, `unadvertise`, `advertise`, `leave`.
    """

    def __init__(self) -> None:
        # By masters of robots beside.
        ROSHandler.shutdown = partialmethod(only_if_meant, ROSHandler.shutdown)
        registration.is_shutdown = rospy.core.is_shutdown_requested  # see `standing.py`
        self.topic = rospy.get_param("~topic", "/watched")
        self.period = rospy.get_param("~period", 0.02)
        self.value = rospy.get_param("~value", 1.0)
        self.frame = rospy.get_param("~frame", "")
        self.mute = rospy.get_param("~mute", False)
        self.noise = rospy.get_param("~noise", 0.0)
        self.ros_time = rospy.get_param("~ros_time", False)
        self.stamp = self.ramp = self.nan = 0.0
        self.count = 0
        self.silences = Silences()
        self.publisher = self.advertise()
        self.well_topic, self.well_value = rospy.get_param("~well", ""), self.value
        if self.well_topic:
            self.well = rospy.Publisher(self.well_topic, Float64Stamped, queue_size=100)
        takes, self.farewell = rospy.get_param("~takes", ""), rospy.get_param("~farewell", "")
        if takes:
            rospy.Subscriber(takes, rospy.AnyMsg)
        self.faults = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        threading.Thread(target=self.listen, daemon=True).start()

    def advertise(self) -> rospy.Publisher:
        """Advertise the topic."""
        return rospy.Publisher(self.topic, Float64Stamped, queue_size=100, tcp_nodelay=True)

    def listen(self) -> None:
        """Obey each command that comes, as soon as no older node of the name hears them."""
        while not self._bound():
            time.sleep(0.01)
        while True:
            self.obey(self.faults.recv(1000).decode())

    def _bound(self) -> bool:
        try:
            self.faults.bind(_address(rospy.get_name()))
        except OSError as error:
            if error.errno != errno.EADDRINUSE:
                raise
            return False
        return True

    def obey(self, command: str) -> None:
        """Fail as commanded."""
        word, _, argument = command.partition(" ")
        if word == "unadvertise":
            self.mute = True
            self.publisher.unregister()
        elif word == "advertise":
            self.publisher = self.advertise()
            self.mute = False
        elif word == "burst":
            for _ in range(int(argument)):
                self.publish()
        elif word == "intermittent":
            self.silences = Silences(*map(int, argument.split()))
        elif word == "leave":
            rospy.signal_shutdown("it was told to leave")
        elif word in ("mute", "publish"):
            self.mute = word == "mute"
        elif word in ("value", "period", "stamp", "ramp", "noise", "nan"):
            setattr(self, word, float(argument))
        else:
            rospy.logerr("No such fault: %s", command)

    def publish(self) -> None:
        """Publish once."""
        stamp = rospy.Time.from_sec(rospy.get_time() + self.stamp)
        self.value += self.ramp
        self.count += 1
        value = self.value + random.gauss(0.0, self.noise)
        if self.nan and self.count % self.nan == 0:
            value = math.nan
        header = Header(stamp=stamp, frame_id=self.frame)
        self.publisher.publish(Float64Stamped(header=header, data=value))

    def spin(self) -> None:
        """Publish until the node is asked to end."""
        due = time.monotonic()
        while not rospy.is_shutdown():
            if not self.silences.skip() and not self.mute:
                self.publish()
            if self.well_topic:
                self.well.publish(Float64Stamped(data=self.well_value))
            if self.ros_time:
                rospy.sleep(self.period)
                continue
            due = max(due + self.period, time.monotonic())
            rospy.rostime.wallsleep(max(0.0, due - time.monotonic()))


class FaultHandle:
    """Makes a running `faulty_publisher` fail."""

    def __init__(self, name: str) -> None:
        self.name = name

    def fault(self, command: str) -> float:
        """Make it fail as `command` says; when that was sent, in s of the monotonic clock."""
        wait_until(lambda: self._send(command), 10.0, f"{self.name} listens to faults")
        return self._sent

    def _send(self, command: str) -> bool:
        self._sent = time.monotonic()
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
            try:
                sender.sendto(command.encode(), _address(self.name))
            except ConnectionRefusedError:
                return False  # it is not up yet
        return True


class FaultyNode(FaultHandle):
    """A `faulty_publisher` in a process of its own."""

    def __init__(self, name: str, topic: str, **parameters: object) -> None:
        command = [sys.executable, "-m", "shsa_testing.faulty_publisher", f"__name:={name[1:]}"]
        command += [f"_topic:={topic}", *(f"_{key}:={value}" for key, value in parameters.items())]
        self.process = subprocess.Popen(command)
        super().__init__(name)

    def end(self) -> None:
        """Kill it for certain."""
        end_process(self.process)


def main() -> None:
    """Run the node."""
    rospy.init_node("faulty_publisher")
    node = FaultyPublisher()
    try:
        node.spin()
    finally:
        if node.farewell:
            time.sleep(3.0)
            open(node.farewell, "w").close()


if __name__ == "__main__":
    main()
