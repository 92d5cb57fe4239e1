"""Consumers that connect to us: real sockets, each served by a thread of its own."""
import socket
from typing import Any, List, Tuple

import pytest
from test_inbound import WHOLE

from shsa_core.ros import settings
from shsa_core.ros.rospy_patches import inbound
from shsa_core.ros.trust.owners import speaker
from shsa_testing.waiting import wait_until


def connected() -> Tuple[socket.socket, socket.socket]:
    """Return both ends of a connection."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        theirs = socket.create_connection(server.getsockname())
        return server.accept()[0], theirs


def test_who_has_left_by_now_takes_no_place() -> None:
    """rospy would drop the connection that a subscriber made since, as its second one."""
    debts, served = inbound.Debts(), []  # type: Any, List[object]
    start = inbound._apart(lambda *_: served.append(_[1]), inbound.Room(debts, speaker))
    for leaves in (True, False):
        ours, theirs = connected()
        theirs.sendall(WHOLE)
        if leaves:
            theirs.close()
        inbound_ = inbound.Inbound(ours, "", debts)
        start(None, inbound_, "")
        wait_until(lambda: inbound_.fileno() < 0, 5.0, "it was given up, or handed on")
    assert len(served) == 1
    theirs.close()


def test_each_of_many_topics_has_room_for_consumers_elsewhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What stands by for many topics has a connection for each of their consumers."""
    monkeypatch.setattr(settings, "MOST_WAITING", 2)
    monkeypatch.setattr(settings, "CONSUMERS_A_TOPIC", 1)
    monkeypatch.setattr(inbound.get_topic_manager(), "pubs", dict.fromkeys("abc"))
    debts, served = inbound.Debts(), []  # type: Any, List[object]
    start = inbound._apart(lambda *_: served.append(_), inbound.Room(debts, speaker))
    ends = []
    for number in range(6):
        ours, theirs = connected()
        ends.append(theirs)
        theirs.sendall(WHOLE)
        start(None, inbound.Inbound(ours, "192.168.0.7", debts), "")
        wait_until(lambda: len(served) == number + 1, 5.0, "it is served")
    assert ends[0].recv(1) == b"", "the oldest has to go"
    ends[1].settimeout(0.05)
    with pytest.raises(socket.timeout):
        ends[1].recv(1)
    for each in ends:
        each.close()
