"""Parts of messages that are copied and judged, by what the service needs."""
import io
import struct
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Dict, List, Optional

import pytest
from monitor_bench import NODE, TOPIC, provision, service
from plain_sockets import connected
from sensor_msgs.msg import Image

from shsa_core.model.checks import Checks
from shsa_core.model.service import Service
from shsa_core.monitoring.events import Message
from shsa_core.ros.messages.fields import HEADER_END
from shsa_core.ros.reader import event_of
from shsa_core.ros.sockets.connection import Connection
from shsa_core.ros.sockets.subscriptions import Arrived

SECONDS = 1000
AT = 1000.5
JUDGED = service(provision(field="height", range=(0.0, 100.0)), type="sensor_msgs/Image")
UNJUDGED = replace(JUDGED, provides=(provision(field="height", range=None, checks=()),))


def picture(height: int, size: int = 1_000_000) -> bytes:
    stream = io.BytesIO()
    message = Image(height=height, data=bytes(size))
    message.header.stamp.secs = SECONDS
    message.serialize(stream)
    data = stream.getvalue()
    return struct.pack("<I", len(data)) + data


class Watched:
    """One connection to a camera, read for services that change."""

    def __init__(self) -> None:
        header = {"type": "sensor_msgs/Image", "md5sum": Image._md5sum}
        self.there, here = connected()
        transport: Any = SimpleNamespace(
            done=False,
            socket=here,
            callerid_pub=NODE,
            endpoint_id="",
            header=header,
            read_buff=io.BytesIO(),
        )
        self.connection = Connection(TOPIC, transport)
        self.copied = 0

    def hear(self, data: bytes, of: Optional[Service]) -> List[Message]:
        self.connection.frames.add(data)
        frames = self.connection.frames.take()
        self.copied = sum(len(frame.data) for frame in frames)
        came = [Arrived(AT, self.connection, *frame[:2], round(AT * 1e9)) for frame in frames]
        return [event_of(each, of) for each in came]


def test_values_that_somebody_judges_are_read_from_whole_messages() -> None:
    watched = Watched()
    for height in (1, 2):
        (message,) = watched.hear(picture(height), JUDGED)
        assert (message.values, message.error) == ((float(height),), "")


def test_of_what_nobody_judges_stamp_and_form_alone_are_looked_at() -> None:
    watched = Watched()
    ages = []
    for height in (1, 2, 3):
        (message,) = watched.hear(picture(height), UNJUDGED)
        assert (message.values, message.error) == (None, "")
        assert message.form == (("header.frame_id", ""),)
        ages.append(message.age)
    assert ages == [AT - SECONDS] * 3 and watched.copied == HEADER_END


def test_small_messages_are_kept_whole_for_a_substitute() -> None:
    watched = Watched()
    watched.hear(picture(1), UNJUDGED)
    watched.hear(picture(2, size=1000), UNJUDGED)
    assert watched.copied == len(picture(2, size=1000)) - 4


def test_a_message_of_which_a_part_was_dropped_is_not_judged_by_its_values() -> None:
    watched = Watched()
    watched.hear(picture(1), UNJUDGED)
    whole = picture(200)
    assert watched.hear(whole[:100_000], UNJUDGED) == []
    (cut,) = watched.hear(whole[100_000:], JUDGED)
    assert (cut.values, cut.error) == (None, "")
    (message,) = watched.hear(whole, JUDGED)
    assert message.values == (200.0,)


def test_what_is_judged_no_more_is_dropped_from_the_next_message_on() -> None:
    watched = Watched()
    watched.hear(picture(1), JUDGED)
    watched.hear(picture(2), UNJUDGED)
    watched.hear(picture(3), UNJUDGED)
    assert watched.copied == HEADER_END


def test_without_any_check_of_stamps_there_is_no_age() -> None:
    watched = Watched()
    unchecked = replace(UNJUDGED, checks=Checks(each=()))
    for _ in range(2):
        (message,) = watched.hear(picture(1), unchecked)
        assert (message.age, message.values) == (None, None)


OTHER_VERSION = {"type": "sensor_msgs/Image", "md5sum": "0" * 32}
OTHER_TYPE = {"type": "std_msgs/Float64", "md5sum": "0" * 32}


@pytest.mark.parametrize(
    "header, why", [(OTHER_TYPE, "std_msgs/Float64, and not sensor"), (OTHER_VERSION, "version")]
)
@pytest.mark.parametrize("of", [JUDGED, UNJUDGED, replace(UNJUDGED, checks=Checks(each=()))])
def test_who_sends_another_type_than_the_som_names_is_told_of(
    monkeypatch: pytest.MonkeyPatch, header: Dict[str, str], why: str, of: Service
) -> None:
    said: List[object] = []
    monkeypatch.setattr(Connection, "warn", lambda _, problem: said.append(problem))
    watched = Watched()
    watched.connection.header = header
    (message,) = watched.hear(picture(1, size=10), of)
    assert why in message.foreign and (message.values, message.error) == (None, "")
    assert why in str(*said)


def test_a_type_that_is_not_known_here_is_held_against_nobody(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Connection, "warn", lambda *_: None)
    watched = Watched()
    watched.connection.header = {"type": "nowhere_msgs/Thing", "md5sum": "0" * 32}
    (message,) = watched.hear(picture(1), replace(JUDGED, type="nowhere_msgs/Thing"))
    assert message.foreign == ""
    watched.connection.header = {"type": "*", "md5sum": "*"}
    (message,) = watched.hear(picture(1), JUDGED)
    assert message.foreign == ""
