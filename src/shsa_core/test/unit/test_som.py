"""The SOM: read from files and parameters, merged while running, every bad entry named."""
import pathlib
from typing import Any, Optional

import pytest
from som_trees import GOOD, SERVICE, changed, som_of, write

from shsa_core.errors import ModelError
from shsa_core.model.error import Error
from shsa_core.files.document import from_parameters
from shsa_core.files.som_file import merge_parameters, read_som, read_tree, som_parameters
from shsa_core.model.checks import (
    LEARNED,
    Checks,
    Frame,
    FutureStamp,
    Jump,
    Length,
    NotANumber,
    OutOfRange,
    RateHigh,
    RateLow,
    StaleStamp,
    Stuck,
    UnknownPublisher,
    Witness,
)
from shsa_core.model.kinds import Others, Policy, Standby
from shsa_core.model.service import (
    AdaptiveDeadline,
    Deadlines,
    LastResort,
    Provision,
    Service,
    Signal,
)
from shsa_core.model.names import file_name
from shsa_core.model.som import Som

ROOT = pathlib.Path(__file__).resolve().parents[2]
LEARNED_DEADLINE = {"false_alarms": 0.5}


@pytest.fixture
def good(tmp_path: pathlib.Path) -> Som:
    return read_som(write(tmp_path, GOOD))


def test_common_causes_are_names_and_nodes() -> None:
    som = som_of(changed("fails_with", ["usb_hub", "/driver", "usb_hub"]))
    (service,) = som
    assert service.fails_with == ("usb_hub", "/driver")
    assert service.causes == ("/n", "usb_hub", "/driver")
    assert service.sources[0].names == ("v", "/t", "/n", "usb_hub", "/driver")
    assert som_of(som_parameters(som)) == som
    for wrong in ("usb_hub", [3], ["a b"], [[]], [""]):
        with pytest.raises(ModelError, match="fails_with"):
            som_of(changed("fails_with", wrong))


def test_witnesses_by_the_known_errors() -> None:
    som = som_of(changed("value checks", {"witness": True}))
    assert Witness(LEARNED) in som.sources[0].provision.checks
    assert som_of(som_parameters(som)) == som


def test_the_error_that_users_of_a_value_tolerate() -> None:
    key = "fault_tolerant_error"
    som = som_of(changed(key, 0.5))
    assert som.sources[0].provision.fault_tolerant_error == 0.5
    assert som_of(som_parameters(som)) == som
    for wrong in (0.0, -1.0, "much", True, [0.5], float("nan")):
        with pytest.raises(ModelError, match="fault_tolerant_error must be "):
            som_of(changed(key, wrong))


def test_what_is_computed_from_a_service_is_left_out_with_it() -> None:
    tree = from_parameters(changed("derived_from", ["odometry", "/scan"]), "som")
    som, errors = read_tree(tree, "/robot")
    (service,) = som
    assert not errors and service.derived_from == ("/robot/odometry", "/scan")
    assert service.sources[0].names == ("v", "/t", "/n", "/robot/odometry", "/scan")
    assert som_of(som_parameters(som)) == som
    for wrong in ("odometry", [3], ["a b"], [[]], [""], ["v"], ["/t"]):
        with pytest.raises(ModelError, match="derived_from|derived from itself"):
            som_of(changed("derived_from", wrong))


def test_a_service_behind_a_gate_is_heard_elsewhere_than_its_node_publishes() -> None:
    other = {**SERVICE, "topic": "/o", "node": "/o", "provides": {"v": {"field": "data"}}}
    som = som_of(changed("gate", "/t/raw", o=other))
    service = som.services["v"]
    assert (service.topic, service.heard, service.gated) == ("/t/raw", "/t", True)
    assert som.of_topic("/t") == som.of_topic("/t/raw") == (service,)
    assert som.topics() == ("/t/raw", "/o")
    assert som_of(som_parameters(som)) == som
    (source,) = service.sources
    assert (source.path, source.output) == ("/t/data", "/t/raw/data")
    assert {"/t", "/t/raw"} < set(source.names)
    assert som.signal(source, Deadlines()).topic == "/t"
    assert som.signal(source, Deadlines(), written=True).topic == "/t/raw"
    plain = som.services["o"]
    assert (plain.topic, plain.heard, plain.gated) == ("/o", "/o", False)


@pytest.mark.parametrize("topic", ["/t", "/t/raw"])
def test_a_topic_at_a_gate_has_one_service(topic: str) -> None:
    other = {**SERVICE, "topic": topic, "node": "/o"}
    with pytest.raises(ModelError, match=f"{topic} is that of the service v already"):
        som_of(changed("gate", "/t/raw", o=other))
    with pytest.raises(ModelError, match="gate must be another topic"):
        som_of(changed("gate", "/t"))


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
        None,
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
    checks: {rate_low: false, rate_high: 2, stale_stamp: true, future_stamp: 0.8,
             frame: false, length: true, bad: 5, of: 20}
    last_resort: {values: {battery_current: 0}, command: [rosservice, call, /stop]}
    others: last
    provides:
      battery_current:
        field: data
        error: 0.05
        range: [-5.0, 60.0]
        checks: {stuck: 2.0, jump: 1.5, not_a_number: false}
