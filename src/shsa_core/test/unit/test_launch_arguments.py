"""Arguments that a launch file does not take are named, and no others."""
import re
import subprocess
import sys
from pathlib import Path
from typing import List
from xml.etree import ElementTree

import pytest

from shsa_core.ros.launch_arguments import unknown

ROOT = Path(__file__).resolve().parents[4]
LAUNCH = ROOT / "src" / "shsa_core" / "launch"
SHSA = str(LAUNCH / "shsa.launch")
MAIN = "from shsa_core.ros.launch_arguments import main; main()"
OUTER = """
<launch>
  <arg name="own" default="shsa.launch" /><arg name="fixed" value="1" />
  <group><arg name="within" default="2" /></group>
  <include file="{folder}/$(arg own)" pass_all_args="{passes}">
    <arg name="som" value="x" />
  </include>
</launch>
"""


def refused(*words: str) -> List[str]:
    return [name for name, _ in unknown(["/usr/bin/python3", "/usr/bin/roslaunch", *words])]


def test_a_wrong_name_is_refused_and_those_that_are_there_are_told() -> None:
    assert refused(SHSA, "ontology:=/o", "som:=/a:=b", "__name:=x", "hold_off:=2") == []
    ((name, taken),) = unknown(["roslaunch", "-p", "11322", SHSA, "methd:=orr", "--screen"])
    assert name == "methd" and {"method", "hold_off", "som"} < set(taken)


def test_the_name_that_was_meant_is_told_before_all_others(tmp_path: Path) -> None:
    """It was at the end of a line of some hundred characters, where nobody reads."""
    roslaunch = tmp_path / "roslaunch"
    code = "import subprocess, sys\n"
    code += f"subprocess.run([{sys.executable!r}, '-c', {MAIN!r}])"
    roslaunch.write_text(code)
    command = [sys.executable, str(roslaunch), SHSA, "veiw:=true"]
    done = subprocess.run(command, stderr=subprocess.PIPE, universal_newlines=True, check=True)
    assert done.stderr.startswith(
        "There is no argument veiw; did you mean view? There are actions,"
    )


@pytest.mark.parametrize("passes, ok", [("true", True), ("false", False)])
def test_what_is_passed_on_counts(tmp_path: Path, passes: str, ok: bool) -> None:
    file = tmp_path / "robot.launch"
    file.write_text(OUTER.format(folder=LAUNCH, passes=passes))
    assert refused(str(file), "own:=agent.launch", "within:=3", "fixed:=2") == ["fixed"]
    assert refused(str(file), "hold_off:=3") == ([] if ok else ["hold_off"])
    assert refused(str(file), "som:=y") == ["som"]
    assert refused(str(file), "own:=agent.launch", "sandbox:=x") == ([] if ok else ["sandbox"])
    assert refused(str(file), "own:=$(env FILE)", "x:=1") == ([] if ok else ["x"])


def test_nothing_slow_is_loaded_where_the_first_file_takes_all() -> None:
    text = "from shsa_core.ros.launch_arguments import unknown; import sys\n"
    text += f"assert unknown(['roslaunch', {SHSA!r}, 'ontology:=/o', 'som:=/s']) == []\n"
    text += "assert 'roslaunch' not in sys.modules"
    subprocess.run([sys.executable, "-c", text], check=True)


def test_other_commands_and_files_that_cannot_be_found_are_left_alone() -> None:
    assert unknown(["python3", "-m", "pytest", "x:=1"]) == []
    assert refused("no_package", "no.launch", "x:=1") == refused("x:=1") == []


FILES = [*ROOT.glob("[es]*/**/*.launch"), *ROOT.glob("[es]*/**/*.test")]


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_an_include_gives_what_the_included_file_takes(path: Path) -> None:
    for include in ElementTree.parse(str(path)).iter("include"):
        found = re.search(r"(shsa_\w+)\W.*?([\w.]+\.launch)", include.get("file", ""))
        if found is not None and include.get("pass_all_args") != "true":
            file = str(ROOT / "src" / found[1] / "launch" / found[2])
            given = [f"{each.get('name')}:=x" for each in include.iter("arg")]
            assert refused(file, *given) == []
