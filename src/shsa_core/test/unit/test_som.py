"""The SOM: read from files and parameters, merged while running, every bad entry named."""
import pathlib
from typing import Any

import pytest

from shsa_core.errors import ModelError
from shsa_core.model.som import (
    Service,
    Som,
    load_som,
    merge_parameters,
    read_som,
    som_from_parameters,
)

ROOT = pathlib.Path(__file__).resolve().parents[4]

GOOD = """\
battery_current:
  - {topic: /battery_current, field: data, type: shsa_msgs/Float64Stamped, node: /amperemeter,
     period: 0.02, range: [-5.0, 60.0], quality: 0.9, needed: true, standby: warm}
linear_velocity:
  - {topic: /odom, field: twist.twist.linear.x, type: nav_msgs/Odometry, node: /drivetrain, period: 1}
angular_velocity:
  - {topic: /odom, field: twist.twist.angular.z, type: nav_msgs/Odometry, node: /drivetrain, period: 1}
  - topic: /imu/data
    field: angular_velocity.z
    type: sensor_msgs/Imu
    node: /imu
    period: 0.01
"""
ENTRY = {
    "topic": "/t",
    "field": "data",
    "type": "std_msgs/Float64",
    "node": "/n",
    "period": 0.1,
}


def write(tmp_path: pathlib.Path, text: str) -> str:
    file = tmp_path / "s.yaml"
    file.write_text(text)
    return str(file)


@pytest.fixture
def good(tmp_path: pathlib.Path) -> Som:
    return read_som(write(tmp_path, GOOD))


def test_a_good_file(good: Any, tmp_path: pathlib.Path) -> None:
    current, velocity, turn, imu = good
    assert current == Service(
        property="battery_current",
        topic="/battery_current",
        field="data",
        type="shsa_msgs/Float64Stamped",
        node="/amperemeter",
        period=0.02,
        range=(-5.0, 60.0),
        quality=0.9,
        needed=True,
        standby="warm",
    )
    assert current.where == str(tmp_path / "s.yaml") + ":2"
    assert velocity == Service(
        "linear_velocity", "/odom", "twist.twist.linear.x", "nav_msgs/Odometry", "/drivetrain", 1.0
    )
    assert (velocity.range, velocity.quality) == (None, 1.0)
    assert (velocity.needed, velocity.standby) == (False, "cold")
    assert velocity.path == "/odom/twist/twist/linear/x"
    assert imu.where.endswith(":8")
    assert good.topics() == ("/battery_current", "/odom", "/imu/data")
    assert good.of_topic("/odom") == (velocity, turn)
    assert good.of_property("angular_velocity") == (turn, imu)
    assert good.of_topic("/nothing") == good.of_property("nothing") == ()


def test_equal_soms_are_equal(good: Any, tmp_path: pathlib.Path) -> None:
    again = read_som(write(tmp_path, "# moved by a line\n" + GOOD))
    assert again == good and hash(again) == hash(good)
    assert good != Som() and good != 5


def test_the_som_that_comes_with_it() -> None:
    assert read_som(str(ROOT / "ontology" / "rover_som.yaml")).services


def test_parameters_are_plain_and_give_the_same_som(good: Any) -> None:
    tree = good.parameters()
    assert tree["battery_current"] == [
        {
            "topic": "/battery_current",
            "field": "data",
            "type": "shsa_msgs/Float64Stamped",
            "node": "/amperemeter",
            "period": 0.02,
            "range": [-5.0, 60.0],
            "quality": 0.9,
            "needed": True,
            "standby": "warm",
            "policy": "substitute",
        }
    ]
    assert "range" not in tree["linear_velocity"][0] and "where" not in tree["linear_velocity"][0]
    assert som_from_parameters(tree) == good
    assert som_from_parameters(tree).services[0].where == "/shsa/som/battery_current[0]"
    assert som_from_parameters({}, "/x") == Som()


