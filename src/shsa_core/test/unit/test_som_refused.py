"""Wrong services, fields and values of a SOM are named and refused."""
import json
import pathlib
from typing import Any

import pytest
from som_trees import GOOD, SERVICE, changed, place, som_of, write

from shsa_core.cli.main import main
from shsa_core.errors import ModelError, ModelErrors
from shsa_core.files.som_file import load_som, merge_parameters, read_som
from shsa_core.model.kinds import Standby


ROOT = pathlib.Path(__file__).resolve().parents[2]


BAD = [
    ("topic", "battery current", "like /battery_current or battery_current, not the text"),
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
    ("topic", None, "topic must be written like /battery_current or battery_current, not empty"),
    ("topic", ["/x"], "topic must be written like /battery_current or battery_current, not a list"),
    ("field", "", "is not a field; fields are written like data, pose.position.x"),
    ("field", "a.", "is not a field"),
    ("field", ".a", "is not a field"),
    ("field", "a..b", "is not a field"),
    ("field", "a/b", "is not a field"),
    ("field", "1a", "is not a field"),
    ("field", "_a", "is not a field"),
    ("field", "a[x]", "is not a field"),
    ("field", "a[-1]", "is not a field"),
    ("field", "a()", "is not a field"),
    ("field", "\u00e4", "is not a field"),
    ("type", "Float64", "type must be written like std_msgs/Float64"),
    ("type", "std_msgs/msg/Float64", "type must be written like"),
    ("type", "std_msgs/", "type must be written like"),
    ("type", "/Float64", "type must be written like"),
    ("type", "std-msgs/Float64", "type must be written like"),
    ("type", "std_msgs/Float64\n", "type must be written like"),
    ("node", "n/", "node must be written like /amperemeter or amperemeter"),
    ("node", "/n;reboot", "node must be written like"),
    ("node", "--help", "node must be written like"),
    ("period", "0.1s", "period must be 0.0001 to 1e+06 s, or none, not the text '0.1s'"),
    ("period", "0.1", "period must be 0.0001 to 1e+06 s, or none, not the text '0.1'"),
    ("period", 0, "period must be 0.0001 to 1e+06 s, or none, not 0"),
    ("period", -1, "period must be 0.0001 to 1e+06 s, or none, not -1"),
    ("period", float("nan"), "period must be 0.0001 to 1e+06 s, or none, not nan"),
    ("period", float("inf"), "period must be 0.0001 to 1e+06 s, or none, not inf"),
    ("period", 10**400, "period must be 0.0001 to 1e+06 s, or none, not 10"),
    ("period", {}, "period must be 0.0001 to 1e+06 s, or none, not a mapping"),
    ("period", [0.1], "period must be 0.0001 to 1e+06 s, or none, not a list"),
    ("period", True, "period must be 0.0001 to 1e+06 s, or none, not true"),
    ("period", None, "period must be 0.0001 to 1e+06 s, or none, not empty"),
    ("range", 5, "range, [lowest, highest], must be a list, not 5"),
    ("range", [], "range must be two numbers, [lowest, highest], not []"),
    ("range", [1], "range must be two numbers, [lowest, highest], not [1]"),
    ("range", [1, 2, 3], "range must be two numbers, [lowest, highest], not [1, 2, 3]"),
    ("range", [2, 1], "range must have its lowest first, not [2, 1]"),
    ("range", [1, 1], "range must have its lowest first, not [1, 1]"),
    ("range", ["a", 1], "range's lowest must be a number, not the text 'a'"),
    ("range", [1, None], "range's highest must be a number, not empty"),
    ("range", [float("nan"), 1], "range's lowest must be a finite number"),
    ("range", [0, float("inf")], "range's highest must be a finite number"),
    ("range", {"min": 0}, "range, [lowest, highest], must be a list, not a mapping"),
    ("quality", 0, "quality must be above 0 and at most 1, not 0"),
    ("quality", 1.01, "quality must be above 0 and at most 1, not 1.01"),
    ("quality", "good", "quality must be above 0 and at most 1, not the text"),
    ("needed", 1, "needed must be true or false, not 1"),
    ("needed", "yes", "needed must be true or false, not the text 'yes'"),
    ("standby", "lukewarm", "standby must be one of cold, warm, hot, not the text 'lukewarm'"),
    ("standby", 1, "standby must be one of cold, warm, hot, not 1"),
    ("standby", None, "standby must be one of cold, warm, hot, not empty"),
    ("deadlin", 1, "the service v has no key 'deadlin'; allowed: topic, type"),
    ("period", 1e-5, "period must be 0.0001 to 1e+06 s, or none"),
    ("period", 1e7, "period must be 0.0001 to 1e+06 s, or none"),
    ("period", "None", "period must be 0.0001 to 1e+06 s, or none, not the text 'None'"),
    ("deadline", 0, "deadline must be 1 to 1e+06 periods, or {false_alarms: NUMBER}, not 0"),
    ("deadline", 1e-9, "deadline must be 1 to 1e+06 periods, or {false_alarms: NUMBER}, not 1e-09"),
    ("deadline", "none", "deadline must be 1 to 1e+06 periods, or {false_alarms: NUMBER}, not the"),
    (
        "deadline",
        [5],
        "deadline must be 1 to 1e+06 periods, or {false_alarms: NUMBER}, not a list",
    ),
    ("deadline", {}, "deadline lacks the key 'false_alarms'"),
    ("deadline", {"alarms": 1}, "deadline has no key 'alarms'; allowed: false_alarms"),
    ("deadline", {"false_alarms": 0}, "false_alarms must be 0.001 to 100 an hour, not 0"),
    ("deadline", {"false_alarms": "few"}, "false_alarms must be 0.001 to 100"),
    ("deadline", {"false_alarms": float("nan")}, "false_alarms must be 0.001 to 100"),
    ("policy", "give up", "policy must be one of substitute, restart, restart_and_substitute"),
    ("others", "nan", "others must be one of unknown, last, zero, not the text 'nan'"),
    ("others", None, "others must be one of unknown, last, zero, not empty"),
    ("error", 0, "error must be above 0, not 0"),
    ("error", "5 %", "error must be above 0, not the text"),
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
    ("provides", {"1v": {"field": "data"}}, "'1v' cannot be the name of a property; a name has"),
    ("provides", {"v": {}}, "the property v lacks the key 'field'"),
    ("provides", {"v": 5}, "the property v must be a mapping"),
    ("checks", 5, "checks must be a mapping"),
    ("checks", {"jump": 1}, "jump is about one value: it stands with a property, under provides"),
    ("checks", {"rate": 1}, "checks has no key 'rate'"),
    ("checks", {"rate_low": "low"}, "rate_low must be false, true or a number"),
    ("checks", {"bad": 0}, "bad must be a whole number from 1 to 1000, not 0"),
    ("checks", {"of": 2.5}, "of must be a whole number"),
    ("checks", {"bad": 11}, "bad must be at most of, 10, not 11"),
    ("value checks", {"rate_low": 1}, "checks has no key 'rate_low'"),
    ("value checks", {"out_of_range": 3}, "out_of_range must be true or false, not 3"),
    ("value checks", {"jump": True}, "jump must be false or a number above 0, not true"),
    ("value checks", {"jmp": 1}, "did you mean jump?"),
    ("value checks", "on", "checks must be a mapping"),
]
for _limit in (0, -1):
    for _key in ("jump", "stuck"):
        BAD.append(("value checks", {_key: _limit}, f"{_key} must be false"))
    for _key in ("rate_high", "rate_low", "stale_stamp", "future_stamp", "unknown_publisher"):
        BAD.append(("checks", {_key: _limit}, f"{_key} must be false, true or a number above 0"))
