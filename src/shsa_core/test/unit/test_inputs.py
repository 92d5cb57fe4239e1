"""Messages on a substitute's connections, and when its core is told."""
import io
import os
import socket
import subprocess
import sys
import time
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Dict, Iterator, List, Tuple
from unittest.mock import Mock

import pytest
import rospy
from plain_sockets import connected
from shsa_msgs.msg import Float64Stamped
from std_msgs.msg import Float64, String

from shsa_core.model.service import Signal
from shsa_core.monitoring.events import Disconnected
from shsa_core.ros.processes import priority
from shsa_core.ros.inputs import Inputs
from shsa_core.ros.rospy_patches.subscribing import HandedOver
from shsa_core.ros.sockets.connection import Connection
from shsa_core.ros.sockets.caller_ids import CallerIds
from shsa_core.ros.sockets.subscriptions import Subscriptions
from shsa_core.substitution.events import (
    Advertised,
    Event,
    InputArrived,
    OtherGone,
    OtherHeard,
    Overhear,
)
from shsa_testing.waiting import wait_until

SOURCE, ORIGINAL = "/source", "/original"
LARGE = 1 << 20
NOBODY = 65534
"""A user that is not root."""


class Time:
    """A robot's clock."""

    now = staticmethod(time.monotonic)


class Bench:
    """Connections to publishers, as rospy makes them, of nodes that the master knows."""

    def __init__(self) -> None:
        clock: Any = Time()
        self.inputs = Inputs(clock)
        self.subscriptions = self.inputs._subscriptions
        self.inbox = self.subscriptions.inbox
        self.ends: List[socket.socket] = []

    def listen(self, topic: str, kind: str = "std_msgs/Float64", field: str = "data") -> None:
        self.inputs.listen(Signal(topic, field, kind, "", None, None))

    def connect(self, topic: str, node: str, kind: Any = Float64, uri: str = "") -> socket.socket:
        """A connection to a publisher: its end."""
        there, here = connected()
        self.ends += [here, there]
        uri = uri or f"http://{node[1:]}:1/"
        header: Dict[str, str] = {"type": kind._type, "md5sum": kind._md5sum, "callerid": node}
        transport = SimpleNamespace(
            socket=here,
            callerid_pub=node,
            header=header,
            endpoint_id=uri,
            done=False,
            read_buff=io.BytesIO(),
            close=here.close,
        )
        made = partial(self.subscriptions._take_over, topic, transport)
        self.subscriptions._tell(topic, made)
        for _ in range(2):  # it is known by then
            self.take()
        return there

    def take(self, reads: bool = False) -> List[Event]:
        return self.inputs.take(reads)

    def is_woken(self, within: float = 5.0) -> bool:
        """Return whether the reader need not wait that long."""
        before = time.monotonic()
        self.inputs.wait(within)
        return time.monotonic() - before < within


