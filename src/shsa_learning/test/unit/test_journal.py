"""The journal: what is recorded is replayed to the same decisions.

What hinders recording hinders nobody else.
"""
import errno
import json
import os
import stat
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Optional

import pytest

from shsa_testing import toy_machine as toy
from shsa_core.errors import ModelError
from shsa_core.journal import writer as writer_module
from shsa_core.journal.machines import MACHINES
from shsa_learning.replay import CUT, Journal, Step, replay
from shsa_core.journal.writer import WRITE_PERIOD_S, JournalWriter
from shsa_core.model.som import Som

SETUP = {"som": Som(), "step": 2.0}
EVENTS = [
    toy.Tick(10.0),
    toy.Added(11.0, 3.0, text="first"),
    toy.SomChanged(12.0, Som()),
    toy.Added(13.0, -1.0, points=(toy.Point(1.0),)),
]


@pytest.fixture
def path(tmp_path: Path) -> Path:
    return tmp_path / "toy.journal"


@pytest.fixture(autouse=True)
def adder(monkeypatch: Any) -> None:
    """Has the toy among the machines."""
    monkeypatch.setitem(MACHINES, "adder", "")
    for module in ("shsa_learning.replay", "shsa_core.journal.writer"):
        monkeypatch.setattr(f"{module}.machine_kind", lambda name: toy.ADDER)


@pytest.fixture
def warnings() -> List[str]:
    return []


Open = Callable[..., JournalWriter]


@pytest.fixture
def opened(path: Path, warnings: List[str]) -> Open:
    """Makes a writer of the path."""

    def make(setup: Optional[Dict[str, Any]] = None) -> JournalWriter:
        return JournalWriter(str(path), "adder", setup or SETUP, warnings.append)

    return make


def live(writer: JournalWriter, machine: toy.Adder, events: List[Any]) -> None:
    """Do what a node does with every event."""
    handle = writer.recorded(machine.handle)
    for event in events:
        with suppress(ValueError):
            handle(event)


def record(writer: JournalWriter, event: Any, *answer: Any) -> None:
    """Have a machine hear an event, to which it gives this answer."""
    writer.recorded(lambda _: answer)(event)


def recorded(opened: Open, events: List[Any]) -> None:
    writer = opened()
    live(writer, toy.Adder(**SETUP), events)  # type: ignore[arg-type]
    writer.close()


def steps(path: Path) -> List[Step]:
    return list(replay(Journal(str(path))))


def lines(path: Path) -> List[Dict[str, Any]]:
    return [json.loads(line) for line in path.read_text().splitlines()]


def rewrite(path: Path, change: Callable[[List[str]], List[str]]) -> None:
    path.write_text("".join(line + "\n" for line in change(path.read_text().splitlines())))


def test_what_was_recorded_replays_to_the_same_decisions(opened: Open, path: Path) -> None:
    recorded(opened, EVENTS)
    again = steps(path)
    assert [step.event for step in again] == EVENTS
    assert [len(step.commands) for step in again] == [0, 2, 1, 2]
    assert again[3].commands == (toy.Show(4.0), toy.Log("added -1 "))
    assert not any(step.differs or step.error or step.broken for step in again)
    assert all(step.then is not None and step.seconds >= 0.0 for step in again)


def test_a_journal_is_plain_lines(opened: Open, path: Path, warnings: List[str]) -> None:
    recorded(opened, EVENTS[:2])
    header, tick, added, answer, end = lines(path)
    assert (header["journal"], header["machine"]) == (1, "adder")
    assert header["setup"] == {"som": [[], [], True], "step": 2.0}
    assert tick == {"class": "Tick", "time": 10.0}
    assert (added["class"], added["number"], added["text"]) == ("Added", 3.0, "first")
    assert answer["answer"] == ["Show", "Log"] and len(answer["sha1"]) == 40
    assert end == {"end": "closed"}
    journal = Journal(str(path))
    assert journal.begun.startswith("20") and journal.setup == SETUP
    assert len(list(journal.entries())) == 2 and journal.end == "closed"
    assert warnings == []


