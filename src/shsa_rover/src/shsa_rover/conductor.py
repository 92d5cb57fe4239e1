"""Conducts the demonstration: kills the amperemeter, and brings it back."""
import argparse
import os
import signal
import subprocess
from typing import Tuple

import rosnode
import rospy
from shsa_msgs.msg import Float64Stamped

ENV_LOADER = "~/.ros/shsa_env"
"""The script that sets the environment of ROS on another computer; hosts_setup writes it."""


def command(computer: str) -> Tuple[str, ...]:
    """Return the command that starts the amperemeter on [USER@]HOST; here if that is empty."""
    node = ("rosrun", "shsa_rover", "amperemeter")
    # With a terminal (-tt), the node ends with the connection.
    there = ("ssh", "-tt", "-o", "BatchMode=yes", computer, ENV_LOADER)
    return (*there, *node) if computer else node


def main() -> None:
    """Run the conductor node; it ends the launch that it belongs to.

    Its argument `--on [USER@]HOST` says where the amperemeter is started again. Parameters:
    `~kill_at`, `~return_at`, `~end_at`: s since the first battery current.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--on", default="", metavar="[USER@]HOST", help="empty: here")
    again = command(parser.parse_args(rospy.myargv()[1:]).on)
    rospy.init_node("conductor")
    node = rospy.resolve_name("amperemeter")
    kill_at = float(rospy.get_param("~kill_at"))
    return_at = float(rospy.get_param("~return_at"))
    end_at = float(rospy.get_param("~end_at"))
    rospy.wait_for_message("battery_current", Float64Stamped)
    rospy.wait_for_message("battery_state", rospy.AnyMsg)
    start = rospy.get_time()
    rospy.loginfo("DEMO: the rover drives. In %g s its amperemeter dies.", kill_at)
    rospy.sleep(start + kill_at - rospy.get_time())
    rospy.loginfo("DEMO: rosnode kill %s", node)
    rosnode.kill_nodes([node])
    rospy.sleep(start + return_at - rospy.get_time())
    rospy.loginfo("DEMO: %s", " ".join(again))
    subprocess.Popen(again, stdin=subprocess.DEVNULL)
    rospy.sleep(start + end_at - rospy.get_time())
    rospy.loginfo("DEMO: that is all.")
    os.kill(os.getppid(), signal.SIGINT)  # roslaunch: it ends the launch
    rospy.spin()