def say(end: socket.socket, message: Any) -> None:
    """Publish a message."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    data = buffer.getvalue()
    end.sendall(len(data).to_bytes(4, "little") + data)


def values(events: List[Event]) -> List[Tuple[str, Any]]:
    """Return what the core was told, in short."""
    found: List[Tuple[str, Any]] = []
    for event in events:
        if isinstance(event, InputArrived):
            found.append((event.topic, dict(event.values).get("data")))
        else:
            found.append((type(event).__name__, getattr(event, "publisher", "")))
    return found


@pytest.fixture(name="bench")
def a_bench(monkeypatch: pytest.MonkeyPatch) -> Iterator[Bench]:
    def claim(self: CallerIds, connection: Connection) -> None:
        self._tries[connection] = 0
        self._tell(connection, connection.publisher, connection.uri)

    monkeypatch.setattr(CallerIds, "claim", claim)

    def subscribe(self: Subscriptions, topic: str) -> None:
        self.topics[topic] = HandedOver(topic, lambda _: None, lambda _: None)

    monkeypatch.setattr(Subscriptions, "subscribe", subscribe)
    rospy.rostime.set_rostime_initialized(True)
    made = Bench()
    yield made
    for each in made.ends:
        each.close()


def test_what_is_waited_for_is_told_at_once_and_all_of_it(bench: Bench) -> None:
    bench.listen("/in")
    bench.inputs.read(["/in"])
    end = bench.connect("/in", SOURCE)
    for value in (1.0, 2.0):
        say(end, Float64(value))
    assert bench.is_woken()
    assert values(bench.take()) == [("/in", 1.0), ("/in", 2.0)]


def test_else_the_newest_is_kept_until_it_is_read(bench: Bench) -> None:
    bench.listen("/in")
    bench.inputs.read(["/in"])
    end = bench.connect("/in", SOURCE)
    bench.inputs.hurry(False)
    bench.take()
    for value in (1.0, 2.0):
        say(end, Float64(value))
        assert not bench.is_woken(0.1)
        assert bench.take() == [], "nobody waits for these"
    (told,) = bench.take(reads=True)
    assert values([told]) == [("/in", 2.0)]
    assert isinstance(told, InputArrived) and 0.0 < told.waited < 5.0, "since the first one"
    assert bench.take(reads=True) == []


def test_what_nobody_waits_for_is_told_late_with_the_time_at_which_it_came(bench: Bench) -> None:
    bench.inputs.overhear(Overhear("/out", "std_msgs/Float64"))
    original = bench.connect("/out", ORIGINAL)
    bench.inputs.hurry(False)

    def is_noted() -> bool:
        say(original, Float64(0.0))
        time.sleep(0.05)
        (heard,) = bench.take()
        return heard.time < time.monotonic() - 0.02

    wait_until(is_noted, 10.0, "the kernel notes when something comes")
    said = []
    for value in (1.0, 2.0):
        said.append(time.monotonic())
        say(original, Float64(value))
    assert not bench.is_woken(0.2)
    heard = bench.take()
    assert values(heard) == 2 * [("OtherHeard", ORIGINAL)]
    assert said[0] < heard[0].time < said[1] + 0.1, "long before it was read"
    assert heard[-1].time < time.monotonic() - 0.1
    bench.inputs.put(Advertised(time.monotonic(), "/out"))
    assert bench.is_woken(), "a decision is not put off"


def test_what_calls_for_a_decision_brings_the_inputs_along_in_order(bench: Bench) -> None:
    bench.listen("/in")
    bench.inputs.read(["/in"])
    end = bench.connect("/in", SOURCE)
    bench.inputs.hurry(False)
    say(end, Float64(2.0))
    bench.take()
    bench.inputs.put(Advertised(time.monotonic(), "/out"))
    assert bench.is_woken()
    assert values(bench.take()) == [("/in", 2.0), ("Advertised", "")]


def test_what_is_only_prepared_for_wakes_nobody_and_is_there_once_it_is_read(bench: Bench) -> None:
    bench.listen("/plan")
    end = bench.connect("/plan", SOURCE)
    say(end, Float64(1.0))
    assert not bench.is_woken(0.1)
    assert bench.take(reads=True) == []
    bench.inputs.read(["/plan"])
    assert values(bench.take(reads=True)) == [("/plan", 1.0)]
    say(end, Float64(2.0))
    assert bench.is_woken(), "it is read from now on"
    assert values(bench.take()) == [("/plan", 2.0)]


def test_nobody_connects_to_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy, "get_node_uri", lambda: "http://here:1/")
    listener = HandedOver("/out", lambda _: None, lambda _: None)
    assert listener.has_connection("http://here:1/")
    assert not listener.has_connection("http://here:2/")


def test_others_on_a_topic_are_heard(bench: Bench) -> None:
    bench.inputs.overhear(Overhear("/out", "shsa_msgs/Float64Stamped"))
    original = bench.connect("/out", ORIGINAL, Float64Stamped)
    stamped = Float64Stamped(data=3.0)
    stamped.header.stamp = rospy.Time(7, 5)
    say(original, stamped)
    assert bench.is_woken()
    (heard,) = bench.take()
    assert isinstance(heard, OtherHeard)
    assert (heard.publisher, heard.stamp) == (ORIGINAL, 7 * 10**9 + 5)
    assert Float64Stamped().deserialize(bench.inputs.last("/out")) == stamped
    assert bench.inputs.last("/in") == b""
    assert bench.inputs.stands("/out", ORIGINAL)
    assert not bench.inputs.stands("/out", "/another")


def test_a_strangers_message_is_not_kept(bench: Bench) -> None:
    bench.inputs.overhear(Overhear("/out", "std_msgs/Float64", ORIGINAL))
    original, stranger = bench.connect("/out", ORIGINAL), bench.connect("/out", "/stranger")
    for who, value in ((original, 1.0), (stranger, 1000.0)):
        say(who, Float64(value))
        assert bench.is_woken()
        assert len(bench.take()) == 1
    assert Float64().deserialize(bench.inputs.last("/out")).data == 1.0


def test_a_stamp_in_the_future_counts_as_now(bench: Bench) -> None:
    bench.inputs.overhear(Overhear("/out", "shsa_msgs/Float64Stamped"))
    original = bench.connect("/out", ORIGINAL, Float64Stamped)
    stamped = Float64Stamped()
    stamped.header.stamp = rospy.Time(4_000_000_000)
    say(original, stamped)
    (heard,) = bench.take()
    assert isinstance(heard, OtherHeard) and 0 < heard.stamp < 4 * 10**18


def test_a_topic_may_be_read_and_overheard(bench: Bench) -> None:
    bench.listen("/out")
    end = bench.connect("/out", ORIGINAL)
    bench.inputs.overhear(Overhear("/out", "std_msgs/Float64"))
    bench.inputs.read(["/out"])
    say(end, Float64(1.0))
    assert values(bench.take()) == [("OtherHeard", ORIGINAL), ("/out", 1.0)]


def test_who_is_gone_is_told_after_its_last_message(bench: Bench) -> None:
    bench.inputs.overhear(Overhear("/out", "std_msgs/Float64"))
    with socket.create_server(("127.0.0.1", 0)) as listening:
        port = listening.getsockname()[1]
    uri = f"http://127.0.0.1:{port}/"
    end = bench.connect("/out", ORIGINAL, uri=uri)
    bench.inputs.hurry(False)
    bench.take()
    say(end, Float64(1.0))
    end.close()
    assert bench.is_woken(), "one that has ended wakes"
    told = [*bench.take(), *bench.take()]
    assert values(told) == [("OtherHeard", ORIGINAL), ("OtherGone", ORIGINAL)]
    assert not bench.inputs.stands("/out", ORIGINAL)


def test_of_who_is_gone_nothing_is_kept_for_later(bench: Bench) -> None:
    """Names of anonymous nodes are new each time."""
    for topic in ("/plan", "/in"):
        bench.listen(topic)
    bench.inputs.read(["/in"])
    bench.inputs.hurry(False)
    with socket.create_server(("127.0.0.1", 0)) as listening:
        uri = f"http://127.0.0.1:{listening.getsockname()[1]}/"
    for topic in ("/plan", "/in"):
        end = bench.connect(topic, f"/one_of{topic}", uri=uri)
        say(end, Float64(1.0))
        end.close()

        def is_gone() -> bool:
            bench.take()
            return not bench.inputs.stands(topic, f"/one_of{topic}")

        wait_until(is_gone, 10.0, "it is gone")
    bench.take()
    assert list(bench.inputs._newest) == [("/in", "/one_of/in")], "this is read soon"
    bench.inputs._newest["/plan", "/event"] = bench.inputs._newest["/in", "/one_of/in"]
    for certain in (False, True):  # who is cut off says an event no second time
        gone = Disconnected(5.0, "/plan", "/event", certain)
        setattr(bench.inputs._subscriptions, "read", Mock(return_value=[gone]))
        bench.take()
        assert (("/plan", "/event") in bench.inputs._newest) is not certain
    setattr(bench.inputs._subscriptions, "read", list)
    assert values(bench.take(reads=True)) == [("/in", 1.0)]


def test_who_only_closed_its_connection_is_not_gone(bench: Bench) -> None:
    bench.inputs.overhear(Overhear("/out", "std_msgs/Float64"))
    with socket.create_server(("127.0.0.1", 0)) as listening:
        uri = f"http://127.0.0.1:{listening.getsockname()[1]}/"
        end = bench.connect("/out", ORIGINAL, uri=uri)
        end.close()
        assert not any(isinstance(each, OtherGone) for each in bench.take())
        assert not bench.inputs.stands("/out", ORIGINAL)


def test_who_sends_large_messages_is_not_held_up(bench: Bench) -> None:
    bench.listen("/picture", "std_msgs/String")
    end = bench.connect("/picture", SOURCE, String)
    bench.inputs.hurry(False)
    bench.take()
    end.sendall((LARGE + 4).to_bytes(4, "little") + LARGE.to_bytes(4, "little") + b"x" * 60_000)
    assert not bench.inbox._waking.poll(0)
    bench.take()
    end.sendall(b"x")
    assert bench.inbox._waking.poll(1.0), "what follows of it wakes"


def test_another_type_is_not_heard_and_costs_nobody_anything(bench: Bench) -> None:
    bench.listen("/in")
    bench.inputs.overhear(Overhear("/out", "std_msgs/Float64"))
    bench.inputs.read(["/in"])
    wrong, right = bench.connect("/in", "/wrong", String), bench.connect("/in", SOURCE)
    other = bench.connect("/out", ORIGINAL, String)
    for end in (wrong, other):
        say(end, String("a text"))
    right.sendall((3).to_bytes(4, "little") + b"abc")  # no message of any type
    say(right, Float64(1.0))
    assert values(bench.take()) == [("/in", 1.0)]


def test_what_rospy_closes_is_forgotten(bench: Bench) -> None:
    bench.listen("/in")
    end = bench.connect("/in", SOURCE)
    (connection,) = bench.subscriptions._standing.values()
    closed = partial(bench.subscriptions._closed, "/in", connection.transport)
    bench.subscriptions._tell("/in", closed)
    connection.transport.socket.close()
    bench.take()
    assert not bench.subscriptions._standing
    bench.inputs.read(["/in"])
    assert bench.take() == []
    assert end.fileno() > 0


def test_a_process_that_stands_by_leaves_the_processor_to_others_until_it_matters() -> None:
    """In a process of its own, told by itself or by another: only root's can be raised again."""
    program = """
import os, subprocess, threading
from shsa_core.ros.processes.priority import HURRIES, STANDS_BY, USUAL, set_all
nice = lambda: os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
root = os.geteuid() == 0
others, asked, told = [], threading.Semaphore(0), threading.Semaphore(0)
def work():
    while asked.acquire():
        others.append(nice()); told.release()
threading.Thread(target=work, daemon=True).start()
for wanted in (STANDS_BY, HURRIES, USUAL, STANDS_BY, HURRIES):
    set_all(wanted)
    asked.release(); told.acquire()
    assert [nice(), others[-1]] == [wanted if root else 0] * 2, (wanted, nice(), others)
sleeper = subprocess.Popen(["sleep", "60"])
set_all(STANDS_BY, sleeper.pid)
found = os.getpriority(os.PRIO_PROCESS, sleeper.pid)
sleeper.kill(); sleeper.wait()
assert found == (STANDS_BY if root else 0), found
set_all(STANDS_BY, sleeper.pid)  # it has ended
print(root)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, check=True, timeout=60.0
    )
    assert done.stdout.strip() == str(os.geteuid() == 0)


@pytest.mark.skipif(
    not os.path.exists(priority.SESSION.format(os.getpid())), reason="this kernel has no autogroups"
)
@pytest.mark.parametrize("user", (os.geteuid(), NOBODY) if os.geteuid() == 0 else (os.geteuid(),))
def test_who_is_alone_in_a_session_lowers_that_whoever_its_user_is(user: int) -> None:
    """A kernel that was asked a moment ago is asked again, by whoever is not root."""
    program = """
