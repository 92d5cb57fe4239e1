"""Conducts the demonstration: kills the amperemeter, and brings it back."""
import os
import signal
import subprocess

import rosnode
import rospy
from shsa_msgs.msg import Float64Stamped


def main() -> None:
    """Run the conductor node; it ends the launch that it belongs to.

    Parameters: `~kill_at`, `~return_at`, `~end_at`: s since the first battery current.
    """
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
    rospy.loginfo("DEMO: rosrun shsa_rover amperemeter")
    subprocess.Popen(["rosrun", "shsa_rover", "amperemeter"])
    rospy.sleep(start + end_at - rospy.get_time())
    rospy.loginfo("DEMO: that is all.")
    os.kill(os.getppid(), signal.SIGINT)  # roslaunch: it ends the launch
    rospy.spin()
