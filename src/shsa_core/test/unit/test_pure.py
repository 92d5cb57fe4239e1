"""The core knows no ROS, and every import goes to a lower part."""
import ast
import pathlib
from typing import Dict, Iterator, Set, Tuple

import pytest

from shsa_testing.importing import import_without

SOURCE = pathlib.Path(__file__).resolve().parents[2] / "src"
PACKAGE = SOURCE / "shsa_core"
# Lower to higher; those in one row do not know one another.
ORDER = [
    ("text",),
    ("errors", "dispatch", "agenda", "table", "watch", "backlog"),
    ("message_types",),
    ("language",),
    ("model",),
    ("files",),
    ("search",),
    ("codegen",),
    ("journal",),
    ("derivations", "trust"),
    ("monitoring", "substitution"),
    ("planning",),
    ("healing",),
    ("hosts",),
    ("analysis",),
    ("cli",),
    ("ros.settings",),
    ("ros.clock", "ros.workers"),
    ("ros.master",),
    ("ros.rospy_patches",),
    ("ros.trust",),
    ("ros.messages", "ros.processes"),
    ("ros.sockets", "ros.wire"),
    ("ros",),
]
ROOT = "the package itself"
LEVEL = {part: level for level, row in enumerate([(ROOT,), *ORDER]) for part in row}
# The running nodes' cores read no file.
CORES = ("monitoring", "substitution", "healing", "hosts")
"""Connections and messages are the same whoever reads them."""
NO_FILES = ("search", "codegen", "derivations", "planning", "trust", *CORES)


def name_of(path: pathlib.Path) -> str:
    """The module in a file."""
    parts = path.relative_to(SOURCE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {name_of(path): path for path in sorted(PACKAGE.rglob("*.py"))}


def part_of(module: str) -> str:
    """The part that a module belongs to."""
    shell = ".".join(module.split(".")[1:3])
    if shell in LEVEL:
        return shell
    return module.split(".")[1] if "." in module else ROOT


def imports_of(module: str) -> Set[str]:
    """The modules of the package that a module imports, wherever in its text, also for types."""
    tree = ast.parse(MODULES[module].read_text("utf-8"))
    found: Set[str] = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
            found.update(name if name in MODULES else str(node.module) for name in names)
        elif isinstance(node, ast.Import):
            found.update(alias.name for alias in node.names)
    return found & set(MODULES)


def upward() -> Iterator[Tuple[str, str]]:
    for module in MODULES:
        for used in imports_of(module):
            own, other = part_of(module), part_of(used)
            if own != other and LEVEL[own] <= LEVEL[other]:
                yield module, used


def test_every_part_has_a_place_in_the_order() -> None:
    assert {part_of(module) for module in MODULES} <= set(LEVEL)


def test_no_module_imports_from_a_higher_part() -> None:
    assert sorted(upward()) == []


def test_the_cores_of_the_running_nodes_read_no_files() -> None:
    users = [m for m in MODULES if m.split(".")[1:2] and part_of(m) in NO_FILES]
    assert [m for m in users if any(part_of(used) == "files" for used in imports_of(m))] == []


def test_the_sockets_know_no_core_but_what_the_monitor_hears() -> None:
    users = [module for module in MODULES if part_of(module) == "ros.sockets"]
    used = {each for module in users for each in imports_of(module) if part_of(each) in CORES}
    assert {module.split(".", 1)[1] for module in used} == {"monitoring.events"}


def test_there_is_no_import_cycle() -> None:
    uses: Dict[str, Set[str]] = {module: imports_of(module) - {module} for module in MODULES}
    while uses:
        last = {module for module, used in uses.items() if not used}
        assert last, f"these import one another, or what does: {sorted(uses)}"
        uses = {module: used - last for module, used in uses.items() if module not in last}


ROS = (
    "actionlib,catkin,genpy,rosbag,rosgraph,roslaunch,roslib,rosnode,rosparam,rospkg,rospy,"
    "rosservice,rostopic,shsa_msgs,std_msgs,xmlrpc"
)
LIBRARIES = "matplotlib,pint,numpy"
NOT_NEEDED = (
    "sklearn,scipy,matplotlib,tqdm,rosbag,ruamel,jinja2,tabulate,"
    "shsa_gate,shsa_learning,shsa_testing,shsa_view"
)


def test_every_module_of_the_core_can_be_imported_without_ros() -> None:
    names = [name for name in MODULES if not name.startswith("shsa_core.ros")]
    assert "shsa_core.search.best" in names and "shsa_core.cli.main" in names
    assert import_without(ROS, names) == (0, "")


def test_the_package_needs_none_of_the_others_and_no_library_for_learning() -> None:
    assert import_without(NOT_NEEDED, list(MODULES)) == (0, "")


@pytest.mark.parametrize("part", NO_FILES)
def test_what_runs_on_the_robot_loads_no_library_for_drawing_or_analysing(part: str) -> None:
    names = [name for name in MODULES if name.startswith(f"shsa_core.{part}")]
    # Substitutes have no ontology, and start at once: they do without the graph as well.
    forbidden = LIBRARIES + ",networkx" if part == "substitution" else LIBRARIES
    assert import_without(forbidden, names) == (0, "")


def test_the_block_works() -> None:
    status, printed = import_without(ROS, ["rospy"])
    assert status != 0 and "import of rospy halted" in printed
