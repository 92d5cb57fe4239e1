"""The SOM: read from files and parameters, merged while running, every bad entry named."""
import copy
import pathlib
from typing import Any, Dict

import pytest

from shsa_core.errors import ModelError
from shsa_core.files.document import from_parameters
from shsa_core.files.som_file import (
    FROM_FILE_ALONE,
    load_som,
    merge_parameters,
    read_som,
    read_tree,
    som_parameters,
)
from shsa_core.model.checks import (
    Checks,
    Jump,
    NotANumber,
    OutOfRange,
    RateHigh,
    RateLow,
    StaleStamp,
    Stuck,
    UnknownPublisher,
)
from shsa_core.model.kinds import Policy, Standby
from shsa_core.model.service import Deadlines, LastResort, Provision, Service, Signal
from shsa_core.model.som import Som

ROOT = pathlib.Path(__file__).resolve().parents[2]

GOOD = """\
services:
  current:
    topic: /battery_current
    type: shsa_msgs/Float64Stamped
    node: /amperemeter
    period: 0.02
    needed: true
    standby: warm
    provides:
      battery_current: {field: data, range: [-5.0, 60.0], quality: 0.9}
  odometry:
    topic: /odom
    type: nav_msgs/Odometry
    node: /drivetrain
    period: 1
    provides:
      linear_velocity: {field: twist.twist.linear.x}
      angular_velocity: {field: twist.twist.angular.z}
  imu: {topic: /imu/data, type: sensor_msgs/Imu, node: /imu, period: none,
        provides: {angular_velocity: {field: angular_velocity.z}}}
"""
SERVICE: Dict[str, Any] = {
    "topic": "/t",
    "type": "std_msgs/Float64",
    "node": "/n",
    "period": 0.1,
    "provides": {"v": {"field": "data"}},
}
OF_VALUE = ("field", "range", "quality")


def write(tmp_path: pathlib.Path, text: str) -> str:
    file = tmp_path / "s.yaml"
    file.write_text(text)
    return str(file)


def changed(key: str, value: Any, **services: Any) -> Dict[str, Any]:
    """A tree with one service `v` where one value is another; `services` stand beside it."""
    service = copy.deepcopy(SERVICE)
    if key in OF_VALUE:
        service["provides"]["v"][key] = value
    elif key == "value checks":
        service["provides"]["v"]["checks"] = value
    else:
        service[key] = value
    return {"services": {"v": service, **services}}


def place(key: str) -> str:
    """The parameter of a key of the service `v`."""
    inner = f"provides/v/{key.split()[-1]}" if key in (*OF_VALUE, "value checks") else key
    return f"shsa/som/services/v/{inner}"


def som_of(tree: Any) -> Som:
    """The SOM of a tree that is valid; raises the first error."""
    som, errors = read_tree(from_parameters(tree, "shsa/som"))
    for error in errors:
        raise error
    return som


@pytest.fixture
def good(tmp_path: pathlib.Path) -> Som:
    return read_som(write(tmp_path, GOOD))


def test_a_good_file(good: Som, tmp_path: pathlib.Path) -> None:
    current, odometry, imu = good
    assert current == Service(
        name="current",
        topic="/battery_current",
        type="shsa_msgs/Float64Stamped",
        node="/amperemeter",
        period=0.02,
        provides=(Provision("battery_current", "data", (-5.0, 60.0), 0.9),),
        needed=True,
        standby=Standby.WARM,
    )
    assert current.where == str(tmp_path / "s.yaml") + ":2"
    assert odometry.properties == ("linear_velocity", "angular_velocity")
    velocity, turn = odometry.sources
    assert (velocity.provision.range, velocity.quality) == (None, 1.0)
    assert (odometry.needed, odometry.standby, odometry.policy) == (
        False,
        Standby.COLD,
        Policy.SUBSTITUTE,
    )
    assert (odometry.checks, odometry.last_resort) == (Checks(), LastResort())
    assert (velocity.path, velocity.node) == ("/odom/twist/twist/linear/x", "/drivetrain")
    assert imu.event_driven and imu.where.endswith(":19")
    assert good.topics() == ("/battery_current", "/odom", "/imu/data")
    assert good.of_topic("/odom") == (odometry,)
    assert good.of_property("angular_velocity") == (turn, imu.sources[0])
    assert good.of_topic("/nothing") == good.of_property("nothing") == ()
    assert good.needed() == (current,) and len(good) == 3 and len(good.sources) == 4
    assert odometry.source("angular_velocity") is turn and odometry.source("x") is None