BAD = [
    ("topic", "battery_current", "topic must be written like /battery_current, not the text"),
    ("topic", "/battery current", "topic must be written like"),
    ("topic", "/x;touch /tmp/y", "topic must be written like"),
    ("topic", "/x\n", "topic must be written like"),
    ("topic", "//x", "topic must be written like"),
    ("topic", "/x/", "topic must be written like"),
    ("topic", "/", "topic must be written like"),
    ("topic", "", "topic must be written like"),
    ("topic", "~x", "topic must be written like"),
    ("topic", "/\u00e4", "topic must be written like"),
    ("topic", "/" + "x" * 255, "topic must be written like"),
    ("topic", 5, "topic must be written like"),
    ("topic", None, "topic must be a text, not empty"),
    ("topic", ["/x"], "topic must be a text, not a list"),
    ("field", "", "field must be written like data or twist.twist.linear.x"),
    ("field", "a.", "field must be written like"),
    ("field", ".a", "field must be written like"),
    ("field", "a..b", "field must be written like"),
    ("field", "a/b", "field must be written like"),
    ("field", "1a", "field must be written like"),
    ("field", "_a", "field must be written like"),
    ("field", "a[x]", "field must be written like"),
    ("field", "a[-1]", "field must be written like"),
    ("field", "a()", "field must be written like"),
    ("field", "\u00e4", "field must be written like"),
    ("type", "Float64", "type must be written like std_msgs/Float64"),
    ("type", "std_msgs/msg/Float64", "type must be written like"),
    ("type", "std_msgs/", "type must be written like"),
    ("type", "/Float64", "type must be written like"),
    ("type", "std-msgs/Float64", "type must be written like"),
    ("type", "std_msgs/Float64\n", "type must be written like"),
    ("node", "n", "node must be written like /amperemeter"),
    ("node", "/n;reboot", "node must be written like"),
    ("node", "--help", "node must be written like"),
    ("period", "0.1s", "period must be a number, not the text '0.1s'"),
    ("period", "0.1", "period must be a number, not the text '0.1'"),
    ("period", 0, "period must be above 0, not 0"),
    ("period", -1, "period must be above 0, not -1"),
    ("period", float("nan"), "period must be a finite number, not nan"),
    ("period", float("inf"), "period must be a finite number, not inf"),
    ("period", 10**400, "period must be a finite number"),
    ("period", {}, "period must be a number, not a mapping"),
    ("period", [0.1], "period must be a number, not a list"),
    ("period", True, "period must be a number, not true"),
    ("period", None, "period must be a number, not empty"),
    ("range", 5, "range, [lowest, highest], must be a list, not 5"),
    ("range", [], "range must be two numbers, [lowest, highest], not 0"),
    ("range", [1], "range must be two numbers, [lowest, highest], not 1"),
    ("range", [1, 2, 3], "range must be two numbers, [lowest, highest], not 3"),
    ("range", [2, 1], "range must have its lowest first, not [2, 1]"),
    ("range", [1, 1], "range must have its lowest first, not [1, 1]"),
    ("range", ["a", 1], "range's lowest must be a number, not the text 'a'"),
    ("range", [1, None], "range's highest must be a number, not empty"),
    ("range", [float("nan"), 1], "range's lowest must be a finite number"),
    ("range", [0, float("inf")], "range's highest must be a finite number"),
    ("range", {"min": 0}, "range, [lowest, highest], must be a list, not a mapping"),
    ("quality", 0, "quality must be above 0 and at most 1, not 0"),
    ("quality", 1.01, "quality must be above 0 and at most 1, not 1.01"),
    ("quality", "good", "quality must be a number"),
    ("needed", 1, "needed must be true or false, not 1"),
    ("needed", "yes", "needed must be true or false, not the text 'yes'"),
    ("standby", "lukewarm", "standby must be one of cold, warm, hot, not the text 'lukewarm'"),
    ("standby", 1, "standby must be one of cold, warm, hot, not 1"),
    ("standby", None, "standby must be a text, not empty"),
    ("deadlin", 1, "a service of v has no key 'deadlin'; allowed: topic, field"),
]


