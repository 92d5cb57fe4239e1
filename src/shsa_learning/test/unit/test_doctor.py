"""`shsa doctor`: each finding by what was seen, with a remedy; none on a robot that is well."""
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Dict, List, Optional
from unittest.mock import Mock

import pytest

from shsa_core.cli.main import main
from shsa_core.healing.incident import Incident, State
from shsa_core.model.kinds import Contain, Kind, Policy
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_learning.check import check_model
from shsa_learning.doctor import Seen, fates, findings
from shsa_learning.finding import Finding

VALUES = (Provision("speed", "data", (0.0, 1.0)),)
ODOMETRY = Service("odometry", "/odom", "std_msgs/Float64", "/base", 0.1, VALUES, needed=True)
PUBLISHERS: Dict[str, List[str]] = {
    "/odom": ["/base"],
    "/shsa/som_state": ["/reconfigurator"],
    "/tf": ["/other"],
}
WELL = Seen(
    Som([ODOMETRY]),
    "/",
    PUBLISHERS,
    {"/odom": ["/monitor", "/planner"]},
    masters={"http://pi:11311": ["base"]},
    users={"/base": "robot"},
    user="robot",
)
LEFT = Incident(
    1,
    "odometry",
    "/odom",
    ("speed",),
    "/base",
    Kind.OUT_OF_RANGE,
    "speed is -0.4, 0 to 1 is allowed",
    10.0,
    State.ENDED,
)


def test_a_loop_through_a_consumer_is_an_error() -> None:
    estimator = Service("battery", "/battery", "std_msgs/Float64", "/soc", 0.1, VALUES)
    middle = replace(estimator, name="middle", topic="/m", derived_from=("battery",))
    told = replace(estimator, derived_from=("odometry",))

    def loops(*services: Service) -> List[Finding]:
        found = check_model(Ontology({}, {}, []), Som(services))
        return [each for each in found if "is derived from" in each.what]

    assert loops(ODOMETRY, told, middle) == []
    found = loops(replace(ODOMETRY, derived_from=("middle",)), told, middle)
    assert {each.level for each in found} == {"error"}
    assert found[0].what.startswith(
        "odometry is derived from middle, which is derived from odometry"
    )


LOST = {**PUBLISHERS, "/odom": ["/stranger"]}


def test_nothing_is_found_on_a_robot_that_is_well() -> None:
    assert findings(WELL) == []
    clock = {**PUBLISHERS, "/clock": ["/gazebo"]}
    assert findings(WELL._replace(use_sim_time=True, publishers=clock)) == []


@pytest.mark.parametrize(
    "changes, what",
    [
        ({"secret": "the secret /s cannot be read: No such file"}, "cannot be read"),
        ({"masters": {"http://pi:1": ["a"], "http://localhost:1": ["b"]}}, "has 2 names"),
        ({"user": "root", "users": {}}, "as root"),
        ({"users": {"/base": "bob"}}, "/base runs as bob"),
        ({"clocks": ["computer pi: its clock is 2 s ahead"]}, "2 s ahead"),
        ({"unusual": ["odometry: doubtful: v is 5, 0 to 3 are usual"]}, "v is 5"),
        ({"use_sim_time": True}, "nobody publishes /clock"),
        ({"incidents": [LEFT, LEFT]}, "odometry left its range 2 times"),
        ({"subscribers": {"/odom": ["/monitor", "/record_123", "/substitute_x_1"]}}, "nobody sub"),
        ({"types": ["odometry: message type a/B is not known here"]}, "a/B is not known"),
        ({"publishers": {**PUBLISHERS, "/r/shsa/som_state": ["/r/reconfigurator"]}}, "beside"),
        ({"publishers": {**PUBLISHERS, "/shsa/som_state": ["/a", "/b"]}}, "/a, /b heal"),
        ({"log": "/log: cannot be read: No such file or directory"}, "incident log /log: cannot"),
        ({"publishers": LOST}, "/base does not publish /odom, but /stranger"),
    ],
)
def test_each_fault_is_found_once_with_its_remedy(changes: Dict[str, Any], what: str) -> None:
    (finding,) = findings(WELL._replace(**changes))
    assert what in finding.what and finding.remedy


def test_topics_that_nobody_subscribes_to_are_one_finding() -> None:
    som = Som([replace(ODOMETRY, name=name, topic=f"/{name}") for name in "cab"])
    publishers = {f"/{name}": ["/base"] for name in "abc"}
    found = findings(WELL._replace(som=som, publishers=publishers, subscribers={"/b": ["/x"]}))
    assert [each.what for each in found] == ["needed, and nobody subscribes to /a, /c"]


DUTIES = {"/base": ("takes /cmd_vel", "broadcasts tf")}
IT = "it takes /cmd_vel and broadcasts tf"


