"""The gate's core needs no ROS, and nothing that is slow to load."""
from pathlib import Path

from shsa_testing.importing import import_without

ROOT = Path(__file__).resolve().parents[2] / "src" / "shsa_gate"
FILES_AND_SHELLS = "shsa_core.files,shsa_core.ros,yaml,"
FORBIDDEN = (
    FILES_AND_SHELLS
    + "genpy,matplotlib,networkx,numpy,pint,rosgraph,roslib,rospy,shsa_msgs,std_msgs"
)


def test_the_core_loads_without_ros_and_without_large_libraries() -> None:
    names = [f"shsa_gate.{path.stem}" for path in ROOT.glob("*.py") if path.stem != "__init__"]
    assert "shsa_gate.machine" in names
    assert import_without(FORBIDDEN, names) == (0, "")
