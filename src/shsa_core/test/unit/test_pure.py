"""The core knows no ROS: every module of it can be imported where there is none."""
import pathlib
import re
import subprocess
import sys
from typing import List, Tuple

CORE = pathlib.Path(__file__).resolve().parents[2] / "src" / "shsa_core"
MODULES = [path for path in sorted(CORE.rglob("[!_]*.py")) if "ros" not in path.parts[-3:]]
LAYERS = (
    ("__init__", "errors", "dispatch"),
    ("language",),
    ("model",),
    ("files",),
    ("search",),
    ("codegen",),
    ("monitoring", "substitution"),
    ("healing",),
    ("journal",),
    ("analysis",),
    ("cli",),
)
"""The parts of the core from the lowest to the highest; those of one layer do not know each other."""
CORES = ("monitoring", "substitution", "healing")
BENEATH = {
    part: {lower for layer in LAYERS[:number] for lower in layer}
    - ({"files"} if part in CORES else set())
    for number, layer in enumerate(LAYERS)
    for part in layer
}
"""What each part may use; the three machines read no files."""


def module(path: pathlib.Path) -> Tuple[str, ...]:
    """The names of a module within the package."""
    return path.relative_to(CORE).with_suffix("").parts


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
    names = [".".join(("shsa_core", *module(path))) for path in MODULES]
    assert "shsa_core.search.substitutes" in names and "shsa_core.cli.check" in names
    assert run(names) == (0, "")


def test_each_part_of_the_core_uses_only_those_beneath_it() -> None:
    for path in MODULES:
        part = module(path)[0]
        for used in re.findall(r"^from shsa_core\.(\w+)", path.read_text(), re.MULTILINE):
            assert used in (part, *BENEATH[part]), f"{path} uses {used}"


def test_the_block_works() -> None:
    status, printed = run(["rospy"])
    assert status != 0 and "the core must not import rospy" in printed