def test_equal_soms_are_equal(good: Som, tmp_path: pathlib.Path) -> None:
    again = read_som(write(tmp_path, "# moved by a line\n" + GOOD))
    assert again == good and hash(again) == hash(good)
    assert good != Som() and good != 5


@pytest.mark.parametrize("path", sorted(ROOT.parents[0].glob("*/ontology/*som*.yaml")), ids=str)
def test_the_soms_that_come_with_it(path: pathlib.Path) -> None:
    som = read_som(str(path))
    assert len(som) > 0 and som_of(som_parameters(som)).topics() == som.topics()


def test_parameters_are_plain_and_give_the_same_som(good: Som) -> None:
    tree: Any = som_parameters(good)
    assert tree["services"]["current"] == {
        "topic": "/battery_current",
        "type": "shsa_msgs/Float64Stamped",
        "node": "/amperemeter",
        "period": 0.02,
        "needed": True,
        "standby": "warm",
        "policy": "substitute",
        "provides": {
            "battery_current": {"field": "data", "quality": 0.9, "range": [-5.0, 60.0]},
        },
    }
    assert tree["services"]["imu"]["period"] == "none"
    assert som_of(tree) == good
    assert som_of(tree).services["imu"].where == "shsa/som/services/imu"
    assert som_of({"services": {}}) == Som()


FULL = """\
services:
  current:
    topic: /battery_current
    type: shsa_msgs/Float64Stamped
    node: /amperemeter
    period: 0.02
    deadline: 8
    policy: restart_and_substitute
    standby: hot
    checks: {rate_low: false, rate_high: 2, stale_stamp: true, bad: 5, of: 20, recovery: 7}
    last_resort: {values: {battery_current: 0}, command: [rosservice, call, /stop]}
    provides:
      battery_current:
        field: data
        range: [-5.0, 60.0]
        checks: {stuck: 2.0, jump: 1.5, not_a_number: false}
"""


def test_every_option(tmp_path: pathlib.Path) -> None:
    (current,) = read_som(write(tmp_path, FULL))
    assert (current.deadline, current.standby) == (8.0, Standby.HOT)
    assert current.policy.substitutes and current.policy.restarts
    assert current.checks == Checks(
        (RateHigh(2.0), StaleStamp(0.5), UnknownPublisher(1.0)), bad=5, of=20, recovery=7
    )
    assert current.provides[0].checks == (OutOfRange(True), Stuck(2.0), Jump(1.5))
    assert current.last_resort == LastResort(
        (("battery_current", 0.0),), ("rosservice", "call", "/stop")
    )


def test_every_option_survives_the_parameter_server_save_the_command(
    tmp_path: pathlib.Path,
) -> None:
    som = read_som(write(tmp_path, FULL))
    tree: Any = som_parameters(som)
    assert "command" not in tree["services"]["current"]["last_resort"]
    merged, errors = merge_parameters(som, tree)
    assert (merged, errors) == (som, [])


def test_a_check_that_is_on_anyway_and_one_without_a_usual_limit() -> None:
    (service,) = som_of(changed("checks", {"rate_low": True, "unknown_publisher": False}))
    assert service.checks.each == (RateHigh(1.5), RateLow(0.5))
    (service,) = som_of(
        changed("value checks", {"stuck": True, "jump": False, "not_a_number": True})
    )
    assert service.provides[0].checks == (NotANumber(True), OutOfRange(True), Stuck(1.0))


