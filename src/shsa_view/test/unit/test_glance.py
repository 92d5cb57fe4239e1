"""The robot at a glance: lines of text, and the terminal that shows them."""
import os
import pty
import re
import select
import sys
import time
from pathlib import Path
from typing import Any, Dict, List, Optional

import pytest

from shsa_view.glance import Look, Sort, glance, lines, value
from shsa_view.judgement import Condition
from shsa_view.state import State
from shsa_view.terminal import Screen, keys

WELL, HEALED, LOST = "well", "substituted", "not_healed"


def prop(value_: Optional[float], p95: Optional[float] = None, unit: str = "") -> Dict[str, Any]:
    return {"value": value_, "error_rms": None, "error_p95": p95, "unit": unit}


def row(state: str, publisher: Optional[str], rate: Optional[float], **props: Any) -> Any:
    return {
        "state": state,
        "publisher": publisher,
        "rate": rate,
        "needed": True,
        "incident_key": "k1" if state == HEALED else None,
        "properties": props,
    }


def document(**services: Any) -> Dict[str, Any]:
    """Return a document of some services; those of a robot by default."""
    found = State().document(100.0)
    found["robot"] = {"state": HEALED, "text": "amps has a substitute."}
    found["healing"] = {"monitor": "alive", "reconfigurator": "alive", "master": "", "text": ""}
    found["trust"] = {"state": "checked", "text": ""}
    found["services"] = services or {
        "amps": row(HEALED, "/substitute_1", 49.9, current=prop(3.21, 0.4, "A")),
        "odom": row(WELL, "/base", 50.0, v=prop(0.5, 0.02, "m/s"), w=prop(None)),
        "volts": row(LOST, None, None, voltage=prop(None)),
    }
    incident: Dict[str, Any] = {
        "key": "k1",
        "id": 3,
        "service": "amps",
        "kind": "silent",
        "state": "healed",
    }
    incident.update(moments={"detected": 88.0}, substitute="/substitute_1", missing=[])
    found["incidents"] = [incident, {**incident, "key": "k0", "id": 2}]
    return found


def test_a_robot_is_told_in_full() -> None:
    assert lines(document(), Look(100)) == [
        "SUBSTITUTED  amps has a substitute.",
        "",
        "service  state             rate  publisher      value ± error in 95 %",
        "volts    not_healed              -              -",
        "amps     substituted    49.9 Hz  /substitute_1  3.21 ± 0.4 A",
        "odom     well           50.0 Hz  /base          v 0.5 ± 0.02 m/s, w -",
        "",
        "open incidents",
        "3. amps, silent for 12 s: /substitute_1 replaces it",
    ]


@pytest.mark.parametrize("width", [1, 8, 24, 40, 60, 100, 300])
@pytest.mark.parametrize("height", [1, 3, 6, 10, 40])
def test_it_fits_into_any_terminal(width: int, height: int) -> None:
    many = {f"service_{n:03}": row(WELL, f"/node_{n}", 50.0, p=prop(1.0)) for n in range(200)}
    cases: List[Dict[str, Any]] = [many, {}]
    for services in cases:
        told = lines(document(**services), Look(width, height, first=500))
        assert len(told) <= height and all(len(line) <= width for line in told)


def test_what_matters_stays_where_there_is_little_room() -> None:
    narrow = "\n".join(lines(document(), Look(32)))
    assert "volts    not_healed" in narrow and "publisher" not in narrow


def test_services_are_ordered_as_wanted_and_scrolled() -> None:
    many = {f"s{n:02}": row(WELL, "/n", float(n), p=prop(1.0)) for n in range(30)}
    many["z"] = row(Condition.KEPT.value, None, None)
    first = [lines(document(**many), Look(80, 12, sort))[3].split()[0] for sort in Sort]
    assert first == ["z", "s00", "s29"]
    scrolled = lines(document(**many), Look(80, 12, Sort.NAME, first=25))
    assert scrolled[-1].startswith("q quit, s sorted by name, ") and "of 31" in scrolled[-1]
    assert scrolled[3].split()[0] >= "s20"


