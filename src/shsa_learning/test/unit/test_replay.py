"""`shsa replay`: what it prints and returns."""
import json
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple

import pytest

from shsa_testing import toy_machine as toy
from shsa_learning import replay
from shsa_learning.cli.replay import in_short
from shsa_core.cli.main import main
from shsa_core.journal import machines, writer
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som

EVENTS: List[toy.Event] = [
    toy.Tick(100.0),
    toy.Added(101.0, 3.0, text="/odom"),
    toy.Added(102.5, 4.0, text="/imu"),
]
Shsa = Callable[..., Tuple[int, str, str]]


@pytest.fixture(autouse=True)
def registered(monkeypatch: Any) -> None:
    """The toy is one of the machines."""
    monkeypatch.setitem(machines.MACHINES, "adder", "adder.machine.Adder")
    for module in (replay, writer):
        monkeypatch.setattr(module, "machine_kind", lambda name: toy.ADDER)


@pytest.fixture
def shsa(capsys: Any) -> Shsa:
    """Runs a command; returns its exit status, its output and its errors."""

    def run(*arguments: str) -> Tuple[int, str, str]:
        status = main(list(arguments))
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    path = tmp_path / "toy.journal"
    record(path, *EVENTS)
    return path


def record(path: Path, *events: toy.Event) -> None:
    setup: Dict[str, Any] = {"som": Som()}
    journal = writer.JournalWriter(str(path), "adder", setup, print)
    machine = toy.Adder(**setup)
    handle = journal.recorded(machine.handle)
    for event in events:
        with suppress(ValueError):
            handle(event)
    journal.close()


def spoil(path: Path, old: str, new: str) -> None:
    path.write_text(path.read_text().replace(old, new))


def test_it_prints_decision_by_decision(shsa: Shsa, journal: Path) -> None:
    status, out, _ = shsa("replay", str(journal))
    lines = out.splitlines()
    assert status == 0
    assert lines[0].startswith("adder, recorded from 20")
    assert lines[1].startswith("     1.000 s  Added number=3 /odom  [") and lines[1].endswith(
        " us]"
    )
    assert lines[2:4] == [f"{'':14}-> Show total=3", f"{'':14}-> Log added 3 /odom"]
    assert lines[4].startswith("     2.500 s  Added number=4 /imu  [")
    assert lines[7:9] == ["end: closed", "3 events, 2 decisions"]
    assert lines[9].startswith("median ") and " us, slowest " in lines[9]
    assert lines[10:] == ["identical to the recording"]


def test_all_prints_events_without_an_answer_too(shsa: Shsa, journal: Path) -> None:
    assert "     0.000 s  Tick  [" in shsa("replay", str(journal), "--all")[1]


@pytest.mark.parametrize(
    "options, printed",
    [
        (["--from", "2"], ["/imu"]),
        (["--until", "1"], ["/odom"]),
        (["--from", "1.5", "--until", "2"], []),
        (["--only", "/odom"], ["/odom"]),
        (["--only", "/od"], []),
    ],
)
def test_a_part_is_printed_and_everything_is_replayed(
    shsa: Shsa, journal: Path, options: Any, printed: Any
) -> None:
    status, out, _ = shsa("replay", str(journal), *options)
    assert status == 0 and "3 events, 2 decisions" in out
    assert [topic for topic in ("/odom", "/imu") if topic in out] == printed


def test_a_name_that_nothing_has_is_told(shsa: Shsa, journal: Path) -> None:
    told = "no decision that is asked for names "
    assert f"{told}/nothere\n" in shsa("replay", str(journal), "--only", "/nothere")[1]
    assert told not in shsa("replay", str(journal), "--only", "/odom")[1]


