"""A recorded drive read back from a rosbag."""
from pathlib import Path
from typing import Any, Callable, Dict, Tuple

import numpy as np
import pytest
import rosbag
import rospy
from geometry_msgs.msg import AccelStamped, Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState, Imu
from shsa_msgs.msg import Float64Stamped

from shsa_core.errors import ShsaError
from shsa_rover.dataset import TOPICS, Dataset, simulate
from shsa_rover.drive import Drive
from shsa_rover.drive_bag import read_bag
from shsa_rover.fitting import fit_f1

TYPES: Dict[str, Callable[[], Any]] = {
    "/battery_current": Float64Stamped,
    "/battery_voltage": Float64Stamped,
    "/odom": Odometry,
    "/drivetrain/accel": AccelStamped,
    "/imu/data": Imu,
    "/battery_state": BatteryState,
    "/cmd_vel": Twist,
}


def write_bag(path: Path, data: Dataset, leave_out: Tuple[str, ...] = ()) -> None:
    """Writes the columns as messages, the true current too."""
    with rosbag.Bag(str(path), "w") as bag:
        for row, time in enumerate(data.time):
            stamp = rospy.Time.from_sec(1000.0 + float(time))
            for topic, names in TOPICS.items():
                if topic in leave_out:
                    continue
                message = TYPES[topic]()
                for name in names:
                    *path_to, last = name[len(topic) + 1 :].split("/")
                    target = message
                    for part in path_to:
                        target = getattr(target, part)
                    setattr(target, last, float(data.measured[name][row]))
                bag.write(topic, message, stamp)
            true = Float64Stamped(data=float(data.truth["battery_current"][row]))
            bag.write("/simulation/battery_current", true, stamp)


def test_a_recorded_drive_is_read_back_and_gives_the_same_f1(tmp_path: Path) -> None:
    data = simulate(Drive(), 30.0, 1)
    write_bag(tmp_path / "drive.bag", data)
    back = read_bag(str(tmp_path / "drive.bag"))
    assert back.time == pytest.approx(data.time, abs=1e-6)
    for name, column in data.measured.items():
        assert np.allclose(back.measured[name], column, atol=1e-6), name
    assert list(back.truth) == ["battery_current"]
    assert fit_f1([back]).coefficients == pytest.approx(dict(fit_f1([data]).coefficients), rel=1e-4)


def test_a_missing_topic_is_named(tmp_path: Path) -> None:
    write_bag(tmp_path / "drive.bag", simulate(Drive(), 3.0, 1), leave_out=("/odom", "/imu/data"))
    with pytest.raises(ShsaError, match="drive.bag: has no messages of /odom, /imu/data"):
        read_bag(str(tmp_path / "drive.bag"))


def test_a_short_drive_is_refused(tmp_path: Path) -> None:
    write_bag(tmp_path / "drive.bag", simulate(Drive(), 1.0, 1))
    with pytest.raises(ShsaError, match="drive for longer"):
        read_bag(str(tmp_path / "drive.bag"))


def test_a_file_that_is_no_bag_is_refused(tmp_path: Path) -> None:
    (tmp_path / "drive.bag").write_text("no bag", encoding="utf-8")
    with pytest.raises(ShsaError, match="cannot be read as a rosbag"):
        read_bag(str(tmp_path / "drive.bag"))
