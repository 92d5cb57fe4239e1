"""Drafts of a SOM and an ontology: valid whatever the robot is called, and harmless."""
import math
import random
from pathlib import Path
from typing import List, Sequence, Tuple

import pytest
from hypothesis import HealthCheck, assume, example, given, settings, strategies as st

from robots import Robot, times
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.kinds import Contain, Kind
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_learning.check import check_files
from shsa_learning.init.draft import MOST_COMMENTS, SMALLEST, UNLISTED, Draft, draft, widened
from shsa_learning.init.naming import service_names
from shsa_learning.init.survey import Publisher, Refused, Survey
from shsa_testing.thorough import many


@pytest.fixture
def read(tmp_path: Path) -> "Reader":
    return Reader(tmp_path)


class Reader:
    """Reads drafts, once they are checked."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self.listed = UNLISTED

    def __call__(self, survey: Survey) -> Tuple[Som, Draft]:
        made = draft(survey, "a test", listed=self.listed)
        som, ontology = self._folder / "som.yaml", self._folder / "ontology.yaml"
        som.write_text(made.som, encoding="utf-8")
        ontology.write_text(made.ontology, encoding="utf-8")
        findings = check_files(str(ontology), str(som))
        assert [each for each in findings if each.level == "error"] == []
        read_ontology(str(ontology))
        return read_som(str(som)), made


def drive(end: float = 20.0, period: float = 0.02) -> List[Tuple[float, float]]:
    """Values of a drive to and fro."""
    return [(t, math.sin(t)) for t in times(period, end, 0.1)]


def only(som: Som) -> Service:
    (service,) = som
    return service


def test_a_periodic_topic(read: Reader) -> None:
    robot = Robot()
    robot.says("/speed", drive())
    som, made = read(robot.survey())
    service = only(som)
    assert (service.name, service.topic, service.node) == ("speed", "/speed", "/node")
    assert service.period == 0.02 and not service.needed
    assert service.provides[0].usual == (-3.0, 3.0)
    assert "every 0.0" in made.som and "-1 to 1" in made.som


def test_no_draft_heals_anything(read: Reader) -> None:
    robot = Robot()
    for number in range(20):
        robot.says(f"/speed{number}", drive(5.0))
    som, _ = read(robot.survey(5.0))
    assert len(som) == 20 and som.needed() == ()


@pytest.mark.parametrize(
    "lowest, highest, wider",
    [
        (-1.0, 1.0, (-3.0, 3.0)),
        (0.0, 0.5, (-0.5, 1.0)),
        (12.0, 12.2, (5.9, 18.3)),
        (-5e-7, 5e-7, (-1.5e-6, 1.5e-6)),
        (0.0, 1e199, (-1e199, 2e199)),
    ],
)
def test_the_rule_of_ranges(lowest: float, highest: float, wider: Tuple[float, float]) -> None:
    assert widened(lowest, highest) == pytest.approx(wider)


@given(st.floats(-1e200, 1e200), st.floats(-1e200, 1e200))
@example(1e-30, 1e-30)
def test_a_range_holds_what_was_seen(one: float, other: float) -> None:
    assume(max(abs(one), abs(other)) >= SMALLEST)
    low, high = widened(min(one, other), max(one, other))
    assert low <= min(one, other) and max(one, other) <= high


@pytest.mark.parametrize(
    "values",
    [
        [(t, t) for t in times(0.1, 20.0)],
        [(t, 1.0) for t in times(0.1, 20.0)],
        [(t, random.Random(int(t * 10)).random()) for t in times(0.1, 20.0)],
    ],
    ids=["a counter", "one value", "noise alone"],
)
def test_what_may_go_on_has_no_range(read: Reader, values: List[Tuple[float, float]]) -> None:
    robot = Robot()
    robot.says("/a", values)
    assert only(read(robot.survey())[0]).provides[0].usual is None


def test_whole_numbers_stay_within_their_type(read: Reader) -> None:
    robot = Robot()
    values = [(t, (0.0, 2**31 - 1 if int(t) % 2 else 0)) for t in times(0.05, 20.0)]
    robot.says("/pair", values, kind="test_msgs/Pair")
    (provision,) = only(read(robot.survey())[0]).provides
    assert provision.usual is not None and provision.usual[1] <= 2**31 - 1


def test_constant_values_stand_in_comments_beside_one_that_moves(read: Reader) -> None:
    robot = Robot()
    robot.says("/pair", [(t, (v, 7)) for t, v in drive()], kind="test_msgs/Pair")
    som, made = read(robot.survey())
    assert only(som).properties == ("pair_left",)
    assert "always 7: right" in made.som


def test_a_robot_that_stands_has_all_its_values(read: Reader) -> None:
    robot = Robot()
    robot.says("/pair", [(t, (0.0, 0)) for t in times(0.1, 20.0)], kind="test_msgs/Pair")
    assert only(read(robot.survey())[0]).properties == ("pair_left", "pair_right")


def test_a_value_that_is_nan_at_times_is_no_failure(read: Reader) -> None:
    robot = Robot()
    robot.says("/a", [(t, math.nan if k % 50 == 0 else v) for k, (t, v) in enumerate(drive())])
    som, made = read(robot.survey())
    kinds = {check.kind for check in only(som).provides[0].checks}
    assert Kind.NOT_A_NUMBER not in kinds
    assert "2 % NaN" in made.som


def test_a_value_that_is_never_a_number_is_left_out(read: Reader) -> None:
    robot = Robot()
    robot.says("/pair", [(t, (math.nan, int(t))) for t, _ in drive()], kind="test_msgs/Pair")
    robot.says("/never", [(t, math.nan) for t, _ in drive()])
    som, made = read(robot.survey())
    assert only(som).properties == ("pair_right",)
    assert "always NaN: left" in made.som and "/never" in made.som


def test_a_latched_topic_and_one_in_bursts(read: Reader) -> None:
    robot = Robot()
    robot.says("/setting", [(1.0, 0.05)], latched=True)
    robot.says("/joystick", drive(3.0) + [(t + 10.0, v) for t, v in drive(3.0)])
    services = read(robot.survey())[0].services
    assert services["setting"].latched and services["setting"].event_driven
    assert not services["joystick"].latched and services["joystick"].event_driven


def test_a_latched_topic_may_be_periodic(read: Reader) -> None:
    robot = Robot()
    robot.says("/a", drive(), latched=True)
    service = only(read(robot.survey())[0])
    assert service.latched and service.period == 0.02


def test_a_topic_without_messages_has_what_its_type_has(read: Reader) -> None:
    robot = Robot()
    robot.is_silent("/battery", kind="sensor_msgs/BatteryState")
    som, made = read(robot.survey())
    assert {"battery_voltage", "battery_state_of_charge"} <= set(only(som).properties)
    assert only(som).event_driven and "no message came" in made.som


def test_two_publishers_of_one_topic_are_two_services_of_different_properties(
    read: Reader,
) -> None:
    robot = Robot()
    robot.says("/cmd_vel", drive(), node="/teleop")
    robot.says("/cmd_vel", drive(), node="/navigation")
    som, _ = read(robot.survey())
    assert sorted(som.services) == ["cmd_vel_navigation", "cmd_vel_teleop"]
    assert len({source.property for source in som.sources}) == 2


def test_a_node_with_duties_is_not_to_be_killed_and_the_draft_says_why(read: Reader) -> None:
    robot = Robot()
    robot.says("/odom", drive(), node="/base")
    robot.says("/imu", drive(), node="/imu")
    robot.says("/arm", drive(), node="/arm")
    robot.says("/cmd_vel", drive(), node="/teleop")
    robot.surveyor.refuse(Refused("/tf", "tf2_msgs/TFMessage", "/arm", "a frame"))
    heard = {("/cmd_vel", "/base"), ("/odom", "/imu"), ("/imu", "/shsa_init_1")}
    read.listed = frozenset({("/tf", "/base")}), frozenset(heard), frozenset({("/reset", "/imu")})
    som, made = read(robot.survey())
    contained = {name for name, each in som.services.items() if each.contain is Contain.NONE}
    assert contained == {"odom", "imu", "arm"}
    assert (
        "    contain: none  # it takes /cmd_vel and broadcasts tf, which nothing takes over\n"
        in made.som
    )
    assert "    contain: none  # it serves /reset, which nothing takes over\n" in made.som


def test_what_a_node_subscribes_to_is_not_replaced_by_what_it_publishes(read: Reader) -> None:
    robot = Robot()
    robot.says("/velocity", drive(), node="/dvl")
    robot.says("/depth", drive(), node="/pressure")
    robot.says("/odom", drive(), node="/nav")
    heard = {("/velocity", "/nav"), ("/depth", "/nav"), ("/odom", "/nav"), ("/unknown", "/nav")}
    read.listed = frozenset(), frozenset(heard), frozenset()
    som, made = read(robot.survey())
    assert som.services["odom"].derived_from == ("depth", "velocity")
    assert not som.services["velocity"].derived_from
    assert "    derived_from: [depth, velocity]  # its node subscribes to them" in made.som


def test_a_controller_and_what_it_controls_make_no_loop(read: Reader) -> None:
    robot = Robot()
    robot.says("/odom", drive(), node="/base")
    robot.says("/cmd_vel", drive(), node="/planner")
    read.listed = (
        frozenset(),
        frozenset({("/odom", "/planner"), ("/cmd_vel", "/base")}),
        frozenset(),
    )
    som, _ = read(robot.survey())
    assert som.services["cmd_vel"].derived_from == ("odom",)
    assert not som.services["odom"].derived_from
    assert not any(each.name in som.services[of].upstream for each in som for of in each.upstream)


def test_nodes_that_hear_each_other_make_no_loop(read: Reader) -> None:
    robot = Robot()
    names = ("front", "middle", "rear")
    for name in (*names, "sum"):
        robot.says(f"/{name}", drive(), node=f"/node_of_{name}")
    around = {
        (f"/{name}", f"/node_of_{after}") for name, after in zip(names, (*names[1:], names[0]))
    }
    read.listed = frozenset(), frozenset({*around, ("/rear", "/node_of_sum")}), frozenset()
    som, _ = read(robot.survey())
    assert {n for n, each in som.services.items() if each.derived_from} == {"sum"}
    assert not any(each.name in som.services[of].upstream for each in som for of in each.upstream)


def test_two_robots_on_one_master(read: Reader) -> None:
    robot = Robot()
    for name in ("/robot1", "/robot2"):
        robot.says(f"{name}/odom", drive(), node=f"{name}/base")
        robot.says(f"{name}/imu/data", drive(), node=f"{name}/imu")
    robot.says("/only/here", drive())
    names = sorted(read(robot.survey())[0].services)
    assert names == ["here", "robot1_imu_data", "robot1_odom", "robot2_imu_data", "robot2_odom"]


def names_of(*topics: str, nodes: Sequence[str] = ()) -> List[str]:
    each_node = nodes or ["/node"] * len(topics)
    publishers = [Publisher(t, "a/B", n) for t, n in zip(topics, each_node)]
    return list(service_names(publishers).values())


@pytest.mark.parametrize(
    "topics, names",
    [
        (["/imu/data"], ["imu"]),
        (["/imu/data", "/imu/data_raw"], ["imu", "data_raw"]),
        (["/sonar/left", "/sonar/right"], ["sonar_left", "sonar_right"]),
        (["/range/0", "/range/1"], ["range_0", "range_1"]),
        (["/a_b", "/a/b"], ["a_b_node", "a_b_node_2"]),
        (["/batteryVoltage"], ["battery_voltage"]),
        (["/min"], ["min_value"]),
        (["/class"], ["class_value"]),
        (["/dt", "/pi", "/x"], ["dt_value", "pi_value", "x"]),
        (["/3d"], ["n3d"]),
    ],
)
def test_names(topics: List[str], names: List[str]) -> None:
    assert names_of(*topics) == names


def test_long_names_are_cut_and_stay_apart() -> None:
    one, other = names_of("/" + "a" * 200, "/b/" + "a" * 200)
    assert one != other and len(one) <= 64


def test_names_that_collide_with_fields(read: Reader) -> None:
    robot = Robot()
    robot.says("/pair/left", drive())
    robot.says("/pair", [(t, (v, 1)) for t, v in drive()], kind="test_msgs/Pair")
    som, _ = read(robot.survey())
    assert len({source.property for source in som.sources}) == len(som.sources)


def test_who_published_what_a_recording_does_not_tell(read: Reader) -> None:
    robot = Robot()
    robot.says("/a", drive(), node="/unknown")
    robot.says("/b", drive(), node="/rostopic_4711_1700000000000")
    made = read(robot.survey())[1].som
    assert "fill in" in made and "give the node a fixed one" in made


def test_what_is_left_out_is_told_but_not_without_end(read: Reader) -> None:
    robot = Robot()
    for number in range(2000):
        robot.surveyor.refuse(Refused(f"/t{number}", "a/B", "/node", "it is\x1b[31m\nodd: #\u2028"))
    som, made = read(robot.survey())
    assert len(som) == 0 and made.left_out == 2000
    assert made.som.count("#   /t") == MOST_COMMENTS and "and 1800 more" in made.som
    assert made.som.isascii()


def test_an_empty_robot(read: Reader) -> None:
    som, made = read(Robot().survey())
    assert len(som) == 0 and made.services == made.properties == 0


strange = st.one_of(
    st.text(max_size=30),
    st.sampled_from(["", "/", "//", "~", "null", "/true", "- a", "a: b", "{}", "*x", "&x", "!!x"]),
    st.from_regex(r"(/[a-z_0-9]{1,4}){1,3}", fullmatch=True),
)
values = st.floats(allow_nan=True, allow_infinity=True)


@settings(max_examples=many(100), deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(st.tuples(strange, strange, st.lists(values, max_size=8)), max_size=8))
def test_whatever_a_robot_is_called_and_says_its_draft_is_valid(
    tmp_path: Path, rows: List[Tuple[str, str, List[float]]]
) -> None:
    robot = Robot()
    for topic, node, said in rows:
        robot.says(topic, [(0.1 * k, value) for k, value in enumerate(said)], node=node)
        robot.is_silent(topic + "/quiet", node)
    Reader(tmp_path)(robot.survey(1.0))
