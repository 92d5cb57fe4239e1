"""The core knows no ROS: every module of it can be imported where there is none."""
import pathlib
import subprocess
import sys
from typing import List, Tuple

CORE = pathlib.Path(__file__).resolve().parents[2] / "src" / "shsa_core"

SCRIPT = """
import importlib, sys

FORBIDDEN = {
    "actionlib", "catkin", "genpy", "rosbag", "rosgraph", "roslaunch", "roslib", "rosnode", "rosparam",
    "rospkg", "rospy", "rostopic", "rosservice", "shsa_msgs", "std_msgs", "xmlrpc",
}

class Blocker:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in FORBIDDEN:
            raise ImportError("the core must not import " + name)

sys.meta_path.insert(0, Blocker())
for name in sys.argv[1:]:
    importlib.import_module(name)
assert not FORBIDDEN & {name.split(".")[0] for name in sys.modules}
"""


def run(names: List[str]) -> Tuple[int, str]:
    process = subprocess.run(
        [sys.executable, "-c", SCRIPT, *names],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    return process.returncode, process.stdout


def test_every_module_of_the_core_can_be_imported_without_ros() -> None:
    names = ["shsa_core." + path.stem for path in CORE.glob("*.py") if path.stem != "__init__"]
    names += ["shsa_core.cli." + path.stem for path in (CORE / "cli").glob("[!_]*.py")]
    assert "shsa_core.search" in names and "shsa_core.cli.check" in names
    assert run(names) == (0, "")


def test_the_block_works() -> None:
    status, printed = run(["rospy"])
    assert status != 0 and "the core must not import rospy" in printed