@pytest.mark.parametrize("key, value", [("checks", {"rate_low": 0.5}), ("deadline", 3)])
def test_an_event_driven_topic_has_neither_rate_nor_deadline(key: str, value: Any) -> None:
    tree = changed(key, value)
    tree["services"]["v"]["period"] = "none"
    with pytest.raises(ModelError, match="period|event-driven"):
        som_of(tree)


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
    ("period", "0.1s", "period must be a number of s, or none, not the text '0.1s'"),
    ("period", "0.1", "period must be a number of s, or none, not the text '0.1'"),
    ("period", 0, "period must be 0.0001 to 1e+06 s, or none, not 0"),
    ("period", -1, "period must be 0.0001 to 1e+06 s, or none, not -1"),
    ("period", float("nan"), "period must be a finite number, not nan"),
    ("period", float("inf"), "period must be a finite number, not inf"),
    ("period", 10**400, "period must be a finite number"),
    ("period", {}, "period must be a number, not a mapping"),
    ("period", [0.1], "period must be a number, not a list"),
    ("period", True, "period must be a number, not true"),
    ("period", None, "period must be a number of s, or none, not empty"),
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
    ("deadlin", 1, "the service v has no key 'deadlin'; allowed: topic, type"),
    ("period", 1e-5, "period must be 0.0001 to 1e+06 s, or none"),
    ("period", 1e7, "period must be 0.0001 to 1e+06 s, or none"),
    ("period", "None", "period must be a number of s, or none, not the text 'None'"),
    ("deadline", 0, "deadline must be above 0, not 0"),
    ("deadline", "none", "deadline must be a number"),
    ("policy", "give up", "policy must be one of substitute, restart, restart_and_substitute"),
    ("last_resort", "go", "last_resort must be stop, {values: {PROPERTY: NUMBER}} or {command:"),
    ("last_resort", {"value": 1}, "last_resort has no key 'value'"),
    ("last_resort", {"values": 5}, "values must be a mapping"),
    ("last_resort", {"values": {"v": "x"}}, "the value of v must be a number"),
    ("last_resort", {"values": {"w": 1}}, "it does not provide w, only v"),
    ("last_resort", {"command": []}, "command must have 1 to 100 words, the program first"),
    ("last_resort", {"command": [""]}, "command must have 1 to 100 words"),
    ("last_resort", {"command": "reboot"}, "must be a list"),
    ("last_resort", {"command": ["a\0"]}, "cannot hold a zero byte"),
    ("provides", {}, "provides must name at least one property"),
    ("provides", 5, "provides must be a mapping"),
    ("provides", {"1v": {"field": "data"}}, "'1v' cannot be the name of a property"),
    ("provides", {"v": {}}, "the property v lacks the key 'field'"),
    ("provides", {"v": 5}, "the property v must be a mapping"),
    ("checks", 5, "checks must be a mapping"),
    ("checks", {"jump": 1}, "jump is about one value: it stands with a property, under provides"),
    ("checks", {"rate": 1}, "checks has no key 'rate'"),
    ("checks", {"rate_low": "low"}, "rate_low must be a number"),
    ("checks", {"bad": 0}, "bad must be a whole number from 1 to 1000, not 0"),
    ("checks", {"of": 2.5}, "of must be a whole number"),
    ("checks", {"bad": 11}, "bad must be at most of, 10, not 11"),
    ("value checks", {"rate_low": 1}, "checks has no key 'rate_low'"),
    ("value checks", {"out_of_range": 3}, "out_of_range must be true or false, not 3"),
    ("value checks", {"jump": True}, "jump must be false or a number above 0; it has no usual"),
    ("value checks", {"jmp": 1}, "Did you mean 'jump'"),
    ("value checks", "on", "checks must be a mapping"),
]
for _limit in (0, -1):
    for _key in ("jump", "stuck"):
        BAD.append(("value checks", {_key: _limit}, f"{_key} must be false, true or a number"))
    for _key in ("rate_high", "rate_low", "stale_stamp", "future_stamp", "unknown_publisher"):
        BAD.append(("checks", {_key: _limit}, f"{_key} must be false, true or a number above 0"))
for _number in (float("nan"), float("inf")):
    BAD.append(("checks", {"rate_high": _number}, "rate_high must be a finite number"))


@pytest.mark.parametrize("key, value, message", BAD)
def test_a_bad_value_is_named_and_refused(key: str, value: Any, message: str) -> None:
    with pytest.raises(ModelError) as caught:
        som_of(changed(key, value))
    assert caught.value.where.startswith(place(key))
    assert message in caught.value.what


