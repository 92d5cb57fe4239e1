"""Velocity commands, of which a stop is the last."""
import threading
import time

import rospy
from geometry_msgs.msg import Twist

STOP_S = 0.5  # how long a node that ends may wait for consumers to be sent the stop
PAUSE_S = 0.01


class VelocityCommands:
    """Publishes `/cmd_vel`, and a stop when the node shuts down, after which nothing follows."""

    def __init__(self) -> None:
        self._publisher = rospy.Publisher("cmd_vel", Twist, queue_size=1)
        self._stopped = False
        self._lock = threading.Lock()
        rospy.on_shutdown(self._stop)

    def give(self, velocity: float, turn_rate: float) -> None:
        """Publish `velocity` (m/s) and `turn_rate` (rad/s), unless the rover was stopped."""
        command = Twist()
        command.linear.x, command.angular.z = velocity, turn_rate
        with self._lock:
            if not self._stopped:
                self._publisher.publish(command)

    def _stop(self) -> None:
        """Publish stops until each connection has written one; warn of those that do not in time.

        rospy closes connections with what still waits in their queues. A command may be on its
        way already, so two messages have to be written.
        """
        with self._lock:
            self._stopped = True
        end = time.monotonic() + STOP_S
        waiting = {each: each.stat_num_msg + 2 for each in self._publisher.impl.connections}
        while True:
            self._publisher.publish(Twist())
            time.sleep(PAUSE_S)
            waiting = {
                each: wanted
                for each, wanted in waiting.items()
                if each.stat_num_msg < wanted and not each.done
            }
            if not waiting:
                return
            if time.monotonic() > end:
                names = ", ".join(sorted(each.endpoint_id for each in waiting))
                text = "A stop on %s was not sent to %s: it does not read what it is sent."
                rospy.logwarn(text, self._publisher.resolved_name, names)
                return
