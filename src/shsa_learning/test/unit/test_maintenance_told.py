"""`shsa maintenance` says that it is so only where a reconfigurator says it as well."""
import socket
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Iterator

import pytest
from diagnostic_msgs.msg import DiagnosticArray

from shsa_core.cli.main import main
from shsa_core.ros import diagnostics
from shsa_core.ros.succession import maintained
from shsa_learning.ros import maintenance


@pytest.fixture(autouse=True)
def nobody(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[str]:
    """Take a port at which nobody listens for the master's; return its URI."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        uri = f"http://127.0.0.1:{taken.getsockname()[1]}"
        monkeypatch.setenv("ROS_MASTER_URI", uri)
        yield uri


def test_nobody_heeds_it_where_no_master_answers(nobody: str, capsys: Any) -> None:
    assert main(["maintenance", "on"]) == 1 and maintained("/")
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.startswith(f"shsa: no ROS master answers at {nobody}: ")
    assert said.err.endswith("; maintenance is on once one starts\n")
    assert main(["maintenance"]) == 1
    assert main(["maintenance", "off"]) == 0 and not maintained("/")


@pytest.mark.parametrize("on, status", [(True, 0), (False, 1)])
def test_the_reconfigurator_has_the_last_word(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, on: bool, status: int
) -> None:
    monkeypatch.setattr(maintenance, "heeded", lambda namespace, wanted: on)
    assert main(["maintenance", "on"]) == status
    said = capsys.readouterr().out
    assert said.startswith("maintenance is on\n" if on else "maintenance is off as the ")


@pytest.mark.parametrize(
    "uri, told",
    [
        ("junk", "ROS_MASTER_URI is 'junk': it must be http://HOST:PORT"),
        ("http://none.invalid:11311", "ROS_MASTER_URI is http://none.invalid:11311, which is not"),
    ],
)
def test_an_address_that_can_be_nobodys_writes_no_file(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: Any, uri: str, told: str
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    assert main(["maintenance", "on"]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"shsa: {told}") and said.count("\n") == 1
    assert not list(tmp_path.rglob("*.maintenance"))


def test_the_reconfigurator_of_the_namespace_is_heard() -> None:
    known = SimpleNamespace(parts={})
    master = SimpleNamespace(answers=True, hung=(), known=known, kept_at=0.0)
    for on in (True, False):
        rows = diagnostics.healing_rows(((), {}, master, (), {}, on))  # type: ignore[arg-type]
        for row in rows:
            row.name = f"robot1/reconfigurator: {row.name}"
        for sender in ("/robot1/reconfigurator", "/robot1/monitor", "/reconfigurator"):
            message = DiagnosticArray(status=rows)
            message._connection_header = {"callerid": sender}
            told = maintenance.told(message, "/robot1/reconfigurator")
            assert told == ([on] if sender == "/robot1/reconfigurator" else [])