@pytest.mark.parametrize("key, value, message", BAD)
def test_a_bad_value_while_running_leaves_the_old_entry(key: str, value: Any, message: str) -> None:
    beside = dict(SERVICE, topic="/w")
    old = som_of(changed("period", 0.1, w=beside))
    som, errors = merge_parameters(old, changed(key, value, w=dict(beside, period=0.5)))
    assert [error.where.split("/")[3] for error in errors] == ["v"]
    assert message in errors[0].what
    assert som.services["v"] == old.services["v"]
    assert som.services["w"].period == 0.5


@pytest.mark.parametrize("missing", sorted(SERVICE))
def test_what_is_required(missing: str) -> None:
    service = {key: value for key, value in SERVICE.items() if key != missing}
    with pytest.raises(ModelError, match=f"the service v lacks the key '{missing}'"):
        som_of({"services": {"v": service}})


def test_edges_that_are_allowed() -> None:
    entry = dict(
        SERVICE,
        topic="/a/b_1/" + "x" * 248,
        period=1e-4,
        provides={"v": {"field": "ranges[0].a1[999999]", "quality": 1, "range": [-1e300, 1e300]}},
    )
    source = som_of({"services": {"v": entry}}).sources[0]
    assert (source.quality, source.provision.range) == (1.0, (-1e300, 1e300))
    assert source.path.endswith("/ranges[0]/a1[999999]")
    assert len(som_of(changed("topic", "/" + "x" * 254))) == 1
    for standby in Standby:
        assert som_of(changed("standby", str(standby))).services["v"].standby is standby


@pytest.mark.parametrize(
    "text, line, what",
    [
        ("", 1, "the SOM must be a mapping (name: value), not empty"),
        ("[]", 1, "the SOM must be a mapping"),
        ("v: 5", 1, "the SOM has no key 'v'; allowed: services"),
        ("services: 5", 1, "services must be a mapping"),
        ("services:\n  v: 5", 2, "the service v must be a mapping"),
        ("services:\n  1v: {}", 2, "'1v' cannot be the name of a service"),
        ("services:\n  a b: {}", 2, "'a b' cannot be the name of a service"),
        ("services:\n  abs: {}", 2, "'abs' cannot be the name of a service"),
    ],
)
def test_errors_of_files_name_the_line(
    tmp_path: pathlib.Path, text: str, line: int, what: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ModelError) as caught:
        read_som(path)
    assert caught.value.where == f"{path}:{line}" and what in caught.value.what


def test_two_properties_cannot_claim_one_field() -> None:
    with pytest.raises(ModelError) as caught:
        som_of(changed("provides", {"v": {"field": "data"}, "w": {"field": "data"}}))
    assert caught.value.where == "shsa/som/services/v/provides/w"
    assert "the field data provides v already" in caught.value.what


def test_a_service_is_one_topic_of_one_node() -> None:
    again = dict(SERVICE, provides={"w": {"field": "other"}})
    with pytest.raises(ModelError, match="/n on /t is the service v already") as caught:
        som_of(changed("period", 1, w=again))
    assert caught.value.where == "shsa/som/services/w"


def test_a_topic_has_one_type_and_may_have_several_nodes() -> None:
    other = dict(SERVICE, node="/m")
    som = som_of(changed("period", 1, w=other))
    assert [service.name for service in som.of_topic("/t")] == ["v", "w"]
    with pytest.raises(ModelError, match="a topic has one type, not std_msgs/Float32 as well"):
        som_of(changed("period", 1, w=dict(other, type="std_msgs/Float32")))


def test_a_safe_value_is_in_its_range() -> None:
    tree = changed("range", [0, 1])
    tree["services"]["v"]["last_resort"] = {"values": {"v": 2}}
    with pytest.raises(ModelError, match=r"the value 2 of v is outside the range \[0, 1\]"):
        som_of(tree)


def test_the_valid_part_of_a_file_and_all_errors(tmp_path: pathlib.Path) -> None:
    som, errors = load_som(write(tmp_path, GOOD + "  w: 5\n  u: {topic: x}\n"))
    assert len(som) == 3 and len(errors) == 2


