"""The start of the reconfigurator's shell, and how it reads its files anew."""
import threading
from argparse import Namespace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, List

import pytest

from shsa_core.errors import ModelError, ShsaError
from shsa_core.healing import events
from shsa_core.model.cost import Host
from shsa_core.model.som import Som
from shsa_core.ros import clock

reconfigurator = pytest.importorskip("shsa_core.ros.reconfigurator")

SOM = Som([], [Host("board"), Host("pi")])


def test_agents_that_the_master_cannot_tell_of_us_are_told() -> None:
    """And we of them, though the master waits for subscribers that hang."""
    told: List[str] = []
    heard: List[Any] = []
    node = SimpleNamespace(
        _files=Namespace(host="board"),
        _hosts=SimpleNamespace(listen=lambda *arguments: heard.extend(arguments)),
        _master=SimpleNamespace(introduce=lambda *topics: told.extend(topics)),
    )
    reconfigurator.ReconfiguratorNode._listen(node, SOM, True)
    assert heard == [["pi"], True]
    assert told == ["shsa/hosts/pi/commands", "shsa/hosts/pi/events"]


def test_what_check_calls_invalid_is_refused_at_the_start(tmp_path: Path) -> None:
    ontology, som = tmp_path / "ontology.yaml", tmp_path / "som.yaml"
    ontology.write_text("properties: {a: {unit: A}}\n")
    service = (
        "{topic: t, type: std_msgs/Float64, node: n, period: 0.1, provides: {b: {field: data}}}"
    )
    som.write_text("services:\n  s: " + service + "\n")
    with pytest.raises(ModelError, match=r"som.yaml:2: s provides 'b', which is not in the ontol"):
        reconfigurator.read_models(str(ontology), str(som))


class Reloading(reconfigurator.ReconfiguratorNode):  # type: ignore[name-defined,misc]
    """What the reconfigurator has to read its files anew; the master is `away`, and is awaited."""

    def __init__(self, folder: Path, monkeypatch: Any) -> None:
        self._files = Namespace(ontology="ontology.yaml", som=str(folder / "som.yaml"))
        self.added = Path(reconfigurator.added_path(self._files.som))
        self._added, self._reloading = 0.0, threading.Lock()
        self.told: List[Any] = []
        self.away = self.invalid = False
        self._master = SimpleNamespace(answers=True)  # as far as was looked
        note = lambda _: self.told.append("the master is awaited")
        self._put, self._usable = self.told.append, lambda som: som
        self._listen = self._hear_monitors = note
        self._may_act = lambda _: None
        self._som_watch = SimpleNamespace(replace=lambda _: None)
        self._commands: Any = SimpleNamespace(put=lambda call: call())
        monkeypatch.setattr(clock, "now", lambda: 1.0)
        monkeypatch.setattr(reconfigurator, "put_som", self.put_som)
        monkeypatch.setattr(reconfigurator, "read_models", self.read)
        self.said: List[str] = []
        for name in ("loginfo", "logerr", "logwarn_throttle"):
            monkeypatch.setattr(reconfigurator.rospy, name, partial(self.say, name))

    def say(self, level: str, *words: object) -> None:
        self.said.append(level)

    def put_som(self, som: Som) -> None:
        if self.away:
            raise ConnectionRefusedError("nobody listens")

    def read(self, *_: str) -> Any:
        if self.invalid:
            raise ModelError("som.yaml:1", "it is not valid")
        return SimpleNamespace(functions=()), SOM


@pytest.fixture(name="reloading")
def _reloading(tmp_path: Path, monkeypatch: Any) -> Reloading:
    return Reloading(tmp_path, monkeypatch)


def test_what_is_read_anew_counts_before_the_master_is_awaited(reloading: Reloading) -> None:
    reloading.away = True
    with pytest.raises(ShsaError, match="it counts, but is not shown at shsa/som: nobody listens"):
        reloading.reload()
    assert isinstance(reloading.told[0], events.SomChanged)
    assert not reloading._reloading.locked()


def test_what_is_added_while_the_master_is_away_is_read_again(reloading: Reloading) -> None:
    reloading.added.write_text("services: {}\n")
    reloading.away = True
    reloading._heed_added()
    reloading._master.answers = False
    reloading._heed_added()
    assert reloading.said == ["logwarn_throttle"], "all is planned anew each time"
    reloading.away, reloading._master.answers = False, True
    reloading._heed_added()
    reloading._heed_added()
    assert reloading.said == ["logwarn_throttle", "loginfo"]


def test_what_is_added_and_is_not_valid_is_refused_once(reloading: Reloading) -> None:
    reloading.added.write_text("services: 1\n")
    reloading.invalid = True
    reloading._heed_added()
    reloading._heed_added()
    assert reloading.said == ["logerr"]
    reloading.invalid = False
    reloading.added.unlink()
    reloading._heed_added()
    assert reloading.said == ["logerr", "loginfo"]


def test_a_reload_that_waits_is_not_begun_twice(reloading: Reloading) -> None:
    reloading.added.write_text("services: {}\n")
    with reloading._reloading:
        reloading._heed_added()
    assert reloading.said == []