@pytest.mark.parametrize("key, value, message", BAD)
def test_a_bad_value_is_named_and_refused(key: str, value: Any, message: str) -> None:
    tree = {"v": [dict(ENTRY, **{key: value})]}
    with pytest.raises(ModelError) as caught:
        som_from_parameters(tree)
    assert caught.value.where.startswith(f"/shsa/som/v[0]/{key}")
    assert message in caught.value.what


@pytest.mark.parametrize("key, value, message", BAD)
def test_a_bad_value_while_running_leaves_the_old_entry(key: str, value: Any, message: str) -> None:
    tree = {"v": [dict(ENTRY)], "w": [dict(ENTRY, topic="/w")]}
    old = som_from_parameters(tree)
    tree["v"][0][key] = value
    tree["w"][0]["period"] = 0.5
    som, errors = merge_parameters(old, tree)
    assert [error.where.split("/")[3] for error in errors] == ["v[0]"]
    assert message in errors[0].what
    assert som.services[0] == old.services[0]
    assert som.services[1].period == 0.5


@pytest.mark.parametrize("missing", sorted(ENTRY))
def test_what_is_required(missing: str) -> None:
    entry = {key: value for key, value in ENTRY.items() if key != missing}
    with pytest.raises(ModelError, match=f"a service of v lacks the key '{missing}'"):
        som_from_parameters({"v": [entry]})


def test_edges_that_are_allowed() -> None:
    entry = dict(
        ENTRY,
        topic="/a/b_1/" + "x" * 248,
        field="ranges[0].a1[999999]",
        period=1e-9,
        quality=1,
        range=[-1e300, 1e300],
    )
    service = som_from_parameters({"v": [entry]}).services[0]
    assert (service.quality, service.range) == (1.0, (-1e300, 1e300))
    assert service.path.endswith("/ranges[0]/a1[999999]")
    assert som_from_parameters({"v": [dict(ENTRY, topic="/" + "x" * 254)]}).services
    for standby in ("cold", "warm", "hot"):
        assert som_from_parameters({"v": [dict(ENTRY, standby=standby)]}).services


@pytest.mark.parametrize(
    "text, line, what",
    [
        ("", 1, "the SOM must be a mapping (name: value), not empty"),
        ("[]", 1, "the SOM must be a mapping"),
        ("v: 5", 1, "v (the services that provide it) must be a list, not 5"),
        ("v: {topic: /a}", 1, "v (the services that provide it) must be a list, not a mapping"),
        ("v:\n  - 5", 2, "a service of v must be a mapping"),
        ("1v: []", 1, "'1v' cannot be the name of a property"),
        ("a b: []", 1, "'a b' cannot be the name of a property"),
        ("abs: []", 1, "'abs' cannot be the name of a property"),
    ],
)
def test_errors_of_files_name_the_line(
    tmp_path: pathlib.Path, text: str, line: int, what: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ModelError) as caught:
        read_som(path)
    assert caught.value.where == f"{path}:{line}" and what in caught.value.what


def test_two_services_cannot_claim_one_field() -> None:
    with pytest.raises(ModelError) as caught:
        som_from_parameters({"v": [ENTRY], "w": [ENTRY]})
    assert caught.value.where == "/shsa/som/w[0]"
    assert caught.value.what == (
        "/t/data provides v already (/shsa/som/v[0]); a field can provide one property"
    )


@pytest.mark.parametrize("key, other", [("type", "std_msgs/Float32"), ("node", "/m")])
def test_a_topic_has_one_type_and_one_node(key: str, other: Any) -> None:
    second = dict(ENTRY, field="other", **{key: other})
    with pytest.raises(ModelError) as caught:
        som_from_parameters({"v": [ENTRY], "w": [second]})
    assert f"/t has the {key} {ENTRY[key]} already" in caught.value.what
    assert f"a topic has one {key}, not {other} as well" in caught.value.what
    assert som_from_parameters({"v": [ENTRY], "w": [dict(ENTRY, field="o", period=9)]}).services


