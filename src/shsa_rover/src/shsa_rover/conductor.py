"""Conducts the demonstration: kills the amperemeter, and brings it back."""
import argparse
import os
import signal
import subprocess
from typing import Dict, Tuple

import rosnode
import rospy
from shsa_msgs.msg import Float64Stamped, Incident

ENV_LOADER = "~/.ros/shsa_env"
"""The script that sets the environment of ROS on another computer; hosts_setup writes it."""
PATIENCE_S = 60.0
"""That healing may take longer on a busy computer than the times of the demonstration allow."""


def command(computer: str) -> Tuple[str, ...]:
    """Return the command that starts the amperemeter on [USER@]HOST; here if that is empty."""
    node = ("rosrun", "shsa_rover", "amperemeter")
    # With a terminal (-tt), the node ends with the connection.
    there = ("ssh", "-tt", "-o", "BatchMode=yes", computer, ENV_LOADER)
    return (*there, *node) if computer else node


def main() -> None:
    """Run the conductor node; it ends the launch that it belongs to.

    Its argument `--on [USER@]HOST` says where the amperemeter is started again. Parameters:
    `~kill_at`, `~return_at`, `~end_at`: s since the first battery current, or later: the original
    returns once a substitute publishes, and the launch ends with the incident.
    """
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--on", default="", metavar="[USER@]HOST", help="empty: here")
    again = command(parser.parse_args(rospy.myargv()[1:]).on)
    rospy.init_node("conductor")
    node = rospy.resolve_name("amperemeter")
    kill_at = float(rospy.get_param("~kill_at"))
    return_at = float(rospy.get_param("~return_at"))
    end_at = float(rospy.get_param("~end_at"))
    states: Dict[str, str] = {}
    heard = lambda incident: states.update({incident.faulty_node: incident.state})
    rospy.Subscriber("shsa/incidents", Incident, heard)

    def sleep_until(moment: float, *wanted: str) -> None:
        """Sleep until s since the start; on a busy computer, until the incident is that far."""
        rospy.sleep(start + moment - rospy.get_time())
        late = start + moment + PATIENCE_S
        while wanted and states.get(node) not in wanted and rospy.get_time() < late:
            rospy.sleep(0.1)

    rospy.wait_for_message("battery_current", Float64Stamped)
    rospy.wait_for_message("battery_state", rospy.AnyMsg)
    start = rospy.get_time()
    rospy.loginfo("DEMO: the rover drives. In %g s its amperemeter dies.", kill_at)
    sleep_until(kill_at)
    rospy.loginfo("DEMO: rosnode kill %s", node)
    rosnode.kill_nodes([node])
    sleep_until(return_at, Incident.HEALED)
    rospy.loginfo("DEMO: %s", " ".join(again))
    subprocess.Popen(again, stdin=subprocess.DEVNULL)
    sleep_until(end_at, Incident.ENDED)
    rospy.loginfo("DEMO: that is all.")
    os.kill(os.getppid(), signal.SIGINT)  # roslaunch: it ends the launch
    rospy.spin()