def test_only_the_owner_can_read_it(opened: Open, path: Path) -> None:
    recorded(opened, [])
    assert stat.S_IMODE(os.stat(str(path)).st_mode) == 0o600


def test_another_answer_than_was_recorded_is_seen(opened: Open, path: Path) -> None:
    recorded(opened, EVENTS)
    rewrite(path, lambda all_: [line.replace('"step":2.0', '"step":2.5') for line in all_])
    differing = [step for step in steps(path) if step.differs]
    assert [step.where for step in differing] == [f"{path}:3", f"{path}:7"]
    first = differing[0]
    assert first.then is not None and first.then.names == first.now.names == ("Show", "Log")


def test_an_answer_where_there_was_none_is_seen(opened: Open, path: Path) -> None:
    recorded(opened, EVENTS)
    rewrite(path, lambda all_: [all_[0], *all_[2:3], *all_[4:]])  # the answer to the first Added
    assert [step.differs for step in steps(path)] == [True, False, False]


def test_an_error_is_replayed_and_what_follows_too(opened: Open, path: Path) -> None:
    recorded(opened, [toy.Added(1.0, 13.0), toy.Added(2.0, 1.0)])
    failed, after = steps(path)
    assert failed.error == "ValueError('13 is not added')" and not failed.differs
    assert after.commands == (toy.Show(2.0), toy.Log("added 1 ")) and not after.differs


def test_a_broken_invariant_is_named(opened: Open, path: Path) -> None:
    recorded(opened, [toy.Added(1.0, 50.0), toy.Added(2.0, 1.0)])
    sound, broken = steps(path)
    assert sound.broken == "" and broken.broken == "the sum 102 is above 100"


def test_the_former_journal_is_kept(opened: Open, path: Path) -> None:
    recorded(opened, EVENTS)
    former = path.read_text()
    recorded(opened, EVENTS[:1])
    assert Path(f"{path}.1").read_text() == former
    assert len(steps(path)) == 1
    recorded(opened, EVENTS[:2])
    assert len(steps(Path(f"{path}.1"))) == 1


def test_what_is_no_journal_is_left_alone(opened: Open, path: Path, warnings: List[str]) -> None:
    path.write_text("mine\n")
    writer = opened()
    live(writer, toy.Adder(Som()), EVENTS)
    writer.close()
    assert path.read_text() == "mine\n" and not Path(f"{path}.1").exists()
    assert len(warnings) == 1 and "no journal" in warnings[0] and str(path) in warnings[0]


def test_a_link_is_not_followed(opened: Open, path: Path, warnings: List[str]) -> None:
    target = path.parent / "target"
    path.symlink_to(target)
    opened().close()
    assert not target.exists() and len(warnings) == 1


def test_a_folder_that_is_not_there_hinders_nobody(tmp_path: Path, warnings: List[str]) -> None:
    writer = JournalWriter(str(tmp_path / "no/file"), "adder", SETUP, warnings.append)
    live(writer, toy.Adder(Som()), EVENTS)
    writer.close()
    assert not writer.recording and len(warnings) == 1 and "No such file" in warnings[0]


@pytest.mark.parametrize("setup", [{"som": Som(), "speed": 1.0}, {"som": Som(), "step": "fast"}])
def test_a_setup_that_cannot_be_written_hinders_nobody(
    opened: Open, path: Path, warnings: List[str], setup: Dict[str, Any]
) -> None:
    writer = opened(setup)
    assert not writer.recording and len(warnings) == 1 and not path.exists()
    record(writer, EVENTS[0])
    writer.close()


def test_an_event_that_cannot_be_written_ends_the_recording(
    opened: Open, path: Path, warnings: List[str]
) -> None:
    writer = opened()
    live(writer, toy.Adder(Som()), EVENTS[:2])
    record(writer, toy.Show(1.0))
    writer.close()
    record(writer, toy.Tick(1.0))
    assert not writer.recording and len(warnings) == 1 and "none of Added" in warnings[0]
    assert not writer._waiting