"""


def test_every_option(tmp_path: pathlib.Path) -> None:
    (current,) = read_som(write(tmp_path, FULL))
    assert (current.deadline, current.standby) == (8.0, Standby.HOT)
    assert current.policy.substitutes and current.policy.restarts
    assert current.checks == Checks(
        (RateHigh(2.0), StaleStamp(LEARNED), FutureStamp(0.8), Length(True), UnknownPublisher(1.0)),
        bad=5,
        of=20,
    )
    assert (current.others, current.provides[0].error) == (Others.LAST, Error(0.05))
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


FIGURES = {
    "rms": 0.5,
    "bias": 0.1,
    "p95": 1.0,
    "delay": 0.2,
    "baseline": 2.0,
    "n": 7,
    "source": "s",
}


def test_figures_of_a_value_outlast_the_parameter_server() -> None:
    som = som_of(changed("error", FIGURES))
    (source,) = som.sources
    assert source.provision.error == Error(0.5, 0.1, 1.0, 0.2, 2.0, 7, "s")
    assert source.quality == 0.75
    tree: Any = som_parameters(som)
    provides = tree["services"]["v"]["provides"]["v"]
    assert provides["error"] == FIGURES and "quality" not in provides
    assert merge_parameters(som, tree) == (som, [])
    provides["error"]["rms"] = 1.0
    assert som_of(tree).sources[0].quality == 0.5  # it follows
    assert "in the SOM file alone" in merge_parameters(som, tree)[1][0].what
    provides["error"]["rms"] = -1
    merged, errors = merge_parameters(som, tree)
    assert merged == som
    assert str(errors[0]).startswith("shsa/som/services/v/provides/v/error/rms: ")
    tree = changed("error", FIGURES)
    tree["services"]["v"]["provides"]["v"]["quality"] = 1.0
    assert som_of(tree).sources[0].quality == 1.0
    assert merge_parameters(som_of(tree), som_parameters(som_of(tree))) == (som_of(tree), [])


def test_a_check_that_is_on_anyway_and_one_without_a_usual_limit() -> None:
    (service,) = som_of(changed("checks", {"rate_low": True, "unknown_publisher": False}))
    learned = StaleStamp(LEARNED), FutureStamp(LEARNED), Frame(True), Length(True)
    assert service.checks.each == (RateHigh(1.5), RateLow(0.6), *learned)
    (service,) = som_of(
        changed("value checks", {"stuck": True, "jump": False, "not_a_number": True})
    )
    assert service.provides[0].checks == (NotANumber(True), OutOfRange(True), Stuck(LEARNED))


@pytest.mark.parametrize(
    "key, value",
    [
        ("checks", {"rate_low": 0.5}),
        ("deadline", 3),
        ("deadline", LEARNED_DEADLINE),
        ("bridge", 2.5),
    ],
)
def test_an_event_driven_topic_has_no_rate_no_deadline_and_no_bridge(key: str, value: Any) -> None:
    tree = changed(key, value)
    tree["services"]["v"]["period"] = "none"
    with pytest.raises(ModelError, match="period|event-driven"):
        som_of(tree)


@pytest.mark.parametrize(
    "value, periods, bridges", [(False, 0.0, None), (1.5, 1.5, 1.5), (40, 40.0, 40.0)]
)
def test_a_bridge_is_a_number_of_periods_or_false(
    value: Any, periods: float, bridges: Optional[float]
) -> None:
    tree = changed("bridge", value)
    (service,) = som_of(tree)
    assert (service.bridge, service.bridges) == (periods, bridges)
    assert som_of(som_parameters(som_of(tree))) == som_of(tree)


@pytest.mark.parametrize("value", [True, 1.4, 0, -1, "long", 1e7])
def test_a_bridge_that_is_none_is_refused(value: Any) -> None:
    with pytest.raises(ModelError, match="bridge"):
        som_of(changed("bridge", value))


def test_who_provides_what_on_a_shared_topic() -> None:
    som = som_of(changed("period", 1, w=dict(SERVICE, node="/m", period="none")))
    v, w = som
    assert som.service_of("/t", "/n") is v and som.service_of("/t", "/m") is w
    assert som.service_of("/t", "/stranger") is som.service_of("/x", "/n") is None
    assert Som([v]).service_of("/t", "/stranger") is v
    deadlines = Deadlines(minimum=0.25)
    assert som.signal(v.sources[0], deadlines) == Signal(
        "/t", "data", "std_msgs/Float64", "/n", 1.0, 5.0
    )
    assert som.signal(w.sources[0], deadlines).deadline is None
    assert Som([v]).signal(v.sources[0], deadlines).node == ""


def test_a_latched_service_has_latched_signals() -> None:
    som = som_of(changed("latched", True))
    (v,) = som
    assert v.latched and som.signal(v.sources[0], Deadlines()).latched
    assert merge_parameters(som, som_parameters(som)) == (som, [])
    (v,) = som_of(changed("period", 1))
    tree: Any = som_parameters(Som([v]))
    assert not v.latched and "latched" not in tree["services"]["v"]


@pytest.mark.parametrize("field", ["velocity[name=left.wheel/1]", "min(ranges[10:50])", "yaw(q)"])
def test_a_field_outlasts_the_parameter_server_and_is_a_path(field: str) -> None:
    som = som_of(changed("field", field))
    assert merge_parameters(som, som_parameters(som)) == (som, [])
    (source,) = som.sources
    assert source.path == "/t/" + field and source.provision.field == field


def test_one_field_written_in_two_ways_provides_one_property() -> None:
    tree = changed("field", "min(ranges[:])")
    tree["services"]["v"]["provides"]["w"] = {"field": "min(ranges)"}
    with pytest.raises(ModelError, match="provides v already"):
        som_of(tree)


def test_a_deadline_that_is_learned_outlasts_the_parameter_server() -> None:
    som = som_of(changed("deadline", LEARNED_DEADLINE))
    (v,) = som
    assert v.deadline == AdaptiveDeadline(0.5)
    assert merge_parameters(som, som_parameters(som)) == (som, [])
    tree: Any = som_parameters(som)
    tree["services"]["v"]["deadline"] = {"false_alarms": -1}
    kept, errors = merge_parameters(som, tree)
    assert kept == som and "v/deadline/false_alarms: false_alarms must be" in str(errors[0])


def test_how_long_a_service_may_be_silent() -> None:
    (service,) = som_of(changed("period", 0.01))
    assert Deadlines(0.25).of(service) == 0.25
    assert Deadlines(0.02).of(service) == 0.05
    (service,) = som_of(changed("deadline", 2))
    assert Deadlines(0.25).of(service) == 0.2
    (service,) = som_of(changed("period", "none"))
    assert Deadlines().of(service) is None


RELATIVE = """
services:
  odometry:
    topic: odom
    type: nav_msgs/Odometry
    node: base/drivetrain
    period: 0.02
    provides: {v: {field: twist.twist.linear.x}}
  clock: {topic: /clock, type: p/T, node: /host, period: none, provides: {t: {field: x}}}
