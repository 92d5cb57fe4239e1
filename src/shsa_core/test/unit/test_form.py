"""The form of messages: the frames that they name, and how long their arrays are."""
import io
from typing import Any, Sequence

import pytest
from geometry_msgs.msg import Pose, PoseArray
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState, LaserScan
from std_msgs.msg import Float64, Float64MultiArray, Header

from shsa_core.ros.messages.fields import HEADER_END, Decoder, frame

HEADER = Header(frame_id="laser")
FRAME = ("header.frame_id", "laser")


def wired(message: Any) -> bytes:
    stream = io.BytesIO()
    message.serialize(stream)
    return stream.getvalue()


JOINTS = JointState(HEADER, ["a", "bcd"], [1.0, 2.0], [], [3.0])
SCAN = LaserScan(header=HEADER, ranges=[1.0] * 360)
POSES = PoseArray(HEADER, [Pose()] * 3)


@pytest.mark.parametrize(
    "message, fields, form",
    [
        (SCAN, ("min(ranges[10:20])",), (FRAME, ("ranges", 360), ("intensities", 0))),
        (SCAN, ("scan_time",), (FRAME, ("ranges", 360), ("intensities", 0))),
        (SCAN, ("count(ranges)",), (FRAME, ("intensities", 0))),
        (Odometry(header=HEADER, child_frame_id="base"), (), (FRAME, ("child_frame_id", "base"))),
        (
            JOINTS,
            ("position[name=a]",),
            (FRAME, ("name", 2), ("position", 2), ("velocity", 0), ("effort", 1)),
        ),
        (POSES, ("poses[0].position.x",), (FRAME,)),
        (Imu(header=HEADER), ("orientation_covariance[0]",), (FRAME,)),
        (Float64MultiArray(data=[1.0] * 4), ("data[0]",), (("data", 4),)),
        (Float64(1.0), ("data",), ()),
    ],
)
def test_frames_and_lengths_are_read_unless_they_may_vary(
    message: Any, fields: Sequence[str], form: Any
) -> None:
    kind = type(message)
    decoder = Decoder(kind._type, {"type": kind._type, "md5sum": kind._md5sum}, fields)
    data = wired(message)
    decoder.values(data)
    assert decoder.form() == form
    if decoder.has_stamp:
        assert frame(data[:HEADER_END]) == (FRAME,)
        begin = len(data) - len(data[16 + len("laser") :])
        assert [frame(data[:end]) for end in range(begin)] == [()] * begin
