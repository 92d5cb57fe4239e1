"""What of a graph a survey looks at: no names that nobody could use, and nothing of healing's."""
import re

from shsa_core.healing.naming import Names

_NAME = re.compile(r"(/[A-Za-z0-9_]+)+", re.ASCII)
_TYPE = re.compile(r"[A-Za-z][A-Za-z0-9_]*/[A-Za-z][A-Za-z0-9_]*", re.ASCII)
_LONGEST = 255
_OF_ROS = {
    "/rosout": "lines of the log",
    "/rosout_agg": "lines of the log",
    "/clock": "the simulated time: healing goes by it, and heals none",
    "/diagnostics": "for display: no decision should read it",
    "/diagnostics_agg": "for display: no decision should read it",
    "/diagnostics_toplevel_state": "for display: no decision should read it",
}
_ACTION = ("ActionGoal", "ActionResult", "ActionFeedback")
_PICTURES = (
    *("sensor_msgs/Image", "sensor_msgs/CompressedImage", "stereo_msgs/DisparityImage"),
    *("sensor_msgs/PointCloud", "sensor_msgs/PointCloud2", "nav_msgs/OccupancyGrid"),
    *("theora_image_transport/Packet", "sensor_msgs/CameraInfo", "visualization_msgs/MarkerArray"),
)
"""Many a node makes them only while somebody listens: a survey must not load the robot."""
_FRAMES = ("tf2_msgs/TFMessage", "tf/tfMessage")
_NAMES = Names("/")


def outside(topic: str, kind: str, node: str) -> str:
    """Why a publisher is no part of a survey; empty if it is. `node` may not be known: empty."""
    if not _NAME.fullmatch(topic) or len(topic) > _LONGEST:
        return "that is no full name of a topic"
    if topic in _OF_ROS:
        return _OF_ROS[topic]
    if "/shsa/" in topic:
        return "healing's own"
    if not _TYPE.fullmatch(kind) or len(kind) > _LONGEST:
        return "that is no type of messages"
    if kind.endswith(_ACTION) or kind.startswith("actionlib_msgs/"):
        return "an action is a dialogue with its server, not a value"
    if kind in _PICTURES:
        return "pictures, clouds, maps and their settings are not computed from numbers"
    if kind in _FRAMES:
        return "a tf frame has one parent: nobody else can publish it"
    if node and (not _NAME.fullmatch(node) or len(node) > _LONGEST):
        return "that is no full name of a node"
    return "a node of healing's" if node and _NAMES.of_healing(node, in_som=False) else ""
