"""The inbox: items come in order, and wake the reader; so do sockets."""
import os
import select
import socket
import threading
import time
from typing import Any, List

import pytest

from shsa_core.ros.sockets.subscriptions import Inbox


def waited(inbox: Inbox, timeout: float) -> float:
    begin = time.monotonic()
    inbox.wait(timeout)
    return time.monotonic() - begin


def test_items_come_in_order() -> None:
    inbox = Inbox()
    for item in range(3):
        inbox.put(item)
    assert (inbox.take(), inbox.take()) == ([0, 1, 2], [])


def test_an_item_wakes_the_reader_until_it_has_looked() -> None:
    inbox = Inbox()
    threading.Timer(0.05, inbox.put, [1]).start()
    assert waited(inbox, 10.0) < 5.0
    assert inbox.ready() == set()
    assert inbox.take() == [1]
    assert waited(inbox, 0.02) >= 0.02


def test_who_looks_before_it_is_woken_is_woken_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The thread that puts an item may be held up before it wakes the reader."""
    inbox = Inbox()
    write = os.write

    def held_up(descriptor: int, data: bytes) -> int:
        assert inbox.take() == [1]
        return write(descriptor, data)

    monkeypatch.setattr(os, "write", held_up)
    inbox.put(1)
    monkeypatch.undo()
    assert inbox.take() == []
    assert waited(inbox, 0.02) >= 0.02


def test_a_readable_descriptor_wakes_the_reader_until_it_is_closed() -> None:
    inbox = Inbox()
    reader, writer = os.pipe()
    inbox.watch(reader)
    assert waited(inbox, 0.02) >= 0.02
    os.write(writer, b"?")
    assert waited(inbox, 10.0) < 5.0
    assert inbox.ready() == {reader}
    os.close(reader)
    assert waited(inbox, 0.02) >= 0.02
    os.close(writer)


def test_a_wait_is_not_rounded_to_milliseconds(monkeypatch: Any) -> None:
    inbox, waits = Inbox(), []

    def look(*arguments: Any) -> Any:
        waits.append(arguments[-1])
        return [], [], []

    monkeypatch.setattr(select, "select", look)
    inbox.wait(0.0002)
    inbox.wait(-1.0)
    assert waits == [0.0002, 0.0]


def test_who_rests_is_woken_by_a_connection_that_is_lost_alone() -> None:
    inbox = Inbox()
    here, there = socket.socketpair()
    inbox.watch(here.fileno())
    inbox.put(1)
    there.send(b"?")
    begin = time.monotonic()
    inbox.rest(0.05)
    assert time.monotonic() - begin >= 0.05
    there.close()
    inbox.rest(60.0)
    assert time.monotonic() - begin < 30.0
    here.close()
    begin = time.monotonic()
    inbox.rest(0.02)
    assert time.monotonic() - begin >= 0.02


def test_a_descriptor_that_does_not_wake_is_among_the_ready_ones_and_wakes_at_its_end() -> None:
    inbox = Inbox()
    here, there = socket.socketpair()
    inbox.watch(here.fileno())
    inbox.watch_otherwise(here.fileno(), False)
    there.send(b"?")
    assert waited(inbox, 0.02) >= 0.02
    assert inbox.ready() == {here.fileno()}
    inbox.watch_otherwise(here.fileno(), True)
    assert waited(inbox, 10.0) < 5.0
    assert inbox.ready() == {here.fileno()}
    inbox.watch_otherwise(here.fileno(), False)
    assert waited(inbox, 0.02) >= 0.02
    there.close()
    assert waited(inbox, 10.0) < 5.0
    here.close()


def test_nothing_is_lost_between_threads() -> None:
    inbox = Inbox()
    count, names = 5000, ("a", "b", "c")

    def work(name: str) -> None:
        for number in range(count):
            inbox.put((name, number))

    threads = [threading.Thread(target=work, args=(name,)) for name in names]
    for thread in threads:
        thread.start()
    got: List[Any] = []
    while len(got) < count * len(names):
        assert waited(inbox, 10.0) < 5.0
        inbox.ready()
        got.extend(inbox.take())
    for name in names:
        assert [number for who, number in got if who == name] == list(range(count))