def test_the_valid_part_of_a_file_and_all_errors(tmp_path: pathlib.Path) -> None:
    som, errors = load_som(write(tmp_path, GOOD + "w: 5\nu:\n  - {topic: x}\n"))
    assert len(som.services) == 4 and len(errors) == 2


def test_merging_takes_changes_additions_and_removals(good: Any) -> None:
    tree = good.parameters()
    tree["battery_current"][0]["range"] = [0, 1]
    tree["new"] = [ENTRY]
    del tree["linear_velocity"]
    tree["angular_velocity"].pop(0)
    som, errors = merge_parameters(good, tree)
    assert errors == []
    assert [s.property for s in som] == ["battery_current", "angular_velocity", "new"]
    assert som.services[0].range == (0.0, 1.0)


@pytest.mark.parametrize("value", [None, 5, "x", [], [1], True, float("nan")])
def test_a_tree_that_is_no_mapping_changes_nothing(good: Any, value: Any) -> None:
    som, errors = merge_parameters(good, value)
    assert som == good and [error.where for error in errors] == ["/shsa/som"]


def test_a_tree_that_is_no_value_changes_nothing(good: Any) -> None:
    som, errors = merge_parameters(good, {"battery_current": [b"x"]})
    assert som is good and [e.where for e in errors] == ["/shsa/som/battery_current[0]"]
    assert merge_parameters(good, 5, "/x")[1][0].where == "/x"


@pytest.mark.parametrize("value", [None, 5, "x", {}, {"period": 1}, True])
def test_a_property_that_is_no_list_keeps_its_services(good: Any, value: Any) -> None:
    tree = good.parameters()
    tree["angular_velocity"] = value
    som, errors = merge_parameters(good, tree)
    assert som == good and [e.where for e in errors] == ["/shsa/som/angular_velocity"]


def test_a_bad_entry_stands_for_the_old_one_on_its_field_wherever_it_is(good: Any) -> None:
    tree = good.parameters()
    tree["angular_velocity"].reverse()
    tree["angular_velocity"][0]["period"] = -1
    som, errors = merge_parameters(good, tree)
    assert len(errors) == 1 and len(som.services) == 4
    assert som.of_property("angular_velocity") == tuple(
        reversed(good.of_property("angular_velocity"))
    )


def test_a_bad_entry_without_a_field_stands_for_the_old_one_in_its_place(good: Any) -> None:
    tree = good.parameters()
    for bad in (5, {}, {"topic": {}}):
        tree["angular_velocity"][1] = bad
        som, errors = merge_parameters(good, tree)
        assert len(errors) == 1 and som == good


def test_a_bad_entry_that_is_new_is_left_out(good: Any) -> None:
    tree = good.parameters()
    tree["angular_velocity"].append({"topic": "/x"})
    tree["other"] = [5]
    som, errors = merge_parameters(good, tree)
    assert len(errors) == 2 and som == good


def test_an_old_entry_does_not_come_back_where_its_field_was_taken() -> None:
    old = som_from_parameters({"v": [ENTRY], "w": [dict(ENTRY, topic="/w")]})
    tree = {"u": [ENTRY], "v": [dict(ENTRY, period=-1)], "w": [dict(ENTRY, topic="/w")]}
    som, errors = merge_parameters(old, tree)
    assert [s.property for s in som] == ["u", "w"]
    assert [error.where for error in errors][0] == "/shsa/som/v[0]/period"
    assert "provides u already" in errors[1].what


def test_an_old_entry_is_kept_once() -> None:
    old = som_from_parameters({"v": [ENTRY]})
    som, errors = merge_parameters(old, {"v": [ENTRY, dict(ENTRY, period=-1)]})
    assert som == old and len(errors) == 1


def test_services_have_an_order() -> None:
    one = Service("a", "/t", "x", "p/T", "/n", 1.0)
    assert sorted([Service("b", "/t", "x", "p/T", "/n", 1.0), one])[0] is one
