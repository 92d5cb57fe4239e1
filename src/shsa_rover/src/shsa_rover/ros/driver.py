"""`driver`: replays a scripted drive on `/cmd_vel`."""
import argparse
import sys
import time

import rospy

from shsa_core.files.regular import read_text
from shsa_core.ros.node import run
from shsa_rover.drive import SCRIPTED, Drive, parse_drive
from shsa_rover.ros.parameters import flag_parameter
from shsa_rover.ros.velocity_commands import VelocityCommands

PERIOD_S = 0.05
MAX_BYTES = 1_000_000


def load_drive(path: str, loop: bool) -> Drive:
    """Return the drive in the file `path`, or the built-in one for an empty path."""
    if not path:
        return Drive(SCRIPTED, loop)
    return Drive(parse_drive(read_text(path, MAX_BYTES).splitlines(), path), loop)


def serve(script: str) -> None:
    """Drives until the node shuts down, and stops the rover then."""
    drive = load_drive(script, flag_parameter("~loop", True))
    commands = VelocityCommands()
    rospy.loginfo("Driving a script of %g s%s.", drive.duration, ", again and again" * drive.loop)
    start = due = time.monotonic()
    while not rospy.is_shutdown():
        commands.give(*drive.command(time.monotonic() - start))
        due = max(due + PERIOD_S, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))


def main() -> None:
    """The node's entry point."""
    parser = argparse.ArgumentParser(prog="driver", description=__doc__)
    parser.add_argument(
        "--script", default="", help="the file of the drive; empty: the built-in one"
    )
    script = parser.parse_args(rospy.myargv(sys.argv)[1:]).script
    run("driver", lambda: serve(script))
