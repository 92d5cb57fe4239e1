"""`shsa check` looks at message types as they are installed here."""
import json
import os
import pathlib
import subprocess
import sys
from typing import Any, List, Tuple

import pytest

from shsa_core import message_types
from shsa_core.cli.main import main
from shsa_core.errors import ShsaError
from shsa_learning.check import check_files
from shsa_learning.type_check import available, is_service, types_beside

PACKAGES = pathlib.Path(__file__).resolve().parents[3]
SOURCES = [str(PACKAGES / name / "src") for name in ("shsa_core", "shsa_learning")]
needs_ros = pytest.mark.skipif(not available(), reason="there is no ROS here")

ONTOLOGY = "properties: {a: {}, b: {}}\nrelations: {same: {a: b, b: a}}\n"
SOM = """\
services:
  one: {{topic: /one, type: {type}, node: /one, period: 0.1, needed: {needed},
        provides: {{a: {value}}}}}
  two: {{topic: /two, type: std_msgs/Float64, node: /two, period: 0.1,
        provides: {{b: {{field: data}}}}}}
"""


def files(folder: pathlib.Path, type: str, value: str, needed: bool) -> Tuple[str, str]:
    ontology, som = folder / "o.yaml", folder / "s.yaml"
    ontology.write_text(ONTOLOGY)
    som.write_text(SOM.format(type=type, value=value, needed=str(needed).lower()))
    return str(ontology), str(som)


def found(
    folder: pathlib.Path, type: str, value: str, needed: bool = True
) -> List[Tuple[str, str]]:
    findings = check_files(*files(folder, type, value, needed), message_types)
    return [(each.level, each.what) for each in findings]


def value(field: str, limits: str = "") -> str:
    return f'{{field: "{field}"{", range: " + limits if limits else ""}}}'


@needs_ros
def test_a_type_that_is_not_there_is_named_at_its_line(tmp_path: pathlib.Path) -> None:
    ontology, som = files(tmp_path, "nav_msgs/Odometri", value("data"), True)
    text = pathlib.Path(som).read_text().replace(" type: nav", "\n        type: nav")
    pathlib.Path(som).write_text(text)
    (finding,) = check_files(ontology, som, message_types)
    assert finding.where == f"{som}:3"
    assert str(finding).endswith("; did you mean Odometry? Correct the type.")


@needs_ros
@pytest.mark.parametrize(
    "type, field",
    [
        ("nav_msgs/Odometry", "twist.twist.linear.x"),
        ("nav_msgs/Odometry", "yaw(pose.pose.orientation)"),
        ("nav_msgs/Odometry", "pose.covariance[35]"),
        ("sensor_msgs/JointState", "velocity[name=left_wheel]"),
        ("sensor_msgs/BatteryState", "power_supply_status"),
        ("std_msgs/Bool", "data"),
        ("std_msgs/UInt8", "data"),
        ("std_msgs/Float32", "data"),
        ("geometry_msgs/Pose", "yaw(orientation)"),
    ],
)
def test_what_is_there_is_fine(tmp_path: pathlib.Path, type: str, field: str) -> None:
    for limits in ("", "[0, 1]"):
        assert found(tmp_path, type, value(field, limits)) == []


@needs_ros
@pytest.mark.parametrize(
    "type, field, limits, words",
    [
        ("nav_msgs/Odometri", "data", "", "no message type Odometri; did you mean Odometry?"),
        ("nav_msgs/Foo", "data", "", "no message type Foo; it has GetMap"),
        ("nowhere_msgs/Thing", "data", "", "the package nowhere_msgs of nowhere_msgs/Thing is not"),
        ("nav_msgs/GetMap", "map", "", "is the type of a ROS service"),
        ("sensor_msgs/NavSatFix", "latitud", "", "did you mean latitude?"),
        ("sensor_msgs/NavSatFix", "latitude[0]", "", "latitude is not an array"),
        ("sensor_msgs/NavSatFix", "header.frame_id", "", "is a string, not a number"),
        ("sensor_msgs/NavSatFix", "position_covariance", "", "is an array"),
        ("sensor_msgs/NavSatFix", "position_covariance[9]", "", "whose last place is 8"),
        ("sensor_msgs/LaserScan", "min(ranges)", "", "is read-only: nothing can publish it"),
        ("std_msgs/UInt8", "data", "[-1, 10]", "goes beyond what data can hold"),
        ("std_msgs/Bool", "data", "[0, 2]", "goes beyond what data can hold"),
        ("std_msgs/Float32", "data", "[0, 1.0e+39]", "goes beyond what data can hold"),
        ("geometry_msgs/Pose", "yaw(orientation)", "[0, 6.3]", "beyond what yaw(orientation) can"),
    ],
)
def test_what_is_not_there_is_an_error_and_a_range_beyond_a_type_a_warning(
    tmp_path: pathlib.Path, type: str, field: str, limits: str, words: str
) -> None:
    ((level, what),) = found(tmp_path, type, value(field, limits))
    assert level == ("warning" if limits else "error") and words in what


