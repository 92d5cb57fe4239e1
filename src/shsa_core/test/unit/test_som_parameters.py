"""The SOM as parameters: what counts of a change, and what comes from the file alone."""
import pathlib
from typing import Any, Dict

import pytest
from som_trees import GOOD, SERVICE, changed, som_of, write

from shsa_core.files.som_file import FROM_FILE_ALONE, merge_parameters, read_som, som_parameters
from shsa_core.model.som import Som


@pytest.fixture
def good(tmp_path: pathlib.Path) -> Som:
    return read_som(write(tmp_path, GOOD))


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
    assert som_of({"services": {}, "act": True}) == Som()


def test_a_number_is_one_parameter(good: Som) -> None:
    tree: Any = som_parameters(good)
    tree["services"]["odometry"]["period"] = 1.5
    som, errors = merge_parameters(good, tree)
    assert errors == [] and som.services["odometry"].period == 1.5
    assert [each.name for each in som if each != good.services[each.name]] == ["odometry"]


@pytest.mark.parametrize("key", FROM_FILE_ALONE)
def test_what_decides_whom_healing_kills_comes_from_the_file_alone(key: str) -> None:
    others: Dict[str, Any] = {"topic": "/x", "type": "a/B", "node": "/x", "policy": "restart"}
    others.update(contain="none", gate="/t/raw")
    others.update(needed=True, deadline=9.0, checks={"rate_low": False})
    others.update(fails_with=["usb_hub"], derived_from=["/odometry_raw"])
    others.update(host="pi", placement={"forbid": ["pi"]}, on_partition="wait")
    others.update(prefer=["f1"], avoid=["/camera"], cost=7)
    hosts: Dict[str, Dict[str, float]] = {"pi": {}, "board": {"cores": 2.0}}
    old = som_of({**changed("period", 0.1), "hosts": hosts})
    som, errors = merge_parameters(old, {**changed(key, others[key]), "hosts": hosts})
    assert som == old and len(errors) == 1
    assert f"{key} is " in errors[0].what and "can be changed there alone" in errors[0].what


@pytest.mark.parametrize(
    "key, value, words",
    [
        ("field", "other", "properties and fields can be changed in the SOM file alone"),
        ("provides", {"w": {"field": "data"}}, "properties and fields can be changed"),
        ("last_resort", {"command": ["reboot"]}, "a command can be in the SOM file only"),
    ],
)
def test_neither_fields_nor_commands_come_from_parameters(key: str, value: Any, words: str) -> None:
    old = som_of(changed("period", 0.1))
    som, errors = merge_parameters(old, changed(key, value))
    assert som == old and words in errors[0].what


def test_parameters_make_a_range_only_wider_than_in_the_file(good: Som) -> None:
    tree: Any = som_parameters(good)
    value = tree["services"]["current"]["provides"]["battery_current"]
    value["range"] = [-5.0, 70.0]
    wider, errors = merge_parameters(good, tree)
    assert errors == [] and wider != good
    value["range"] = [-5.0, 59.0]
    som, errors = merge_parameters(good, tree, current=wider)
    assert som == wider and "only the SOM file can make it narrower" in errors[0].what
    value["range"] = [-5.0, 60.0]
    assert merge_parameters(good, tree, current=wider) == (good, [])
    for key, changed_ in {"checks": {"jump": 1.0}, "fault_tolerant_error": 2.0}.items():
        value[key] = changed_
        told = f"{key} of battery_current can be changed in the SOM file alone"
        assert merge_parameters(good, tree)[1][0].what == told
        del value[key]


def test_small_steps_never_lead_to_less_than_the_file_allows(good: Som) -> None:
    """Four steps, each small, of each number: only those the other way count."""
    live = good
    for step in range(1, 5):
        tree: Any = som_parameters(live)
        current = tree["services"]["current"]
        current["period"] = 0.02 * (1 - step / 20)
        current["provides"]["battery_current"]["range"] = [-5.0 + step, 60.0 - step]
        live, errors = merge_parameters(good, tree, current=live)
        assert live == good and len(errors) == 1
    for step in range(1, 5):
        tree["services"]["current"]["period"] = 0.02 * (1 + step / 20)
        tree["services"]["current"]["provides"]["battery_current"]["range"] = [-5.0 - step, 60.0]
        live, errors = merge_parameters(good, tree, current=live)
        assert errors == [] and live.services["current"].fastest == 0.02
    tree["services"]["current"]["period"] = 0.019
    assert "only the SOM file can make it shorter" in merge_parameters(good, tree)[1][0].what


def test_what_allows_more_than_the_file_is_marked_until_it_is_taken_back(good: Som) -> None:
    tree: Any = som_parameters(good)
    service = tree["services"]["current"]
    service["period"] = "none"
    service["provides"]["battery_current"]["range"] = [-5.0, 90.0]
    live, _ = merge_parameters(good, tree)
    assert live.services["current"].weakened == (
        "period: none (in the SOM file 0.02), "
        "range of battery_current: (-5.0, 90.0) (in the SOM file (-5.0, 60.0))"
    )
    service["provides"]["battery_current"]["range"] = [-5.0, 60.0]
    live, _ = merge_parameters(good, tree, current=live)
    assert live.services["current"].weakened == "period: none (in the SOM file 0.02)"
    service["period"] = 0.02
    assert merge_parameters(good, tree, current=live) == (good, [])


@pytest.mark.parametrize("error", [{"rms": 0.001}, {"rms": 0.001, "p95": 0.002}])
def test_an_error_that_convicts_sooner_comes_from_the_file_alone(error: Any) -> None:
    old = som_of(changed("period", 0.1))
    tree: Any = som_parameters(old)
    for name, service in tree["services"].items():
        for value in service["provides"].values():
            value["error"] = error
    som, errors = merge_parameters(old, tree)
    assert som == old and "error of" in errors[0].what and "file alone" in errors[0].what


def test_what_was_valid_last_stays(good: Som) -> None:
    tree: Any = som_parameters(good)
    tree["services"]["current"]["period"] = 0.021
    valid, _ = merge_parameters(good, tree)
    tree["services"]["current"]["period"] = -3
    som, errors = merge_parameters(good, tree, current=valid)
    assert som.services["current"].period == 0.021 and len(errors) == 1


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


def test_whether_healing_acts_comes_from_the_file_alone(good: Som, tmp_path: pathlib.Path) -> None:
    acting = read_som(write(tmp_path, "act: true\n" + GOOD))
    assert (good.act, acting.act) == (False, True) and acting != good
    for file in good, acting:
        tree: Any = som_parameters(file)
        assert merge_parameters(file, tree) == (file, [])
        som, errors = merge_parameters(file, {**tree, "act": not file.act})
        assert som == file and [error.where for error in errors] == ["shsa/som/act"]


@pytest.mark.parametrize("value", [None, 5, "x", [], [1], True, float("nan"), {"current": {}}])
def test_a_tree_that_is_no_som_changes_nothing(good: Som, value: Any) -> None:
    som, errors = merge_parameters(good, value)
    assert som == good and errors[0].where.startswith("shsa/som")


def test_a_tree_that_is_no_value_changes_nothing(good: Som) -> None:
    som, errors = merge_parameters(good, {"services": {"current": [b"x"]}})
    assert som == good and [e.where for e in errors] == ["shsa/som/services/current"]
    assert merge_parameters(good, 5, "/x")[1][0].where == "/x"