def test_a_document_for_programs(shsa: Shsa, journal: Path) -> None:
    status, out, _ = shsa("replay", str(journal), "--json", "--only", "/imu")
    document = json.loads(out)
    assert status == 0 and (document["machine"], document["end"]) == ("adder", "closed")
    (decision,) = document["decisions"]
    assert decision["time"] == 2.5 and decision["event"]["text"] == "/imu"
    assert decision["commands"][0] == {"class": "Show", "total": 7.0}
    assert decision["recorded"] == ["Show", "Log"] and not decision["differs"]
    summary = document["summary"]
    assert (summary["events"], summary["decisions"], summary["identical"]) == (3, 2, True)
    assert 0.0 <= summary["median_seconds"] <= summary["slowest_seconds"] < 1.0


def test_another_decision_than_was_recorded(shsa: Shsa, journal: Path) -> None:
    spoil(journal, '"number":3.0', '"number":5.0')
    status, out, _ = shsa("replay", str(journal))
    assert status == 1 and "identical" not in out
    assert f"{'':14}!! recorded: Show, Log, with other contents" in out
    assert f"2 decisions differ from the recording, first that of {journal}:3" in out
    status, out, _ = shsa("replay", str(journal), "--json")
    summary = json.loads(out)["summary"]
    assert status == 1 and summary["first_difference"] == f"{journal}:3"


def test_other_commands_than_were_recorded(shsa: Shsa, journal: Path) -> None:
    spoil(journal, '["Show","Log"]', '["Show"]')
    status, out, _ = shsa("replay", str(journal))
    assert status == 1 and "!! recorded: Show\n" in out


def test_an_error_and_a_broken_invariant(shsa: Shsa, tmp_path: Path) -> None:
    path = tmp_path / "toy.journal"
    record(path, toy.Added(1.0, 13.0))
    status, out, _ = shsa("replay", str(path))
    assert status == 1 and "!! raises ValueError('13 is not added')" in out
    assert "1 decisions raise an error" in out
    record(path, toy.Added(1.0, 101.0))
    status, out, _ = shsa("replay", str(path))
    assert status == 1 and "!! broken: the sum 101 is above 100" in out


def test_an_answer_that_is_not_in_the_journal(shsa: Shsa, journal: Path) -> None:
    journal.write_text("".join(line + "\n" for line in journal.read_text().splitlines()[:-2]))
    status, out, _ = shsa("replay", str(journal))
    assert status == 0 and "the answer to the last event is not in the journal" in out
    assert "end: the recording stops without an end" in out


def test_a_journal_of_nothing(shsa: Shsa, tmp_path: Path) -> None:
    path = tmp_path / "toy.journal"
    record(path)
    status, out, _ = shsa("replay", str(path))
    assert status == 0 and "0 events, 0 decisions" in out
    assert shsa("replay", str(path), "--json")[0] == 0


def test_a_bad_file(shsa: Shsa, journal: Path) -> None:
    spoil(journal, '"class":"Tick"', '"class":"System"')
    status, _, err = shsa("replay", str(journal))
    assert status == 2 and f"{journal}:2: the event: there is no class 'System'" in err
    assert shsa("replay", str(journal) + "x")[0] == 2


def test_short_lines() -> None:
    points = tuple(toy.Point(float(n), 0.5) for n in range(5))
    event = toy.Added(1.0, 1 / 3, toy.Point(2.0), points, ("a", True), toy.Colour.BLUE, True)
    assert in_short(event) == (
        "Added number=0.333333 (x=2) points=[(x=0 y=0.5), (x=1 y=0.5), (x=2 y=0.5), +2] "
        "key=[a, True] 2 either"
    )
    assert in_short(toy.Added(1.0, either=False)) == "Added not either"
    assert in_short(toy.Log("two\n lines " + 100 * "x")).startswith("Log two lines xxx")
    assert len(in_short(toy.Added(1.0, text=200 * "y"))) < 110
    assert in_short(toy.SomChanged(1.0, Som())) == "SomChanged Som of 0"


def test_what_an_object_makes_of_its_fields_is_left_out() -> None:
    service = Service("a", "/a", "std_msgs/Float64", "/node", None, (Provision("p", "data"),))
    assert in_short(service) == "Service a /a std_msgs/Float64 /node provides=[(p data)]"
