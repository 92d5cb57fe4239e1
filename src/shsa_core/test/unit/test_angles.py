"""Angles: a zero that may be any, and the turn that they make."""
import math
from dataclasses import replace
from typing import List, Optional

import pytest
from shsa_core.codegen.program import compile_periodic
from shsa_core.model.error import Error
from shsa_core.substitution import events
from shsa_core.substitution.job import Job
from substitute_driver import PERIOD, Driver, row, signal

YAW = "yaw(pose.pose.orientation)"


def at(time: float) -> int:
    """The stamp of a moment."""
    return round((100.0 + time) * 1e9)


@pytest.mark.parametrize("error, zero", [(Error(0.014), 0.0), (None, 0.0), (None, 2.0)])
def test_a_turning_robot_is_where_it_was_plus_its_turn(error: Optional[Error], zero: float) -> None:
    """The input turns by 1 rad/s; the original fails at 1 s, which is seen 0.6 s later."""
    out = replace(signal("/out", field=YAW, type="nav_msgs/Odometry"), error=error)
    driver = Driver(row(False, outputs=(out,)))
    driver.ready()
    while driver.time < 3.0:
        stamp = at(driver.time)
        told = (("data", driver.time),), stamp, stamp
        driver.tell(events.InputArrived, "/in", "/sensor", *told)
        driver.pass_to(round(driver.time + PERIOD, 9))
        if driver.time == 1.6:
            last = events.LastMessage(((YAW, 1.0 + zero),), at(1.0))
            taken = replace(driver.core.row, publishing=True, last_message=b"m")
            driver.tell(events.RowChanged, taken, (), last, at(driver.time))
    published = driver.published(1.6)
    assert len(published) > 50
    for time, value in published:
        assert value == pytest.approx(time + zero, abs=2 * PERIOD)


def turned(text: str, angle: bool = True) -> List[float]:
    """What a program makes of an angle that turns by 1 rad/s for two turns, at 50 Hz."""
    code = f"t0=x[0];\ndef _tf1(i1):\n  return {text}\nt1=_tf1(t0)\ny=t1"
    step = compile_periodic(code, [(YAW if angle else "data", 0.02)], 1, 0.02).step
    moments = [0.02 * number for number in range(640)]
    found = [step((math.remainder(time, math.tau),), time) for time in moments]
    return [each[0] for each in found if each is not None][100:]


@pytest.mark.parametrize("text", ["derivative(i1)", "-derivative(2-i1)", "derivative(i1+i1)/2"])
def test_an_angle_turns_by_the_shorter_way(text: str) -> None:
    found = turned(text)
    assert found == pytest.approx([1.0] * len(found))
    assert min(turned(text, angle=False)) < -100.0


def test_a_filtered_angle_lags_and_stays_within_a_turn() -> None:
    found = turned("lowpass(i1, 0.1)")
    for number, value in enumerate(found, 100):
        assert math.remainder(0.02 * number - value, math.tau) == pytest.approx(0.1, abs=0.02)
        assert abs(value) <= math.pi


def test_what_is_filtered_or_passed_through_a_relation_is_an_angle_still() -> None:
    found = turned("derivative(lowpass(i1, 0.1))")
    assert found == pytest.approx([1.0] * len(found), abs=1e-3)
    code = "t0=x[0];\ndef _tf1(i1): return i1 + 0.5\nt1=_tf1(t0)\n"
    code += "def _tf2(i1):\n  o = i1\n  return derivative(o)\nt2=_tf2(t1)\ny=t2"
    step = compile_periodic(code, [(YAW, 0.02)], 1, 0.02).step
    assert step((3.1,), 0.0) is None
    assert step((-3.1,), 0.1) == (pytest.approx((math.tau - 6.2) / 0.1),)


def test_a_substitute_knows_which_of_its_inputs_are_angles() -> None:
    text = "t0=x[0];\ndef _tf1(i1): return derivative(i1)\nt1=_tf1(t0)\ny=t1"
    heading = signal("/in", field=YAW, type="nav_msgs/Odometry")
    job = Job(row(code=text, inputs=(heading,)), 0.0)
    job.evaluate((3.1,), 0.0, (0.0,))
    job.evaluate((-3.1,), 0.1, (0.1,))
    assert job.latest == pytest.approx(((math.tau - 6.2) / 0.1,))
