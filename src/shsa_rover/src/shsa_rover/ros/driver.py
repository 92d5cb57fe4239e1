"""`driver`: replays a scripted drive on `/cmd_vel`."""
import time

import rospy
from geometry_msgs.msg import Twist

from shsa_core.errors import ModelError
from shsa_core.ros.node import run
from shsa_rover.drive import SCRIPTED, Drive, parse_drive
from shsa_rover.ros.parameters import flag_parameter, text_parameter

PERIOD_S = 0.05


def load_drive(path: str, loop: bool) -> Drive:
    """The drive in the file `path`, or the built-in one for an empty path."""
    if not path:
        return Drive(SCRIPTED, loop)
    try:
        with open(path, encoding="utf-8") as file:
            return Drive(parse_drive(file, path), loop)
    except (OSError, UnicodeDecodeError) as error:
        raise ModelError(path, f"cannot be read: {error}") from error


def serve() -> None:
    """Drives until the node shuts down, and stops the rover then."""
    drive = load_drive(text_parameter("~script", ""), flag_parameter("~loop", True))
    publisher = rospy.Publisher("/cmd_vel", Twist, queue_size=1)
    rospy.on_shutdown(lambda: publisher.publish(Twist()))
    rospy.loginfo("Driving a script of %g s%s.", drive.duration, ", again and again" * drive.loop)
    start = due = time.monotonic()
    while not rospy.is_shutdown():
        command = Twist()
        command.linear.x, command.angular.z = drive.command(time.monotonic() - start)
        publisher.publish(command)
        due = max(due + PERIOD_S, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))


def main() -> None:
    """The node's entry point."""
    run("driver", serve)
