"""The survey of an unknown robot: what comes regularly, and how values are spread."""
import math
import random
import tracemalloc
from typing import List

import pytest

from robots import Robot, layout, times
from shsa_core import message_types
from shsa_core.errors import ShsaError
from shsa_learning.units.unit import parse_unit
from shsa_learning.init.contents import MOST_ELEMENTS, Array, contents, elements
from shsa_learning.init.meanings import MEANINGS, NOTHING
from shsa_learning.init.spread import KEPT, RhythmTally, Sample, Spread, SpreadTally
from shsa_learning.init.survey import (
    MOST_FIELDS,
    MOST_PUBLISHERS,
    Publisher,
    irregular,
    nice,
    outside,
)


def rhythm_of(moments: List[float], end: float = 20.0) -> str:
    """Return why messages do not come regularly."""
    tally = RhythmTally()
    for moment in moments:
        tally.add(moment)
    return irregular(tally.result(end))


def spread_of(values: List[float]) -> Spread:
    tally = SpreadTally()
    for value in values:
        tally.add(value)
    return tally.result()


@pytest.mark.parametrize("period", [0.001, 0.02, 0.0333, 0.5, 2.0])
def test_a_regular_stream_is_regular(period: float) -> None:
    assert rhythm_of(times(period, 20.0, jitter=0.2)) == ""


def test_one_short_pause_of_the_computer_leaves_a_period() -> None:
    moments = times(0.02, 20.0)
    pause = lambda at: 10.2 if 10.0 < at < 10.2 else at  # what came meanwhile comes at its end
    assert rhythm_of([pause(at) for at in moments]) == ""


def test_events_at_random_are_event_driven() -> None:
    draw = random.Random(1)
    moments = [sum(draw.expovariate(10.0) for _ in range(1)) for _ in range(200)]
    for place in range(1, len(moments)):
        moments[place] += moments[place - 1]
    assert rhythm_of(moments, moments[-1]) != ""


@pytest.mark.parametrize(
    "moments, why",
    [
        ([], "no message"),
        ([1.0], "1 message came"),
        ([1.0, 2.0, 3.0, 4.0], "4 messages came"),
        ([1.0] * 9, "same moment"),
        (times(0.1, 3.0) + [12.0 + t for t in times(0.1, 8.0)], "pauses of up to 9.1 s"),
        (times(0.1, 3.0), "pauses of up to 17.1 s"),
        (times(0.1, 10.0) + [10.0 + t for t in times(0.05, 10.0)], "the rate changes"),
        ([5e-5 * k for k in range(1000)], "no SOM"),
    ],
    ids=["none", "one", "few", "at once", "a pause", "it stopped", "twice the rate", "too fast"],
)
def test_what_is_not_regular_says_why(moments: List[float], why: str) -> None:
    end = 20.0 if why != "no SOM" else moments[-1]
    assert why in rhythm_of(moments, end)


def test_a_clock_that_goes_back_breaks_nothing() -> None:
    assert rhythm_of([1.0, 2.0, 1.5, 0.5, 3.0, 4.0], 4.0) != "no message came"


@pytest.mark.parametrize(
    "period, written", [(0.020034, 0.02), (0.0333, 0.033), (0.0105, 0.0105), (1.0 / 30, 0.033)]
)
def test_a_period_is_as_a_person_would_write_it(period: float, written: float) -> None:
    assert nice(period) == written


def test_the_spread_of_values() -> None:
    spread = spread_of([float(k) for k in range(101)] + [math.nan, math.inf])
    assert (spread.lowest, spread.highest, spread.p5, spread.p95) == (0.0, 100.0, 5.0, 95.0)
    assert spread.nan == spread.infinite == 1 / 103
    assert spread.one_way and not spread.constant and not spread.trembles


def test_noise_trembles_and_a_drive_does_not() -> None:
    draw = random.Random(1)
    noise = [draw.gauss(0.0, 0.1) for _ in range(1000)]
    assert spread_of([12.0 + each for each in noise]).trembles
    assert not spread_of([math.sin(k / 50) + each for k, each in enumerate(noise)]).trembles


def test_constant_means_one_value_and_no_other() -> None:
    assert spread_of([1.0, 1.0]).constant
    assert not spread_of([1.0, math.nan]).constant
    assert not spread_of([math.nan, math.nan]).constant


@pytest.mark.parametrize("count", [1, KEPT - 1, KEPT, KEPT + 1, 100_000])
def test_percentiles_need_no_more_memory_the_more_comes(count: int) -> None:
    sample = Sample()
    for value in range(count):
        sample.add(float(value))
    (median,) = sample.quantiles(0.5)
    assert median == pytest.approx(count / 2, abs=1 + count / 100)
    assert len(sample._kept) <= KEPT


def test_every_unit_is_one() -> None:
    for fields in MEANINGS.values():
        for meaning in fields.values():
            parse_unit(meaning.unit)


@pytest.mark.parametrize("kind", [each for each in MEANINGS if not each.startswith("ackermann")])
def test_every_field_with_a_meaning_is_in_its_type(kind: str) -> None:
    assert set(MEANINGS[kind]) <= set(message_types.layout(kind))


def units(kind: str) -> List[str]:
    found = contents(kind, layout)
    return [f"{'_'.join(each.words)} {each.meaning.unit}" for each in found.numbers]


def test_the_numbers_of_an_odometry() -> None:
    told = units("nav_msgs/Odometry")
    assert told[:6] == ["x m", "y m", "z m", "roll rad", "pitch rad", "yaw rad"]
    assert told[6:8] == ["linear_velocity_x m/s", "linear_velocity_y m/s"]
    assert told[-1] == "angular_velocity_z rad/s"