def test_the_limit_ends_the_recording_in_order(
    opened: Open, path: Path, warnings: List[str], monkeypatch: Any
) -> None:
    monkeypatch.setattr("shsa_core.journal.writer.LIMIT_BYTES", 10_000)
    writer = opened()
    machine = toy.Adder(Som(), 2.0)
    live(writer, machine, [toy.Added(float(n), 0.1) for n in range(1000)])
    writer.close()
    assert 4_000 < path.stat().st_size < 10_100
    assert lines(path)[-1] == {"end": "the limit of 10000 bytes is reached"}
    assert len(warnings) == 1 and "limit" in warnings[0]
    again = steps(path)
    assert len(again) > 20 and not any(step.differs for step in again)


def test_a_full_disk_ends_the_recording_and_what_is_there_can_be_replayed(
    opened: Open, path: Path, warnings: List[str], monkeypatch: Any
) -> None:
    writer = opened()
    really, room = os.write, [1000]

    def full(file: int, data: bytes) -> int:
        written = really(file, data[: room[0]])
        room[0] -= written
        if not written:
            raise OSError(errno.ENOSPC, "No space left on device")
        return written

    monkeypatch.setattr(writer_module.os, "write", full)
    live(writer, toy.Adder(Som(), 2.0), [toy.Added(float(n), 0.1) for n in range(100)])
    writer.close()
    assert len(warnings) == 1 and "No space left" in warnings[0]
    assert not path.read_text().endswith("\n")
    journal = Journal(str(path))
    again = list(replay(journal))
    assert again and not any(step.differs for step in again) and journal.end == CUT


