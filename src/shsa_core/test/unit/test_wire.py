"""What messages from outside may say to the reconfigurator's core."""
import pytest
import rospy
from shsa_msgs.msg import Failure
from std_msgs.msg import Header

from shsa_core.ros.graph import clock
from shsa_core.ros.wire.healing import failure_seen


@pytest.mark.parametrize("ahead", (-5.0, 0.0, 3600.0))
def test_a_failure_has_happened_by_now_whatever_the_clock_of_its_sender_says(
    ahead: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    stamp = rospy.Time.from_sec(rospy.get_time() + ahead)
    seen = failure_seen(Failure(header=Header(stamp=stamp), topic="/odom", kind="silent"))
    assert seen.time <= clock.now()
    assert seen.time == pytest.approx(clock.now() + min(ahead, 0.0), abs=1.0)
