"""Asks a running monitor what it has measured of what would replace its services."""
import rospy
from shsa_msgs import msg

from shsa_core.errors import ShsaError
from shsa_core.planning.planner import Calibrations
from shsa_core.ros.wire import names
from shsa_core.ros.wire.healing import calibrations_heard

PATIENCE_S = 5.0


def calibrations() -> Calibrations:
    """Return the calibrations of healing as it runs here. Raises ShsaError if none is heard."""
    rospy.init_node("shsa_find", anonymous=True, disable_signals=True, disable_rostime=True)
    topic = rospy.resolve_name(names.CALIBRATIONS)
    try:
        table = rospy.wait_for_message(topic, msg.Calibrations, PATIENCE_S)
    except rospy.ROSException as error:
        raise ShsaError(f"no monitor tells on {topic} what it has measured: {error}") from error
    found = Calibrations()
    for row in calibrations_heard(table).rows:
        found.add(row, healing=False)
    return found