def test_a_disk_that_is_full_just_at_the_end(
    opened: Open, path: Path, warnings: List[str], monkeypatch: Any
) -> None:
    def full(file: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    writer = opened()
    monkeypatch.setattr(writer_module.os, "write", full)
    writer.close()
    assert len(warnings) == 1 and "No space left" in warnings[0] and not writer.recording


def test_a_disk_that_is_too_slow_ends_the_recording(
    opened: Open, warnings: List[str], monkeypatch: Any
) -> None:
    monkeypatch.setattr(writer_module, "WAITING", 10)
    monkeypatch.setattr(writer_module, "WRITE_PERIOD_S", 60.0)
    writer = opened()
    live(writer, toy.Adder(Som()), EVENTS * 5)
    writer.close()
    assert len(warnings) == 1 and "too slow" in warnings[0]


def test_what_was_recorded_is_soon_in_the_file(opened: Open, path: Path) -> None:
    writer = opened()
    live(writer, toy.Adder(**SETUP), EVENTS)  # type: ignore[arg-type]
    deadline = time.monotonic() + 50 * WRITE_PERIOD_S
    while len(path.read_text().splitlines()) < 8 and time.monotonic() < deadline:
        time.sleep(0.01)
    journal = Journal(str(path))
    assert len(list(replay(journal))) == 4 and journal.end == CUT
    writer.close()


def test_the_answer_to_the_last_event_may_be_unknown(opened: Open, path: Path) -> None:
    recorded(opened, EVENTS)
    rewrite(
        path, lambda all_: all_[:-2]
    )  # neither the last answer nor the end: the process was killed
    again = steps(path)
    assert [step.then is None for step in again] == [False, False, False, True]
    assert not any(step.differs for step in again)


def test_closing_ends_the_thread_and_closes_the_file(opened: Open) -> None:
    before = threading.active_count(), len(os.listdir("/proc/self/fd"))
    writer = opened()
    writer.close()
    writer.close()
    assert (threading.active_count(), len(os.listdir("/proc/self/fd"))) == before
    record(writer, EVENTS[0], toy.Show(1.0))
    assert not writer._waiting


HEADER = '{"journal":1,"machine":"adder","setup":{"som":[[],[],true]}}'
TICK = '{"class":"Tick","time":1}'
BAD = [
    ("", 1, "is no journal"),
    ("[]\n", 1, "no JSON object"),
    ("nonsense\n", 1, "is not a line"),
    ("[" * 100_000 + "\n", 1, "is not a line"),
    ('{"journal":2}\n', 1, "is no journal of version 1"),
    ('{"journal":1,"machine":"adder"}\n', 1, "the setup must be an object"),
    ('{"journal":1,"machine":"adder","setup":{}}\n', 1, "lacks som"),
    ('{"journal":1,"machine":"adder","setup":{"som":[[],[],true],"x":1}}\n', 1, "has no 'x'"),
    (
        '{"journal":1,"machine":"adder","setup":{"som":[[],[],true],"step":"x"}}\n',
        1,
        "setup.step must be",
    ),
    (HEADER + "\n\xff\n", 2, "is not a line"),
    (HEADER + '\n{"class":"Tick","time":NaN}\n', 2, "NaN is not JSON"),
    (HEADER + '\n{"class":"Tock","time":1}\n', 2, "no class 'Tock'"),
    (HEADER + '\n{"answer":[],"sha1":""}\n', 2, "neither an event"),
    (f'{HEADER}\n{TICK}\n{{"answer":"Log","sha1":"x"}}\n', 3, "must be a list of names"),
    (f'{HEADER}\n{TICK}\n{{"answer":["Log"]}}\n', 3, "must have a sha1"),
    (f'{HEADER}\n{TICK}\n{{"answer":[],"sha1":""}}\n{{"answer":[],"sha1":""}}\n', 4, "neither"),
    (f"{HEADER}\n{TICK}\n{{}}\n", 3, "neither an event"),
    (f"{HEADER}\n{TICK}\n{HEADER}\n", 3, "neither an event"),
]


@pytest.mark.parametrize("text, line, told", BAD, ids=range(len(BAD)))
def test_a_bad_line_is_refused_with_its_place(path: Path, text: str, line: int, told: str) -> None:
    path.write_bytes(text.encode("latin-1"))
    with pytest.raises(ModelError) as refused:
        steps(path)
    where = str(refused.value)
    assert told in where and where.startswith(f"{path}:{line}: " if text else f"{path}: ")


def test_a_journal_names_a_machine_that_there_is(path: Path) -> None:
    path.write_text('{"journal":1,"machine":"os","setup":{}}\n')
    with pytest.raises(ModelError, match="there is no machine 'os': monitoring, healing"):
        Journal(str(path))


def test_a_setup_that_makes_no_machine_is_refused(path: Path, monkeypatch: Any) -> None:
    path.write_text(HEADER + "\n")
    monkeypatch.setattr(toy.ADDER, "make", lambda som: 1 / 0)
    with pytest.raises(ModelError, match="the setup makes no machine: ZeroDivisionError"):
        steps(path)


def test_a_line_has_a_limit(path: Path, monkeypatch: Any) -> None:
    path.write_text(HEADER + "\n")
    monkeypatch.setattr("shsa_learning.replay.MAX_LINE_BYTES", 20)
    with pytest.raises(ModelError, match="longer than 20 bytes"):
        Journal(str(path))


def test_a_pipe_keeps_nobody_waiting(path: Path) -> None:
    os.mkfifo(path)
    with pytest.raises(ModelError, match="it is a pipe"):
        Journal(str(path))


def test_a_file_that_is_not_there_is_told(path: Path) -> None:
    with pytest.raises(ModelError, match="cannot be read"):
        Journal(str(path))


def test_recording_costs_no_more_than_a_few_microseconds(opened: Open) -> None:
    writer = opened()
    count = 10_000
    begun = time.perf_counter()
    for _ in range(count):
        record(writer, EVENTS[0])
    cost = (time.perf_counter() - begun) / count
    writer.close()
    assert cost < 50e-6  # 1 us on an idle machine, which this one may not be