for _number in (float("nan"), float("inf")):
    BAD.append(("checks", {"rate_high": _number}, f"a number above 0, not {_number}"))


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
    assert {error.where.split("/")[3] for error in errors} == {"v"}
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
        ("services:\n  a b: {}", 2, "'a b' cannot be the name of a service; a name has letters, "),
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
    som, errors = load_som(write(tmp_path, GOOD + "  w: 5\n  u: {topic: x y}\n"))
    assert len(som) == 3
    assert len(errors) == 6 and {error.where[-3:] for error in errors} == {":21", ":22"}


def test_one_bad_entry_hides_no_other(tmp_path: pathlib.Path, capsys: Any) -> None:
    text = GOOD.replace("period: 1\n", "period: -1\n").replace("node: /drivetrain", "node: no node")
    text = text.replace("{field: twist.twist.linear.x}", "{field: a b, quality: 2}")
    text = text.replace("standby: warm", "standbye: warm") + "extra: 1\n"
    path = write(tmp_path, text)
    with pytest.raises(ModelErrors) as caught:
        read_som(path)
    lines = str(caught.value).splitlines()
    assert [line.split(":")[1] for line in lines] == ["21", "8", "14", "15", "17", "17"]
    assert [str(error) for error in caught.value.errors] == lines
    assert caught.value.where == f"{path}:21" and "'extra'" in caught.value.what
    main(["check", str(ROOT / "test/unit/data/boat.yaml"), "--som", path, "--json"])
    found = json.loads(capsys.readouterr().out)["findings"]
    told = [each["where"] for each in found if each["level"] == "error"]
    assert [where for where in told if where in str(caught.value)] == [
        f"{path}:{line}" for line in (8, 14, 15, 17, 17, 21)
    ]
