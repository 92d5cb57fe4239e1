"""The form of messages is read from their bytes, whole or cut, and from any others without harm."""
import io
import random
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from nav_msgs.msg import Odometry, Path
from sensor_msgs.msg import Imu, JointState, LaserScan, PointCloud2, PointField
from std_msgs.msg import Float64, Header

from shsa_core.errors import ShsaError
from shsa_core.ros.messages.form import FORM_END, MOST_ELEMENTS, FormReader

HEADER = Header(frame_id="laser")
FRAME = ("header.frame_id", "laser")


def wired(message: Any) -> bytes:
    stream = io.BytesIO()
    message.serialize(stream)
    return stream.getvalue()


@pytest.mark.parametrize(
    "message, form",
    [
        (LaserScan(header=HEADER, ranges=[1.0] * 360), (FRAME, ("ranges", 360), ("intensities", 0))),
        (Odometry(header=HEADER, child_frame_id="base"), (FRAME, ("child_frame_id", "base"))),
        (
            JointState(HEADER, ["a", "bcd"], [1.0, 2.0], [], [3.0]),
            (FRAME, ("name", 2), ("position", 2), ("velocity", 0), ("effort", 1)),
        ),
        (
            PointCloud2(header=HEADER, fields=[PointField("x", 0, 7, 1)] * 3, data=bytes(90)),
            (FRAME, ("fields", 3), ("data", 90)),
        ),
        (Path(header=HEADER), (FRAME, ("poses", 0))),
        (Imu(header=HEADER), (FRAME,)),
        (DiagnosticArray(HEADER, [DiagnosticStatus()] * 3), (FRAME, ("status", 3))),
        (Float64(1.0), ()),
    ],
)
def test_frames_and_lengths_are_read(message: Any, form: Any) -> None:
    reader, data = FormReader(message._type), wired(message)
    assert reader(data) == form
    for end in range(len(data)):
        assert reader(data[:end]) == form[: len(reader(data[:end]))]


def test_the_first_bytes_tell_the_most_of_it() -> None:
    scan = wired(LaserScan(header=HEADER, ranges=[1.0] * 5000))
    assert FormReader("sensor_msgs/LaserScan")(scan[:FORM_END]) == (FRAME, ("ranges", 5000))


def test_what_lies_behind_a_long_list_is_not_looked_for() -> None:
    names = ["joint"] * (MOST_ELEMENTS + 1)
    joints = wired(JointState(HEADER, names, [0.0] * len(names), [], []))
    assert FormReader("sensor_msgs/JointState")(joints) == (FRAME, ("name", len(names)))


def test_other_bytes_do_no_harm() -> None:
    reader, chance = FormReader("sensor_msgs/JointState"), random.Random(1)
    for length in range(300):
        reader(bytes(chance.choice((0, 1, 255)) for _ in range(length)))


def test_a_type_that_is_not_built_here_is_refused() -> None:
    with pytest.raises(ShsaError, match="not known here"):
        FormReader("no_msgs/Nothing")