def await_session(nice):
    end = time.monotonic() + 30.0
    while not open(SESSION.format("self")).read().endswith(f" nice {nice}\\n"):
        assert time.monotonic() < end
        time.sleep(0.01)
await_session(USUAL)
set_all(STANDS_BY)
await_session(STANDS_BY)
set_all(HURRIES)
await_session(HURRIES if _may_hurry() else USUAL)
set_all(STANDS_BY)
await_session(STANDS_BY)
print("done")
"""
    program = Path(priority.__file__).read_text() + program  # that user may not read our files
    done = subprocess.run(
        [sys.executable, "-c", program],
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        timeout=90.0,
        cwd="/",
        start_new_session=True,
        preexec_fn=lambda: os.setuid(user),
    )
    assert done.stdout.strip() == "done"


def test_where_no_thread_can_be_started_the_next_change_sets_the_priority(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """The kernel was asked a moment ago; a takeover must not fail for that."""
    session, pid = tmp_path / "autogroup", os.getpid()
    lacks = Mock(side_effect=RuntimeError("can't start new thread"))
    monkeypatch.setattr(priority, "SESSION", str(session))
    monkeypatch.setattr("threading.Thread.start", lacks)
    with monkeypatch.context() as moment:
        moment.setattr(priority, "_try", lambda _: False)
        priority._set_session(priority.STANDS_BY, pid)
    assert lacks.called
    priority._set_session(priority.HURRIES, pid)
    assert session.read_text() == f"{priority.HURRIES}\n"
    assert not priority._wanted
