"""Messages from outside to the reconfigurator's core, and its own."""
import itertools
from dataclasses import replace
from math import isnan

import pytest
import rospy
from shsa_msgs.msg import Failure, Health, PublisherHealth, Substitutions
from std_msgs.msg import Header

from shsa_core.healing.incident import Incident
from shsa_core.model import health
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.ros import clock
from shsa_core.ros.wire import healing as wire
from shsa_core.ros.wire.healing import failure_message, failure_seen
from shsa_core.ros.wire.rows import substitution_message


@pytest.mark.parametrize("slow", range(1, 9))
def test_a_thread_that_waits_between_two_looks_at_the_clocks_moves_no_stamp(
    slow: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    looks, passed = itertools.count(1), [0.0]

    def look(begin: float) -> float:
        passed[0] += 0.05 if next(looks) == slow else 1e-5
        return begin + passed[0]

    monkeypatch.setattr(clock, "now", lambda: look(100.0))
    monkeypatch.setattr(clock, "ros_ns", lambda: int(look(5000.0) * 1e9))
    monkeypatch.setattr(rospy, "get_time", lambda: look(5000.0))
    assert clock.to_stamp(101.0).to_sec() == pytest.approx(5001.0, abs=1e-3)


@pytest.mark.parametrize("ahead", (-5.0, 0.0, 3600.0))
def test_a_failure_has_happened_by_now_whatever_the_clock_of_its_sender_says(
    ahead: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    stamp = rospy.Time.from_sec(rospy.get_time() + ahead)
    seen = failure_seen(Failure(header=Header(stamp=stamp), topic="/odom", kind="silent"))
    assert seen.time <= clock.now()
    assert seen.time == pytest.approx(clock.now() + min(ahead, 0.0), abs=1.0)


def test_the_moments_of_an_incident_keep_their_order(monkeypatch: pytest.MonkeyPatch) -> None:
    """Between looks at the two clocks a thread may have to wait."""
    waits = itertools.cycle((0.0, 0.003, 0.001))
    monkeypatch.setattr(clock, "now", lambda: 100.0 + next(waits))
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    monkeypatch.setattr(rospy, "get_time", lambda: 5000.0)
    incident = Incident(1, "odom", "/odom", ("v",), "/base", Kind.SILENT, "x", detected=1.0)
    message = wire.incident(replace(incident, killed=1.0, found=1.0, spawned=1.001))
    assert message.detected == message.killed == message.found < message.spawned
    assert message.ended.is_zero()
    assert (message.error_rms, message.error_p95) == ([], [])
    told = replace(incident, errors=(Error(0.5, p95=0.9), None))
    message = wire.incident(told)
    assert (message.error_rms[0], message.error_p95[0]) == (0.5, 0.9)
    assert isnan(message.error_rms[1]) and isnan(message.error_p95[1])


def test_nothing_that_is_told_lies_ahead_of_now(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    far = rospy.Time(3_976_214_400)  # in the year 2096
    row = PublisherHealth("/odom", "/base", "healthy", "", "", far, far, far, "", b"", "")
    (seen,) = wire.health_seen(Health(publishers=[row])).rows
    moments = [seen.since, seen.first_message, seen.last_good]
    failure = failure_seen(
        Failure(header=Header(stamp=far), topic="/odom", kind="silent", last_good=far)
    )
    for moment in (*moments, failure.time, failure.last_good):
        assert moment is not None and moment <= clock.now()


class SignedFailure(Failure):  # type: ignore[misc]
    """A failure as the signing layer hands it on."""

    sent_here = 0


class SignedHealth(Health):  # type: ignore[misc]
    """A table of health as the signing layer hands it on."""

    sent_here = 0


@pytest.mark.parametrize("ahead", (-60.0, 0.0, 60.0))
def test_the_wall_clock_of_another_computer_does_not_count(
    ahead: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ages in a message, of 3, 2 and 1 s, hold by our clock too."""
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    sent = clock.now() - 0.5
    theirs = rospy.get_time() + ahead
    told, once, later, last = (rospy.Time.from_sec(theirs - ago) for ago in (0.0, 3.0, 2.0, 1.0))
    health = SignedHealth(
        header=Header(stamp=told),
        publishers=[
            PublisherHealth("/odom", "/base", "healthy", "", "", once, later, last, "", b"", "")
        ],
    )
    health.sent_here = int(sent * 1e9)
    (row,) = wire.health_seen(health).rows
    moments = row.since, row.first_message, row.last_good
    assert moments == pytest.approx((sent - 3.0, sent - 2.0, sent - 1.0), abs=1e-3)

    failure = SignedFailure(
        header=Header(stamp=later), topic="/odom", kind="silent", told=told, last_good=once
    )
    failure.sent_here = int(sent * 1e9)
    seen = failure_seen(failure)
    assert (seen.time, seen.last_good) == pytest.approx((sent - 2.0, sent - 3.0), abs=1e-3)
    failure.told = rospy.Time()  # as somebody's own monitor: sent as soon as it was detected
    seen = failure_seen(failure)
    assert (seen.time, seen.last_good) == pytest.approx((sent, sent - 1.0), abs=1e-3)


def test_a_failure_says_when_it_was_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """A monitor tells whoever comes later of what it has seen before."""
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    before = clock.now() - 100.0
    state = health.PublisherState.FAILED
    row = health.PublisherHealth("/odom", "/base", state, before, kind=Kind.SILENT, detail="x")
    message = failure_message(replace(row, last_message=b"good"))
    assert message.last_message == b"good"
    assert (message.told - message.header.stamp).to_sec() == pytest.approx(100.0, abs=1.0)


def test_the_monitor_need_not_hear_by_how_much_a_substitute_may_err() -> None:
    signal = Signal("/a", "data", "std_msgs/Float64", "/a_node", 0.02, 0.25, error=Error(0.5))
    row = Substitution("/substitute_a_1", "a", (), "y=0.0", (signal,), publishing=True)
    table = Substitutions(substitutions=[substitution_message(row)], whole=True)
    (seen,) = wire.substitutions_changed(table).rows
    assert seen.outputs[0].error is None and seen.publishing
