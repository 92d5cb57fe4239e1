"""The form of messages: the frames that they name, and how long their arrays are."""
import io
from typing import Any

import pytest
from nav_msgs.msg import Odometry
from sensor_msgs.msg import Imu, JointState, LaserScan, PointCloud2, PointField
from std_msgs.msg import Float64, Float64MultiArray, Header

from shsa_core.ros.messages.fields import HEADER_END, Decoder, frame

HEADER = Header(frame_id="laser")
FRAME = ("header.frame_id", "laser")


def wired(message: Any) -> bytes:
    stream = io.BytesIO()
    message.serialize(stream)
    return stream.getvalue()


@pytest.mark.parametrize(
    "message, form",
    [
        (
            LaserScan(header=HEADER, ranges=[1.0] * 360),
            (FRAME, ("ranges", 360), ("intensities", 0)),
        ),
        (Odometry(header=HEADER, child_frame_id="base"), (FRAME, ("child_frame_id", "base"))),
        (
            JointState(HEADER, ["a", "bcd"], [1.0, 2.0], [], [3.0]),
            (FRAME, ("name", 2), ("position", 2), ("velocity", 0), ("effort", 1)),
        ),
        (
            PointCloud2(header=HEADER, fields=[PointField("x", 0, 7, 1)] * 3, data=bytes(90)),
            (FRAME, ("fields", 3), ("data", 90)),
        ),
        (Imu(header=HEADER), (FRAME,)),
        (Float64MultiArray(data=[1.0] * 4), (("data", 4),)),
        (Float64(1.0), ()),
    ],
)
def test_frames_and_lengths_are_read(message: Any, form: Any) -> None:
    kind = type(message)
    decoder = Decoder(kind._type, {"type": kind._type, "md5sum": kind._md5sum}, ())
    data = wired(message)
    decoder.values(data)
    assert decoder.form() == form
    if decoder.has_stamp:
        assert frame(data[:HEADER_END]) == (FRAME,)
        begin = len(data) - len(data[16 + len("laser") :])
        assert [frame(data[:end]) for end in range(begin)] == [()] * begin
