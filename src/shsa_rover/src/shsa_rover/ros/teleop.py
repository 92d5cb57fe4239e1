"""`teleop`: keys drive the rover."""
import os
import select
import sys
import termios
import time
import tty

import rospy

from shsa_core.ros.node import run
from shsa_rover.ros.velocity_commands import VelocityCommands
from shsa_rover.steering import HELP, Steering

PERIOD_S = 0.05


def serve() -> None:
    """Publishes `/cmd_vel` from the keys until q.

    Restores the terminal and stops the rover at the end.
    """
    commands = VelocityCommands()
    keys = sys.stdin.fileno()
    before = termios.tcgetattr(keys)
    print(HELP, flush=True)
    try:
        tty.setcbreak(keys)
        steer(commands, keys)
    finally:
        termios.tcsetattr(keys, termios.TCSADRAIN, before)


def steer(commands: VelocityCommands, keys: int) -> None:
    """Reads keys from the file descriptor `keys` until q, end of file or shutdown."""
    steering = Steering()
    due = time.monotonic()
    while not rospy.is_shutdown():
        wait = max(0.0, due - time.monotonic())
        if select.select([keys], [], [], wait)[0]:
            pressed = os.read(keys, 64)
            if not pressed or not steering.press(pressed.decode("ascii", "ignore")):
                return
            continue
        due = time.monotonic() + PERIOD_S
        commands.give(steering.velocity, steering.turn_rate)


def main() -> None:
    """The node's entry point.

    It needs a terminal, and without one says so before it asks for a master.
    """
    if not sys.stdin.isatty():
        sys.exit(
            "teleop needs a terminal to read keys from: start it by itself with"
            " 'rosrun shsa_rover teleop', or let the script drive with drive:=true"
        )
    run("teleop", serve)