def test_a_number_is_one_parameter(good: Som) -> None:
    tree: Any = som_parameters(good)
    tree["services"]["odometry"]["period"] = 0.05
    som, errors = merge_parameters(good, tree)
    assert errors == [] and som.services["odometry"].period == 0.05
    assert [each.name for each in som if each != good.services[each.name]] == ["odometry"]


@pytest.mark.parametrize("key", FROM_FILE_ALONE)
def test_what_decides_whom_healing_kills_comes_from_the_file_alone(key: str) -> None:
    others = {"topic": "/x", "type": "a/B", "node": "/x", "policy": "restart"}
    old = som_of(changed("period", 0.1))
    som, errors = merge_parameters(old, changed(key, others[key]))
    assert som == old and len(errors) == 1
    assert f"{key} is " in errors[0].what and "can be changed there alone" in errors[0].what


@pytest.mark.parametrize(
    "key, value, words",
    [
        ("field", "other", "properties and fields can be changed in the SOM file alone"),
        ("provides", {"w": {"field": "data"}}, "properties and fields can be changed"),
        ("last_resort", {"command": ["reboot"]}, "a command can stand in the SOM file only"),
    ],
)
def test_neither_fields_nor_commands_come_from_parameters(key: str, value: Any, words: str) -> None:
    old = som_of(changed("period", 0.1))
    som, errors = merge_parameters(old, changed(key, value))
    assert som == old and words in errors[0].what


def test_parameters_add_and_drop_no_service(good: Som) -> None:
    tree: Any = som_parameters(good)
    del tree["services"]["odometry"]
    tree["services"]["new"] = SERVICE
    som, errors = merge_parameters(good, tree)
    assert som == good
    assert [(e.where, "only the file can add one" in e.what) for e in errors] == [
        ("shsa/som/services/new", True)
    ]


def test_the_order_of_the_file_stays(good: Som) -> None:
    tree: Any = som_parameters(good)
    services = {name: tree["services"][name] for name in reversed(list(tree["services"]))}
    provides = services["odometry"]["provides"]
    services["odometry"]["provides"] = {name: provides[name] for name in reversed(list(provides))}
    som, errors = merge_parameters(good, {"services": services})
    assert errors == [] and list(som) == list(good)


@pytest.mark.parametrize("value", [None, 5, "x", [], [1], True, float("nan"), {"current": {}}])
def test_a_tree_that_is_no_som_changes_nothing(good: Som, value: Any) -> None:
    som, errors = merge_parameters(good, value)
    assert som == good and errors[0].where.startswith("shsa/som")


def test_a_tree_that_is_no_value_changes_nothing(good: Som) -> None:
    som, errors = merge_parameters(good, {"services": {"current": [b"x"]}})
    assert som is good and [e.where for e in errors] == ["shsa/som/services/current[0]"]
    assert merge_parameters(good, 5, "/x")[1][0].where == "/x"


def test_who_provides_what_on_a_shared_topic() -> None:
    som = som_of(changed("period", 1, w=dict(SERVICE, node="/m", period="none")))
    v, w = som
    assert som.service_of("/t", "/n") is v and som.service_of("/t", "/m") is w
    assert som.service_of("/t", "/stranger") is som.service_of("/x", "/n") is None
    assert Som([v]).service_of("/t", "/stranger") is v
    deadlines = Deadlines(periods=5.0, minimum=0.25)
    assert som.signal(v.sources[0], deadlines) == Signal(
        "/t", "data", "std_msgs/Float64", "/n", 1.0, 5.0
    )
    assert som.signal(w.sources[0], deadlines).deadline is None
    assert Som([v]).signal(v.sources[0], deadlines).node == ""


def test_how_long_a_service_may_be_silent() -> None:
    (service,) = som_of(changed("period", 0.01))
    assert Deadlines(5.0, 0.25).of(service) == 0.25
    assert Deadlines(50.0, 0.25).of(service) == 0.5
    (service,) = som_of(changed("deadline", 2))
    assert Deadlines(5.0, 0.25).of(service) == 0.2
    (service,) = som_of(changed("period", "none"))
    assert Deadlines().of(service) is None
