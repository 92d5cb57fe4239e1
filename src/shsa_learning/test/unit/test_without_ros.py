"""Recordings are read, learned from and explained without ROS, as far as they are no bags."""
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2] / "src" / "shsa_learning"
ROS = "genpy,rosbag,rosgraph,roslib,rospy,shsa_msgs,std_msgs"
SCRIPT = """
import importlib, sys
sys.modules.update(dict.fromkeys(sys.argv[1].split(",")))  # importing one of them fails
for name in sys.argv[2:]:
    importlib.import_module(name)
"""


def test_all_modules_but_the_shells_can_be_imported_without_ros() -> None:
    parts = [path.relative_to(ROOT.parent).with_suffix("").parts for path in ROOT.rglob("*.py")]
    names = [".".join(each) for each in parts if each[1] != "ros" and each[-1] != "__init__"]
    assert "shsa_learning.cli.learn" in names
    subprocess.run([sys.executable, "-c", SCRIPT, ROS, *names], check=True)
