"""Whose messages healing believes: those signed by its secret, for this topic, now, and once."""
import io
import threading
from pathlib import Path
from typing import Any, List

import pytest
import rospy
from hypothesis import given, strategies as st
from shsa_msgs.msg import Failure, Health, PublisherHealth, Substitutions

from shsa_core.ros.trust import places
from shsa_core.ros.trust.signing import SENDERS, Refusals, Signing
from shsa_core.trust.boots import Boot
from shsa_core.trust.seal import (
    AHEAD_NS,
    FOREIGN,
    REMEMBERED,
    TRAILER,
    TWICE,
    UNPROVEN,
    WRONG,
    Verifier,
    seal,
)

KEY = bytes(range(32))
BOOT = b"the boot of ours"
HOUR_NS = 3600 * 10**9


class Bench:
    """A sender and a reader on one clock."""

    def __init__(self) -> None:
        self.now = 10**15
        self.verifier = self.reader()

    def reader(self) -> Verifier:
        return Verifier(KEY, "/topic", {BOOT: Boot(BOOT)}.get, lambda: self.now)

    def message(self, text: bytes = b"text", key: bytes = KEY, topic: str = "/topic") -> bytes:
        self.now += 1000
        signed = text + BOOT + self.now.to_bytes(8, "little")
        return signed + seal(key, BOOT, topic, signed)


def test_what_is_signed_now_is_believed_once() -> None:
    bench = Bench()
    message = bench.message()
    assert bench.verifier.refusal(message) == ""
    assert bench.verifier.refusal(message) == TWICE
    bench.now += HOUR_NS
    assert bench.verifier.refusal(message) == "it was sent before, and is repeated"


@pytest.mark.parametrize(
    "changes",
    ({"key": bytes(32)}, {"topic": "/robot2/topic"}, {"topic": ""}),
)
def test_another_secret_or_another_topic_is_refused(changes: Any) -> None:
    bench = Bench()
    assert bench.verifier.refusal(bench.message(**changes)) == "its signature is wrong"


def test_what_was_sent_before_the_reader_began_is_not_meant_for_it() -> None:
    bench = Bench()
    old = bench.message()
    bench.now += HOUR_NS
    later = bench.reader()
    assert later.refusal(old) == "it was sent before, and is repeated"


def test_what_is_ahead_of_now_is_refused_and_stops_nothing_after_it() -> None:
    bench = Bench()
    bench.now += HOUR_NS
    ahead = bench.message()
    bench.now -= HOUR_NS
    assert bench.verifier.refusal(ahead) == "it is from the future"
    assert bench.verifier.refusal(bench.message()) == ""
    assert AHEAD_NS < HOUR_NS


def test_what_waited_long_is_believed_in_whatever_order_it_comes() -> None:
    bench = Bench()
    messages = [bench.message() for _ in range(50)]
    bench.now += HOUR_NS
    assert {bench.verifier.refusal(each) for each in reversed(messages)} == {""}


def test_no_more_is_remembered_than_is_bounded_and_nothing_is_believed_again() -> None:
    bench = Bench()
    messages = [bench.message() for _ in range(REMEMBERED + 100)]
    assert {bench.verifier.refusal(each) for each in messages} == {""}
    (sender,) = bench.verifier._senders.values()
    assert len(sender._known) == len(sender._order) == REMEMBERED
    bench.now += HOUR_NS
    assert "" not in {bench.verifier.refusal(each) for each in messages}


