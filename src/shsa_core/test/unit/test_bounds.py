"""How much is read of what a publisher announces: rospy's own connections, real sockets."""
from typing import Any, Iterator, List

import psutil
import pytest
from rospy.impl import tcpros_base
from rospy.impl.tcpros import get_tcpros_handler
from std_msgs.msg import String

from shsa_core.ros.rospy_patches.subscribing import subscribe
from shsa_core.ros.settings import LARGEST_HEADER_B
from shsa_testing.raw_publisher import RawPublisher
from shsa_testing.waiting import wait_until

LARGEST_B = 1000
FOUR_GB = 0xFFFFFFFF
NUMBERS = iter(range(1000))


@pytest.fixture
def heard(monkeypatch: Any) -> Iterator[List[str]]:
    monkeypatch.setattr(tcpros_base, "_use_tcp_keepalive", False)  # else the master is asked
    told: List[str] = []
    topic = f"/bounded_{next(NUMBERS)}"
    subscriber = subscribe(topic, String, lambda message: told.append(message.data), LARGEST_B)
    told.append(topic)
    yield told
    subscriber.unregister()


def connect(topic: str, publisher: RawPublisher) -> None:
    """As rospy does when it is told of a publisher."""
    protocol = publisher._request_topic("", topic, [])[2]
    code, why, _ = get_tcpros_handler().create_transport(topic, publisher.uri, protocol)
    assert code == 1, why


def test_what_is_within_bounds_is_heard(heard: List[str]) -> None:
    publisher = RawPublisher(heard[0], "/well", String("x" * 900))
    connect(heard[0], publisher)
    wait_until(lambda: len(heard) > 3, 10.0, "messages")
    assert set(heard[1:]) == {"x" * 900}
    publisher.close()


@pytest.mark.parametrize("size", (LARGEST_B + 1, 1 << 30, FOUR_GB))
def test_who_announces_too_much_is_cut_off_before_it_is_read(heard: List[str], size: int) -> None:
    before = psutil.Process().memory_info().rss
    publisher = RawPublisher(heard[0], "/greedy", String("x"))
    publisher.claim_length(size)
    connect(heard[0], publisher)
    wait_until(lambda: publisher.ended, 10.0, "the connection is closed")
    assert len(heard) == 1
    assert psutil.Process().memory_info().rss - before < 64 << 20
    publisher.close()


def test_a_header_that_does_not_end_is_given_up(heard: List[str]) -> None:
    publisher = RawPublisher(heard[0], "/greedy", String("x"))
    publisher.claim_header(FOUR_GB)
    connect(heard[0], publisher)
    wait_until(lambda: publisher.ended, 20.0, "the connection is closed")
    assert publisher.sent < 64 * LARGEST_HEADER_B
    publisher.close()