@pytest.mark.parametrize(
    "of_service, duties, fate",
    [
        ({}, DUTIES, f"is kept: {IT}, which nothing takes over"),
        (
            {},
            {},
            "is killed if something replaces it, unless it is only silent",
        ),
        ({"contain": Contain.NONE}, DUTIES, "is kept: the SOM says so of /odom"),
        (
            {"contain": Contain.NODE},
            DUTIES,
            f"is killed: the SOM says so of /odom. That costs: {IT}",
        ),
        (
            {"policy": Policy.RESTART},
            DUTIES,
            f"is killed: its policy is to start it again. That costs: {IT}",
        ),
        ({"policy": Policy.ADVISE}, DUTIES, "is kept: the policy of /odom is to advise"),
    ],
)
def test_what_becomes_of_a_node_is_told_beforehand(
    of_service: Dict[str, Any], duties: Dict[str, Any], fate: str
) -> None:
    som = Som([replace(ODOMETRY, **of_service)])
    assert fates(WELL._replace(som=som, duties=duties)) == [f"if /base fails it {fate}"]
    assert findings(WELL._replace(som=som, duties=duties)) == []


@pytest.mark.parametrize(
    "contain, kept", [(None, True), (Contain.NODE, False), (Contain.NONE, False)]
)
def test_check_tells_beside_a_robot_that_runs_whom_healing_keeps(
    contain: Optional[Contain], kept: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    checks = pytest.importorskip("shsa_learning.ros.checks")
    listed: Any = [[["/odom", ["/base"]]], [["/drive_by", ["/base"]]], []]
    master = SimpleNamespace(getSystemState=lambda: listed)
    monkeypatch.setattr(checks, "master_api", lambda _: master)
    som = Som([replace(ODOMETRY, contain=contain)])
    found = [each.what for each in checks.check_running(som, "/")]
    said = "if /base fails it is kept: it takes /drive_by, which nothing takes over"
    assert found == ([said] if kept else [])


@pytest.mark.parametrize(
    "topic, derived_from, said",
    [
        ("/imu", (), True),
        ("/imu", ("/scan",), True),
        ("/imu", ("imu",), False),
        ("/imu", ("/imu",), False),
        ("/cmd_vel", (), False),  # the other warning tells of it
        ("/nobody_hears_it", (), False),
    ],
)
def test_check_tells_beside_a_robot_that_runs_what_is_not_said_to_be_derived(
    topic: str, derived_from: Any, said: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    checks = pytest.importorskip("shsa_learning.ros.checks")
    heard = [["/imu", ["/base"]], ["/cmd_vel", ["/base"]], ["/odom", ["/imu", "/rviz"]]]
    listed: Any = [[["/odom", ["/base"]], [topic, ["/imu"]]], heard, []]
    master = SimpleNamespace(getSystemState=lambda: listed)
    monkeypatch.setattr(checks, "master_api", lambda _: master)
    base = replace(ODOMETRY, derived_from=derived_from, contain=Contain.NONE)
    imu = replace(ODOMETRY, name="imu", topic=topic, node="/imu", derived_from=("odometry",))
    second = replace(base, name="speed", topic="/speed", derived_from=())
    som = Som([base, second, replace(imu, contain=Contain.NONE)])
    found = [f"{each.what}. {each.todo}" for each in checks.check_running(som, "/")]
    assert bool(found) is said and len(found) < 2
    if said:
        assert (
            "/base subscribes to imu, and no `derived" in found[0]
            and "derived_from: [imu]" in found[0]
        )


def test_check_finds_nothing_where_no_robot_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    checks = pytest.importorskip("shsa_learning.ros.checks")
    refuse = Mock(side_effect=ConnectionRefusedError)
    monkeypatch.setattr(checks, "master_api", lambda _: SimpleNamespace(getSystemState=refuse))
    assert list(checks.check_running(Som([ODOMETRY]), "/")) == [] and refuse.called


def test_a_node_is_told_of_once() -> None:
    other = replace(ODOMETRY, name="speed", topic="/speed")
    seen = WELL._replace(som=Som([ODOMETRY, other]), duties=DUTIES)
    assert fates(seen) == fates(seen._replace(publishers={**PUBLISHERS, "/speed": ["/base"]}))
    assert fates(seen._replace(publishers=LOST)) == []


@pytest.mark.parametrize("named, is_there, told", [(1, 0, 1), (1, 1, 1), (0, 1, 1), (0, 0, 0)])
def test_a_log_that_cannot_be_read_is_told_unless_there_is_none_yet(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, named: int, is_there: int, told: int
) -> None:
    examination = pytest.importorskip("shsa_learning.ros.examination")
    log = tmp_path / "incidents.jsonl"
    if is_there:
        log.write_text("no incident\n")
    monkeypatch.setattr(examination, "log_path", lambda _: str(log))
    incidents, why = examination._recent(str(log) if named else "")
    assert incidents == [] and why.startswith(str(log)) is bool(told)


@pytest.mark.parametrize("act, when", [(True, "now"), (False, "once healing acts")])
def test_what_becomes_of_a_node_is_so_now_where_healing_acts(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, act: bool, when: str
) -> None:
    examination = pytest.importorskip("shsa_learning.ros.examination")
    seen = WELL._replace(som=Som([ODOMETRY], act=act))
    monkeypatch.setattr(examination, "examine", lambda *_: seen)
    assert main(["doctor"]) == 0
    assert f"\nwhat becomes of a node, {when}:\n" in capsys.readouterr().out
