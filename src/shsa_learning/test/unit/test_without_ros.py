"""Recordings are read, learned from and explained without ROS, as far as they are no bags."""
from pathlib import Path

from shsa_testing.importing import import_without

ROOT = Path(__file__).resolve().parents[2] / "src" / "shsa_learning"
ROS = "genpy,rosbag,rosgraph,roslib,rospy,shsa_msgs,std_msgs"


def test_all_modules_but_the_shells_can_be_imported_without_ros() -> None:
    parts = [path.relative_to(ROOT.parent).with_suffix("").parts for path in ROOT.rglob("*.py")]
    names = [".".join(each) for each in parts if each[1] != "ros" and each[-1] != "__init__"]
    assert "shsa_learning.cli.learn" in names
    assert import_without(ROS, names) == (0, "")