def test_colours_are_only_where_they_are_wanted_and_never_alone() -> None:
    plain, coloured = (lines(document(), Look(100, colour=each)) for each in (False, True))
    assert "\x1b" not in "".join(plain) and "\x1b[33msubstituted" in coloured[4]
    assert [re.sub("\x1b\\[[0-9;]*m", "", line) for line in coloured] == plain


def test_what_is_lost_is_said_and_text_from_outside_does_no_harm() -> None:
    lost = document()
    lost["healing"].update(monitor="lost", text="monitor: it is gone")
    lost["hosts"] = {"pi": {"state": "lost", "text": ""}}
    lost["trust"] = {"state": "refused", "text": "refused so far: \x1b[2J"}
    told = glance(lost, Look(100), "No ROS master answers.").lines
    assert told[1:5] == [
        "monitor: it is gone",
        "refused so far: \\x1b[2J",
        "computers: pi lost",
        "No ROS master answers.",
    ]


def test_a_value_has_its_error_and_its_unit() -> None:
    assert value(prop(12.3456, 0.0151, "V")) == "12.35 ± 0.015 V"
    assert value({**prop(2.0), "error_rms": 0.5}) == "2 ± 0.5"
    assert value(prop(None, 0.1, "V")) == "-"


def test_keys_move_sort_and_end() -> None:
    assert keys(b"\x1b[Bs\x1b[6~q") == [b"\x1b[B", b"s", b"\x1b[6~", b"q"]
    many = {f"s{n:02}": row(WELL, "/n", float(n), p=prop(1.0)) for n in range(30)}
    screen = Screen(colour=False)

    def top() -> List[str]:
        text = screen.draw(document(**many), "", 80, 10)
        assert text.startswith("\x1b[H") and text.endswith("\x1b[J")
        return text.replace("\x1b[K", "").split("\r\n")[3].split()

    assert top()[0] == "s00"
    assert not any([screen.key(key) for key in (b"\x1b[B", b"\x1b[6~", b"\x1b[A", b"x")])
    assert top()[0] == "s10"
    for _ in range(10):
        screen.key(b"\x1b[6~")
    bottom = top()[0]
    screen.key(b"\x1b[A")
    assert bottom == "s24" and top()[0] == "s23", "no key is lost beyond the end"
    screen.key(b"s")
    assert top()[0] == "s00" and screen.key(b"q")


CHILD = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)  # who runs the tests may ignore it
sys.path.insert(0, sys.argv.pop(1))
from test_glance import document
from shsa_view.terminal import show

class Robot:
    def look(self):
        return "No ROS master answers."
    def document(self):
        return document()

sys.exit(show(Robot()))
"""


def in_terminal(typed: bytes, wanted: str, **environment: str) -> str:
    """Return all that a terminal shows in which something is typed, once it is shown."""
    pid, master = pty.fork()
    if not pid:
        command = [sys.executable, "-c", CHILD, str(Path(__file__).resolve().parent)]
        os.execve(sys.executable, command, {**os.environ, "TERM": "xterm", **environment})
    shown, deadline = b"", time.monotonic() + 60.0
    while True:
        ready, _, _ = select.select([master], [], [], max(0.0, deadline - time.monotonic()))
        assert ready, shown
        try:
            new = os.read(master, 65536)
        except OSError:  # it has ended
            break
        if not new:
            break
        shown += new
        if typed and wanted.encode() in shown:
            os.write(master, typed)
            typed = b""
    _, status = os.waitpid(pid, 0)
    os.close(master)
    return f"{shown.decode()}|{status}"


def test_a_terminal_is_taken_and_given_back() -> None:
    shown = in_terminal(b"q", "q quit")
    assert shown.startswith("\x1b[?1049h\x1b[?25l") and "\x1b[33mSUBSTITUTED\x1b[0m" in shown
    assert "No ROS master answers." in shown
    assert shown.endswith("\x1b[?25h\x1b[?1049l|0")


def test_ctrl_c_gives_the_terminal_back_too_and_no_colour_is_heeded() -> None:
    shown = in_terminal(b"\x03", "q quit", NO_COLOR="1")
    assert "\x1b[33m" not in shown and "SUBSTITUTED" in shown
    assert "\x1b[?25h\x1b[?1049l" in shown and not shown.endswith("|0")
