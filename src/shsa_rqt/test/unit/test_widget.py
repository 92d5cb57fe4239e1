"""The plugin's widget beside the real server of the live view, which is fed with documents."""
import os
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from typing import Any, Callable, Dict, Iterator, List
from xml.etree import ElementTree

import pytest

PACKAGE = Path(__file__).resolve().parents[2]
sys.path.append(str(PACKAGE.parent / "shsa_view" / "test" / "browser"))
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
pytest.importorskip("python_qt_binding", reason="no python3-python-qt-binding on this system")

from python_qt_binding.QtWidgets import QApplication  # noqa: E402
from documents import HOSTILE, hostile, large, robot  # noqa: E402
from fed import Fed  # noqa: E402

from shsa_rqt.widget import Widget  # noqa: E402
from shsa_testing.waiting import wait_until  # noqa: E402

WAIT_S = 15.0


@pytest.fixture(scope="module")
def application() -> Any:
    return QApplication.instance() or QApplication([])


class Shown:
    """A widget that shows a served document."""

    def __init__(self, application: Any, whole: Dict[str, Any]) -> None:
        self._application = application
        self.fed = Fed(whole)
        self.widget = Widget()
        self.widget.open(self.fed.address)

    def wait(self, condition: Callable[[], bool]) -> None:
        """Let Qt work until a condition holds."""

        def works() -> bool:
            self._application.processEvents()
            return condition()

        wait_until(works, WAIT_S, "the widget shows it")

    def rows(self) -> List[List[str]]:
        """Return the texts of the table."""
        table = self.widget._table
        items = [table.topLevelItem(place) for place in range(table.topLevelItemCount())]
        return [[item.text(column) for column in range(table.columnCount())] for item in items]

    def select(self, place: int) -> str:
        """Select a row; return what is told of it."""
        table = self.widget._table
        table.setCurrentItem(table.topLevelItem(place))
        return str(self.widget._told.text())

    def close(self) -> None:
        """End widget and server."""
        self.widget.stop()
        self._application.processEvents()
        self.fed.close()


@pytest.fixture
def show(
    application: Any, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[[Dict[str, Any]], Shown]]:
    """Widgets that end with the test, in which nothing is raised: that would end rqt."""
    made: List[Shown] = []
    raised: List[BaseException] = []
    monkeypatch.setattr("sys.excepthook", lambda kind, error, trace: raised.append(error))

    def shown(whole: Dict[str, Any]) -> Shown:
        made.append(Shown(application, whole))
        return made[-1]

    yield shown
    for each in made:
        each.close()
    assert raised == []


def test_a_failure_is_shown_first_with_why_and_what_to_do(show: Any) -> None:
    shown = show(robot())
    shown.wait(lambda: len(shown.rows()) == 2)
    assert shown.widget._robot.text() == "All well. 2 services are watched."
    current = ["well", "amperemeter", "battery_current 3.214 ± 0.06 A", "/battery_current"]
    assert shown.rows()[0] == [*current, "50.0 Hz"]
    assert "Nothing is wrong with it." in shown.select(0)
    failed: Dict[str, Any] = {
        **shown.fed.state.whole["services"]["voltmeter"],
        **{"state": "not_healed", "why": "it is dead", "publisher": None, "rate": None},
        "remedies": [{"text": "Start it again:", "command": "rosrun shsa_rover voltmeter"}],
    }
    shown.fed.state.tell(services={"voltmeter": failed})
    shown.wait(lambda: shown.rows()[0][:2] == ["not healed", "voltmeter"])
    assert shown.widget._table.currentItem().text(1) == "amperemeter", "it stays selected"
    told = shown.select(0)
    assert "it is dead" in told and "Start it again: rosrun shsa_rover voltmeter" in told
    shown.fed.state.tell(services={"voltmeter": None})
    shown.wait(lambda: len(shown.rows()) == 1)


def test_a_view_that_ends_is_said_to_be_gone_and_found_again(show: Any) -> None:
    shown = show(robot())
    shown.wait(lambda: len(shown.rows()) == 2)
    port = shown.fed.port
    shown.fed.close()
    shown.wait(lambda: "Not connected: " in shown.widget._robot.text())
    assert not shown.widget._table.isEnabled(), "what it shows is not of now"
    shown.fed = Fed(large(3), port)
    shown.wait(lambda: [row[1] for row in shown.rows()] == [f"sensor_00{k}" for k in range(3)])
    assert shown.widget._table.isEnabled()


def test_a_silent_view_is_asked_again(show: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shsa_rqt.widget.SILENCE_MS", 1500)
    shown = show(robot())
    opened: List[int] = []
    shown.wait(lambda: bool(shown.rows()))
    shown.widget._network.finished.connect(lambda reply: opened.append(1))
    shown.wait(lambda: bool(opened) and shown.widget._table.isEnabled())


class Another(BaseHTTPRequestHandler):
    """Answers what is no document of a live view."""

    def do_GET(self) -> None:
        """Called by the server."""
        self.send_response(200)
        self.end_headers()
        self.wfile.write(b"event: state\ndata: {}\n\n")

    def log_message(self, format: str, *args: Any) -> None:
        """Called by the server."""


def test_what_is_no_live_view_is_said_to_be_none(show: Any) -> None:
    shown = show(robot())
    with HTTPServer(("127.0.0.1", 0), Another) as server:
        threading.Thread(target=server.handle_request, daemon=True).start()
        shown.widget.open(f"http://127.0.0.1:{server.server_address[1]}/")
        shown.wait(lambda: "No live view of this version" in shown.widget._robot.text())
    assert not shown.widget._table.isEnabled()


def test_markup_is_shown_as_text(show: Any) -> None:
    shown = show(hostile())
    shown.wait(lambda: len(shown.rows()) == 1)
    assert shown.rows()[0][1] == HOSTILE
    assert HOSTILE in shown.select(0)


def test_the_plugin_is_where_rqt_looks_for_it() -> None:
    package = ElementTree.parse(str(PACKAGE / "package.xml")).getroot()
    (export,) = package.findall("export/rqt_gui")
    assert export.get("plugin") == "${prefix}/plugin.xml"
    (told,) = ElementTree.parse(str(PACKAGE / "plugin.xml")).getroot().findall("class")
    module, _, name = str(told.get("type")).rpartition(".")
    source = PACKAGE / "src" / (module.replace(".", "/") + ".py")
    assert f"class {name}(Plugin)" in source.read_text("utf-8")
    assert "plugin.xml" in (PACKAGE / "CMakeLists.txt").read_text("utf-8")
