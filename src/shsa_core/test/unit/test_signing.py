"""Signed messages between two computers, as ROS brings them."""
import io
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Callable, List

import pytest
import rospy
from shsa_msgs.msg import Failure

from shsa_core.ros import diagnostics
from shsa_core.ros.master.node_api import Answer
from shsa_core.ros.trust import places, signing
from shsa_core.ros.trust.signing import SENDERS, Signing
from shsa_core.trust.boots import Met
from shsa_core.trust.proof import Proof, written
from shsa_core.trust.seal import FOREIGN, TWICE

AWAIT_S = 20.0


class Pair:
    """A reader, and a sender on another computer."""

    def __init__(self, folder: Path, monkeypatch: pytest.MonkeyPatch, secrets: str) -> None:
        names = iter(secrets)
        monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
        monkeypatch.setattr(rospy, "is_shutdown", lambda: False)
        monkeypatch.setattr(signing, "subscribe", self.subscribe)
        with monkeypatch.context() as patch:
            patch.setattr(places, "boot", lambda: "another")
            self.theirs = Signing(str(folder / "shsa" / next(names)))
        self.ours = Signing(str(folder / "shsa" / next(names)))
        self.errors: List[str] = []
        monkeypatch.setattr(rospy, "logwarn", lambda *_: None)
        monkeypatch.setattr(rospy, "logerr", lambda text, *words: self.errors.append(text % words))
        self.answers, self.asked, self.lost = True, 0, 0
        self.heard: List[Failure] = []
        find = lambda node: f"http://pi:1{node}"[:11]
        monkeypatch.setattr(signing, "master_api", lambda: SimpleNamespace(lookupNode=find))
        monkeypatch.setattr(signing, "ask_timed", self.call)
        checked = self.ours.checked("failures", Failure)
        self.ours.subscribe("failures", checked, self.heard.append, self.lose)
        self.sign = self.theirs.signer("failures", Failure)

    def subscribe(
        self, topic: str, kind: Any, received: Callable[[Any], None], largest: int
    ) -> None:
        self.kind, self.received = kind, received

    def lose(self) -> None:
        self.lost += 1

    def call(self, uri: str, method: str, asked: str) -> Answer:
        self.asked += 1
        if not self.answers:
            raise ConnectionRefusedError
        now = time.monotonic_ns()
        told = Proof(self.theirs._boot, "pi", places.master_seen(), now, time.time_ns())
        return Answer(written(self.theirs._secret, asked, told), now, now)

    def send(self, data: bytes, sender: str = "/monitor") -> None:
        """Have a message come."""
        message = self.kind().deserialize(data)
        message._connection_header = {"callerid": sender}
        self.received(message)

    def message(self, topic: str) -> bytes:
        buffer = io.BytesIO()
        self.sign(Failure(topic=topic)).serialize(buffer)
        return buffer.getvalue()

    def refused(self) -> List[str]:
        return [text for text, _ in self.ours.refusals.counts()]


@pytest.fixture(name="pair")
def _pair(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, request: Any) -> Pair:
    return Pair(tmp_path, monkeypatch, getattr(request, "param", "aa"))


def test_the_first_message_of_another_computer_is_not_lost(pair: Pair) -> None:
    sent = [pair.message(f"/t{number}") for number in range(3)]
    for data in (*sent, *sent):
        pair.send(data)
    assert [each.topic for each in pair.heard] == ["/t0", "/t1", "/t2"]
    assert not pair.refused() and pair.lost == 0
    for each in pair.heard:
        assert abs(each.sent_here - time.monotonic_ns()) < AWAIT_S * 1e9
    (seen,) = pair.ours.boots.seen()
    assert seen.address == "pi" and abs(seen.ahead) < AWAIT_S * 1e9
    names = [thread.name for thread in threading.enumerate()]
    assert "clocks" in names


def test_one_computer_alone_asks_nobody(pair: Pair) -> None:
    before = threading.active_count()
    pair.sign = pair.ours.signer("failures", Failure)
    pair.send(pair.message("/odom"))
    assert len(pair.heard) == 1 and pair.asked == 0 and threading.active_count() == before
    assert pair.ours.boots.seen() == []


def test_what_may_have_been_right_is_told_as_lost(pair: Pair) -> None:
    pair.answers = False
    pair.send(pair.message("/odom"))
    assert pair.heard == [] and pair.lost == 1
    (why,) = pair.refused()
    assert why == "/failures from /monitor: its sender does not prove where it is: no answer"


@pytest.mark.parametrize("pair", ["ab"], indirect=True)
def test_whose_secret_differs_is_told_once_a_minute(pair: Pair) -> None:
    for _ in range(50):
        pair.send(pair.message("/odom"))
    assert pair.heard == [] and pair.lost == 0 and pair.asked == 1
    assert pair.refused() == [f"/failures from /monitor: {FOREIGN}"]
    (error,) = pair.errors
    assert error.startswith("/monitor on pi: its secret is another than ours")
    assert error.endswith(f"Ours is in {pair.ours.path}.")


@pytest.mark.parametrize("pair", ["ab"], indirect=True)
def test_who_does_not_answer_either_is_not_said_to_have_a_secret(pair: Pair) -> None:
    pair.answers = False
    for number in range(1000):
        pair.send(pair.message("/odom"), f"/stranger{number}")
    assert pair.errors == [] and pair.asked <= SENDERS + 1


def test_another_computer_has_a_row_with_its_clock() -> None:
    answered = time.monotonic_ns() - 7 * 10**9
    seen = Met(b"", "pi", "10.0.0.2", 0, -300 * 10**6, answered - 2 * 10**6, answered)
    row = diagnostics.computer_row(seen)
    assert (row.name, row.level) == ("computer pi at 10.0.0.2", diagnostics.WARN)
    assert row.message == "its clock is 0.3000 s behind, known within 0.0010 s"
    assert (
        diagnostics.computer_row(seen._replace(asked=answered - 400 * 10**6)).level
        == diagnostics.OK
    )


def test_the_same_by_two_connections_is_neither_counted_nor_said(pair: Pair) -> None:
    data = pair.message("/odom")
    pair.send(data)
    assert pair.kind().deserialize(data).refusal == TWICE
    pair.send(data)
    assert not pair.refused()