"""


@pytest.mark.parametrize(
    "namespace, root",
    [("/", ""), ("", ""), ("/robot1", "/robot1"), ("robot1/", "/robot1"), ("/a/b/", "/a/b")],
)
def test_relative_names_are_in_the_namespace_and_full_ones_are_not(
    tmp_path: pathlib.Path, namespace: str, root: str
) -> None:
    som = read_som(write(tmp_path, RELATIVE), namespace)
    assert [(s.topic, s.node) for s in som] == [
        (f"{root}/odom", f"{root}/base/drivetrain"),
        ("/clock", "/host"),
    ]
    # On the parameter server the names may stand as in the file, or in full.
    assert merge_parameters(som, som_parameters(som), "p", namespace) == (som, [])
    services: Any = som_parameters(som)["services"]
    raw = {"services": {"odometry": dict(services["odometry"])}}
    raw["services"]["odometry"].update(topic="odom", node="base/drivetrain", period=1.0)
    merged, errors = merge_parameters(som, raw, "p", namespace)
    assert not errors and merged.services["odometry"].period == 1.0
    raw["services"]["odometry"]["node"] = "/elsewhere/base/drivetrain"
    assert "can be changed there alone" in str(merge_parameters(som, raw, "p", namespace)[1][0])


@pytest.mark.parametrize(
    "path, namespace, there",
    [
        ("/log/a.journal", "/", "/log/a.journal"),
        ("/log/a.journal", "/robot1/", "/log/robot1-a.journal"),
        ("run_a.journal", "/fleet/robot1", "fleet-robot1-run_a.journal"),
    ],
)
def test_robots_have_files_of_their_own(path: str, namespace: str, there: str) -> None:
    assert file_name(path, namespace) == there


def test_two_names_of_one_topic_clash_where_they_are_one(tmp_path: pathlib.Path) -> None:
    path = write(
        tmp_path,
        RELATIVE
        + "  o: {topic: /r/odom, type: p/T, node: /n, period: 1, provides: {w: {field: x}}}\n",
    )
    assert len(read_som(path)) == 3
    with pytest.raises(ModelError, match="/r/odom has the type nav_msgs/Odometry already"):
        read_som(path, "/r")