@given(cut=st.integers(0, 200), flip=st.integers(0, 8 * 200 - 1), junk=st.binary(max_size=100))
def test_whatever_was_changed_is_refused(cut: int, flip: int, junk: bytes) -> None:
    bench = Bench()
    message = bench.message(b"x" * 160)
    if cut:
        assert bench.verifier.refusal(message[:-cut])
        assert bench.verifier.refusal(message[cut:])
    flipped = bytearray(message)
    flipped[flip // 8] ^= 1 << flip % 8
    assert bench.verifier.refusal(bytes(flipped)).startswith(WRONG)
    assert bench.verifier.refusal(junk)
    assert bench.verifier.refusal(message) == ""


def test_of_threads_that_bring_the_same_one_alone_is_believed() -> None:
    bench = Bench()
    messages = [bench.message() for _ in range(200)]
    said: List[str] = []
    bring = lambda: said.extend([bench.verifier.refusal(each) for each in messages])
    threads = [threading.Thread(target=bring) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert said.count("") == 200 and said.count(TWICE) == 600


# As messages of ROS


@pytest.fixture(name="own")
def _own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Signing:
    monkeypatch.setattr(rospy, "resolve_name", lambda name: f"/{name}")
    return Signing(str(tmp_path / "shsa" / "secret"))


def sent(message: Any) -> bytes:
    """A message as it travels, behind others in the buffer."""
    buffer = io.BytesIO()
    buffer.write(b"before")
    message.serialize(buffer)
    return buffer.getvalue()[len(b"before") :]


def test_a_message_is_signed_as_it_is_sent_and_read_by_those_who_do_not_check(own: Signing) -> None:
    sign, checked = own.signer("failures", Failure), own.checked("failures", Failure)
    data = sent(sign(Failure(topic="/odom", publisher="/base", last_message=b"abc")))
    assert Failure().deserialize(data).publisher == "/base"
    read: Any = checked().deserialize(data)
    assert (read.refusal, read.topic, bytes(read.last_message)) == ("", "/odom", b"abc")
    assert read.sent > 0


def test_of_what_is_refused_nothing_is_decoded(own: Signing) -> None:
    checked = own.checked("failures", Failure)
    for data in (b"", b"\xff" * 30, b"\xff" * 300, sent(Failure(topic="/odom"))):
        read = checked().deserialize(data)
        assert read.refusal and read.topic == ""


def test_who_signs_nothing_is_believed_only_where_that_is_allowed(own: Signing) -> None:
    data = sent(Failure(topic="/odom"))
    read = own.checked("failures", Failure, unsigned=True)().deserialize(data)
    assert (read.refusal, read.topic, read.sent) == ("", "/odom", 0)
    forged = Failure(topic="/odom", sent=1, signature=b"\1" * 32)
    read = own.checked("failures", Failure, unsigned=True)().deserialize(sent(forged))
    assert read.refusal == FOREIGN


def test_another_boot_another_master_and_another_secret_are_others(
    own: Signing, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    data = sent(own.signer("failures", Failure)(Failure()))
    kernel: Any = {"time": "time:[2]", "net": "net:[2]"}.get
    rows = [
        ("boot", lambda: "another"),
        ("master_place", lambda: "localhost:11312"),
        ("_namespace", lambda name: kernel(name) if name == "time" else "net:[1]"),
        ("_namespace", lambda name: kernel(name) if name == "net" else "time:[1]"),
    ]
    for name, value in rows:
        with monkeypatch.context() as patch:
            patch.setattr(places, name, value)
            other = Signing(own.path)
        read: Any = other.checked("failures", Failure)().deserialize(data)
        assert read.refusal == UNPROVEN and read.topic == ""
    other = Signing(str(tmp_path / "shsa" / "other"))
    read = other.checked("failures", Failure)().deserialize(data)
    assert read.refusal == WRONG


@pytest.mark.parametrize("spelled", ("http://localhost:11311", "http://127.0.0.1:11311/"))
def test_a_master_may_be_spelled_otherwise(spelled: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", spelled)
    assert places.master_place() == "localhost:11311"


def test_whom_a_table_is_meant_for_is_signed(own: Signing) -> None:
    signed = own.signed("table", Substitutions)
    checked = own.checked("table", Substitutions)
    data = sent(signed(began=7, sequence=5, whole=True, to="/mine"))
    read: Any = checked().deserialize(data)
    assert (read.refusal, read.sequence, read.whole, read.to) == ("", 5, True, "/mine")
    other: Any = checked().deserialize(data.replace(b"/mine", b"/them"))
    assert other.refusal == WRONG and other.to == ""


def test_the_signature_is_the_end_of_every_signed_type() -> None:
    for kind in (Failure, Health, Substitutions):
        assert kind.__slots__[-3:] == ["boot", "sent", "signature"]
        data = sent(kind(boot=b"b" * 16, sent=3, signature=b"s" * 32))
        assert TRAILER.unpack(data[-TRAILER.size :]) == (b"b" * 16, 3, b"s" * 32)


def test_many_rows_of_a_stranger_cost_no_more_than_their_signature(own: Signing) -> None:
    rows = [PublisherHealth(topic=f"/t{i}", publisher=f"/n{i}") for i in range(20_000)]
    read: Any = own.checked("health", Health)().deserialize(sent(Health(publishers=rows)))
    assert read.refusal and read.publishers == []


def test_refusals_are_counted_and_said_once_each(monkeypatch: pytest.MonkeyPatch) -> None:
    said: List[str] = []
    monkeypatch.setattr(rospy, "logwarn", lambda text, *words: said.append(text % words))
    refusals = Refusals()
    for _ in range(1000):
        refusals.note("/failures", "/eve\n\x1b[31m", "it is not signed")
    assert refusals.counts() == [("/failures from /eve\\n\\x1b[31m: it is not signed", 1000)]
    assert len(said) == 1 and "\n" not in said[0] and "\x1b" not in said[0]
    for number in range(10 * SENDERS):
        refusals.note("/failures", f"/eve{number}", "it is not signed")
    assert len(refusals.counts()) == SENDERS + 1
    assert len(said) == SENDERS + 1
    assert sum(count for _, count in refusals.counts()) == 1000 + 10 * SENDERS