@needs_ros
def test_what_nobody_needs_may_be_read_alone_or_not_be_built(tmp_path: pathlib.Path) -> None:
    assert found(tmp_path, "sensor_msgs/LaserScan", value("min(ranges)"), needed=False) == []
    ((level, what),) = found(tmp_path, "nowhere_msgs/Thing", value("data"), needed=False)
    assert level == "warning" and "neither checked nor used" in what


@pytest.mark.parametrize("policy, level", [("restart", []), ("restart_and_substitute", ["error"])])
def test_what_is_only_started_again_may_be_read_alone(
    tmp_path: pathlib.Path, policy: str, level: List[str]
) -> None:
    ontology, som = files(tmp_path, "sensor_msgs/LaserScan", value("min(ranges)"), True)
    text = pathlib.Path(som).read_text().replace("needed: true", f"needed: true, policy: {policy}")
    pathlib.Path(som).write_text(text)
    findings = check_files(ontology, som)
    assert [each.level for each in findings if each.level == "error"] == level
    assert bool(findings) == bool(level)


@needs_ros
def test_a_range_a_little_beyond_pi_is_fine(tmp_path: pathlib.Path) -> None:
    assert found(tmp_path, "geometry_msgs/Pose", value("yaw(orientation)", "[-3.2, 3.2]")) == []


@pytest.mark.parametrize(
    "type, words",
    [
        ("tf2_msgs/TFMessage", "a tf frame has one parent"),
        ("sensor_msgs/PointCloud2", "images, point clouds and maps"),
        ("sensor_msgs/Image", "images, point clouds and maps"),
        ("move_base_msgs/MoveBaseActionGoal", "an action is a dialogue"),
    ],
)
def test_what_cannot_be_healed_is_said_where_it_is_needed(
    tmp_path: pathlib.Path, type: str, words: str
) -> None:
    for needed, count in ((True, 1), (False, 0)):
        findings = check_files(*files(tmp_path, type, value("width"), needed))
        said = [each for each in findings if words in each.what]
        assert [each.level for each in said] == ["warning"] * count


@needs_ros
def test_the_command_line_says_what_was_checked(tmp_path: pathlib.Path, capsys: Any) -> None:
    ontology, som = files(tmp_path, "nav_msgs/Odometri", value("data"), True)
    assert main(["check", ontology, "--som", som, "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert (answer["valid"], answer["types_checked"]) == (False, True)
    assert "did you mean Odometry?" in answer["findings"][0]["what"]


@needs_ros
def test_a_package_that_is_broken_is_named(tmp_path: pathlib.Path, monkeypatch: Any) -> None:
    generated = tmp_path / "a" / "msg"
    generated.mkdir(parents=True)
    (generated / "_B.py").write_text("")
    (generated / "__init__.py").write_text("raise SyntaxError('generated by another Python')")
    monkeypatch.syspath_prepend(str(tmp_path))
    with pytest.raises(ShsaError, match="a/B cannot be loaded: generated by another Python"):
        message_types.message_class("a/B")


@needs_ros
@pytest.mark.parametrize(
    "name",
    [
        *("unittest/main", "unittest.__main__/x", "this/Zen", "os/path", "os.path/join"),
        *("../../etc/Passwd", "/Float64", "std_msgs\0/Float64", "std_msgs.msg/Float64"),
        *("genpy/Message", "shsa_core/errors", "é/ü", "a/B" * 99, "", "*"),
    ],
)
def test_nothing_is_loaded_for_a_name_that_is_no_message_type(name: str) -> None:
    message_types.message_class("std_msgs/Float64")
    before = set(sys.modules)
    assert not is_service(name) and types_beside(name) == []
    assert set(sys.modules) == before


def test_without_ros_there_are_no_types(monkeypatch: Any) -> None:
    monkeypatch.setitem(sys.modules, "genpy.message", None)
    assert not available()


def test_without_ros_types_are_not_checked_and_that_is_said(tmp_path: pathlib.Path) -> None:
    ontology, som = files(tmp_path, "nav_msgs/Odometri", value("data"), True)
    script = (
        "import sys; sys.modules['genpy'] = None; from shsa_core.cli.main import main; "
        "sys.exit(main(sys.argv[1:]))"
    )
    for extra in ((), ("--json",)):
        done = subprocess.run(
            [sys.executable, "-c", script, "check", ontology, "--som", som, *extra],
            stdout=subprocess.PIPE,
            universal_newlines=True,
            env={**os.environ, "PYTHONPATH": ":".join(SOURCES)},
        )
        assert done.returncode == 0, done.stdout
        assert "types not checked" in done.stdout or '"types_checked": false' in done.stdout