def test_covariances_headers_and_texts_are_no_values() -> None:
    found = contents("sensor_msgs/Imu", layout)
    fields = [each.field for each in found.numbers]
    assert "yaw(orientation)" in fields and "linear_acceleration.z" in fields
    assert not [each for each in fields if "covariance" in each or "header" in each]
    assert found.arrays == ()


def test_the_distances_of_a_scan_are_the_nearest() -> None:
    found = contents("sensor_msgs/LaserScan", layout)
    nearest = next(each for each in found.numbers if each.field == "min(ranges)")
    assert nearest.meaning.unit == "m" and not nearest.meaning.bounded


def test_joints_are_known_by_their_names() -> None:
    position = contents("sensor_msgs/JointState", layout).arrays[0]
    found, left_out = elements(position, 2, ["left wheel", "arm"])
    assert [each.field for each in found] == ["position[name=arm]"]
    assert [each.path for each in left_out] == ["position[name=left wheel]"]
    assert elements(position, 2, ["arm", "arm"])[0] == []


def test_a_name_without_a_value_is_none() -> None:
    velocity = contents("sensor_msgs/JointState", layout).arrays[1]
    assert elements(velocity, 0, ["arm"]) == ([], [])


def test_short_arrays_are_listed_and_long_ones_told() -> None:
    array = Array("data", "float64", None, "", NOTHING, ())
    found, _ = elements(array, MOST_ELEMENTS)
    assert [each.field for each in found][:2] == ["data[0]", "data[1]"]
    found, left_out = elements(array, MOST_ELEMENTS + 1)
    assert found == [] and "data[0]" in left_out[0].why


def test_messages_in_arrays_are_told() -> None:
    found = contents("nav_msgs/Path", layout)
    assert found.numbers == ()
    assert "PoseStamped" in found.left_out[0].why


def test_a_type_that_is_not_here_is_refused() -> None:
    with pytest.raises(ShsaError, match="nowhere_msgs"):
        contents("nowhere_msgs/Thing", message_types.layout)


def test_a_topic_has_one_type() -> None:
    robot = Robot()
    robot.says("/a", [(0.0, 1.0)])
    robot.says("/a", [(0.0, (1.0, 2))], node="/other", kind="test_msgs/Pair")
    survey = robot.survey()
    assert len(survey.facts) == 1
    assert "has the type test_msgs/Number" in survey.refused[0].why


def test_a_survey_has_bounds() -> None:
    robot = Robot()
    tracemalloc.start()
    try:
        for number in range(MOST_PUBLISHERS + 100):
            robot.is_silent(f"/t{number}")
        assert tracemalloc.get_traced_memory()[0] < 100e6
    finally:
        tracemalloc.stop()
    survey = robot.survey()
    assert len(survey.facts) == MOST_PUBLISHERS
    assert len(survey.refused) == 1 and "more than 5000" in survey.refused[0].why


def test_fields_have_bounds() -> None:
    robot = Robot()
    kind = "sensor_msgs/LaserScan"
    for number in range(MOST_FIELDS // len(contents(kind, layout).numbers) + 10):
        robot.is_silent(f"/t{number}", kind=kind)
    survey = robot.survey()
    assert sum(len(each.fields) for each in survey.facts) == MOST_FIELDS
    assert [each for each in survey.facts if each.left_out]


def test_of_many_messages_ever_fewer_are_read() -> None:
    robot, publisher = Robot(), Publisher("/a", "test_msgs/Number", "/node")
    robot.surveyor.knows(publisher)
    read = sum(robot.surveyor.wants(publisher, 8) for _ in range(100_000))
    assert 10_000 < read < 50_000
    assert not robot.surveyor.wants(publisher, 1_000_000)


@pytest.mark.parametrize(
    "topic, kind, node",
    [
        ("/rosout", "rosgraph_msgs/Log", "/a"),
        ("/clock", "rosgraph_msgs/Clock", "/a"),
        ("/diagnostics", "diagnostic_msgs/DiagnosticArray", "/a"),
        ("/robot1/shsa/incidents", "shsa_msgs/Incident", "/a"),
        ("/move/goal", "move_base_msgs/MoveBaseActionGoal", "/a"),
        ("/tf", "tf2_msgs/TFMessage", "/a"),
        ("/camera", "sensor_msgs/Image", "/a"),
        ("/current", "std_msgs/Float64", "/substitute_current_1"),
        ("/current", "std_msgs/Float64", "/monitor"),
        ("relative", "std_msgs/Float64", "/a"),
        ("/a b", "std_msgs/Float64", "/a"),
        ("/a\n  b:", "std_msgs/Float64", "/a"),
        ("/" + "a" * 300, "std_msgs/Float64", "/a"),
        ("/a", "*", "/a"),
        ("/a", "std_msgs/Float64\n", "/a"),
        ("/a", "std_msgs/Float64", "no/node"),
        ("/a", "std_msgs/Float64", "/\u00e4"),
    ],
)
def test_what_is_no_part_of_a_survey(topic: str, kind: str, node: str) -> None:
    assert outside(topic, kind, node)


def test_what_is_part_of_a_survey() -> None:
    assert outside("/robot1/odom", "nav_msgs/Odometry", "/robot1/base") == ""
    assert outside("/robot1/odom", "nav_msgs/Odometry", "") == ""


def test_a_topic_that_nobody_listens_to_any_more_is_not_silent() -> None:
    robot = Robot()
    robot.says("/a", [(t, 1.0) for t in times(0.1, 5.0)])
    robot.says("/b", [(t, 1.0) for t in times(0.1, 5.0)])
    robot.surveyor.stops("/a", 5.0)
    periods = {each.publisher.topic: each.period for each in robot.survey().facts}
    assert periods == {"/a": 0.1, "/b": None}
