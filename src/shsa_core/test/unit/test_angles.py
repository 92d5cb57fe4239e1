"""Angles: a zero that may be any, and the turn that they make."""
from dataclasses import replace
from typing import Optional

import pytest
from shsa_core.model.error import Error
from shsa_core.substitution import events
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
