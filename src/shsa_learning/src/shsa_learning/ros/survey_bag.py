"""Surveys a recording: a rosbag, read with the message types that are built here."""
from typing import Any, List, Mapping

from shsa_learning.init.draft import UNKNOWN_NODE
from shsa_learning.init.survey import Publisher, Survey, Surveyor
from shsa_learning.recordings.bags import opened
from shsa_learning.ros.contents import Values


def survey_bag(path: str) -> Survey:
    """Survey a rosbag; times are those of recording, in s. Raises ModelError if it is none."""
    with opened(path) as bag:
        return _survey(bag)


def _survey(bag: Any) -> Survey:
    surveyor = Surveyor()
    values = Values(surveyor)

    def known(topic: str, kind: str, md5sum: str, _: str, header: Mapping[str, Any]) -> bool:
        publisher = Publisher(topic, kind, _node(header))
        return values.takes(publisher, md5sum) is not None

    times: List[float] = []
    for item in bag.read_messages(connection_filter=known, raw=True, return_connection_header=True):
        kind, data, md5sum = item.message[:3]
        publisher = Publisher(item.topic, kind, _node(item.connection_header))
        reader = values.takes(publisher, md5sum)
        if reader is None:
            continue
        time = item.timestamp.to_sec()
        times = [times[0] if times else time, time]
        latched = _text(item.connection_header.get("latching", "")) == "1"
        surveyor.heard(publisher, time, latched)
        values.read(publisher, reader, len(data), data)
    return surveyor.result(*(times or [0.0, 0.0]))


def _node(header: Mapping[str, Any]) -> str:
    return _text(header.get("callerid", "")) or UNKNOWN_NODE


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)
