"""Which message of a table is taken on top of what was heard: in order, once, of one sender."""
from typing import Any, Callable, List, Tuple

import pytest
from shsa_msgs.msg import Health

from shsa_core.ros.graph import tables
from shsa_core.ros.graph.tables import TableSubscriber


class Trusting:
    """Signing of which everything is right."""

    def checked(self, topic: str, kind: Any) -> Any:
        return kind

    def subscribe(
        self, topic: str, kind: Any, heard: Callable[[Any], None], lost: Callable[[], None]
    ) -> None:
        """Nobody is connected."""


class Checked(Health):  # type: ignore[misc]
    """A message that is not refused."""

    sent_here = 0


class Bench:
    def __init__(self, signed: bool = True) -> None:
        self.heard: List[Tuple[int, int, bool]] = []
        signing: Any = Trusting() if signed else None
        self.subscriber = TableSubscriber("health", Health, self.note, signing)

    def note(self, message: Health) -> None:
        self.heard.append((message.began, message.sequence, message.whole))

    def send(self, began: int, sequence: int, whole: bool, sent: int = 0, ahead: int = 0) -> bool:
        """Whether a message is heard. `ahead`: how far its computer's clock is ahead of ours."""
        before = len(self.heard)
        boot = bytes([ahead % 256] * 16)
        message = Checked(began=began, sequence=sequence, whole=whole, sent=sent + ahead, boot=boot)
        message.sent_here = sent
        self.subscriber._received(message)
        return len(self.heard) > before

    @property
    def asks_again(self) -> bool:
        return self.subscriber._retry is not None


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(tables, "subscribe", lambda *_: None)
    monkeypatch.setattr(tables, "RESUBSCRIBE_PAUSE_S", 3600.0)


def test_the_whole_and_then_each_change_once() -> None:
    bench = Bench()
    assert not bench.send(1, 4, False, 10) and bench.asks_again
    assert bench.send(1, 5, True, 11)
    assert bench.send(1, 6, False, 12)
    assert bench.send(1, 7, False, 13)


def test_what_comes_by_a_second_connection_changes_nothing() -> None:
    bench = Bench()
    assert bench.send(1, 5, True, 10) and bench.send(1, 6, False, 11)
    assert not bench.send(1, 6, False, 11)
    assert bench.send(1, 6, True, 12), "who connects twice gets the whole twice"
    assert not bench.send(1, 6, False, 11)
    assert bench.send(1, 7, False, 13) and not bench.asks_again


def test_a_whole_that_was_kept_back_is_not_taken() -> None:
    """Somebody who had it sent to himself may bring it to others later."""
    bench = Bench()
    assert bench.send(1, 5, True, 10) and bench.send(1, 6, False, 12)
    assert not bench.send(1, 5, True, 11) and not bench.asks_again
    assert not bench.send(1, 9, False, 20) and bench.asks_again, "two were missed"
    assert not bench.send(1, 6, True, 13)
    assert bench.send(1, 9, True, 21)


def test_a_sender_that_was_started_again_replaces_the_former_one() -> None:
    bench = Bench()
    assert bench.send(100, 5, True, 110) and bench.send(100, 6, False, 120)
    assert bench.send(200, 0, True, 210) and bench.send(200, 1, False, 220)
    assert not bench.send(100, 7, False, 130) and not bench.asks_again


def test_of_two_senders_the_one_counts_that_still_sends() -> None:
    bench = Bench()
    assert bench.send(100, 5, True, 110)
    assert bench.send(200, 0, True, 210)
    assert not bench.send(100, 6, False, 220) and bench.asks_again
    assert bench.send(100, 6, True, 221) and bench.send(100, 7, False, 222)


def test_of_two_computers_the_table_counts_that_was_sent_last_by_our_clock() -> None:
    bench = Bench()
    assert bench.send(5, 3, True, 100, ahead=9999) and bench.send(5, 4, False, 110, ahead=9999)
    assert bench.send(7, 0, True, 120, ahead=0), "its clock alone is behind"
    assert not bench.send(5, 4, True, 115, ahead=9999), "it was kept back"
    assert bench.send(7, 1, False, 130, ahead=0)


def test_a_whole_that_may_have_been_right_is_asked_for_again() -> None:
    bench = Bench()
    bench.subscriber._lost()
    assert bench.asks_again
    bench = Bench()
    assert bench.send(1, 5, True, 10)
    bench.subscriber._lost()
    assert not bench.asks_again, "nothing is missing"


def test_for_show_whoever_sends_the_whole_is_believed_after_a_reboot_too() -> None:
    bench = Bench(signed=False)
    assert bench.send(10**15, 5, True) and bench.send(10**15, 6, False)
    assert not bench.send(10**15, 6, False) and not bench.asks_again
    assert bench.send(10**9, 0, True) and bench.send(10**9, 1, False)


def test_a_whole_that_is_asked_for_is_awaited_before_anything_else_counts() -> None:
    bench = Bench()
    assert bench.send(7, 1, whole=True, sent=1)
    bench.subscriber.ask_again()
    assert not bench.send(7, 2, whole=False, sent=2)
    assert bench.send(7, 2, whole=True, sent=3) and bench.send(7, 3, whole=False, sent=4)
