"""A terminal that shows the robot, and heeds keys."""
import os
import select
import shutil
import sys
import termios
import time
import tty
from contextlib import contextmanager
from typing import Any, Iterator, List, Optional, Protocol

from shsa_view.glance import Look, Sort, glance

DRAW_S = 0.5
LOOK_S = 1.0
"""Between two looks for the master."""
ENTER, LEAVE = "\x1b[?1049h\x1b[?25l", "\x1b[?25h\x1b[?1049l"
"""The terminal's other screen, without a cursor; and back."""
HOME, CLEAR_LINE, CLEAR_REST = "\x1b[H", "\x1b[K", "\x1b[J"
UP, DOWN, PAGE_UP, PAGE_DOWN = b"\x1b[A", b"\x1b[B", b"\x1b[5~", b"\x1b[6~"
PAGE = 10
MOVES = {UP: -1, b"\x1bOA": -1, DOWN: 1, b"\x1bOB": 1, PAGE_UP: -PAGE, PAGE_DOWN: PAGE}
QUIT, SORT = (b"q", b"Q", b"\x04"), (b"s", b"S")


class Watched(Protocol):
    """A robot that can be watched."""

    def look(self) -> str:
        """Look for the master; what is to be said of it. Raises AnotherMaster."""

    def document(self) -> Any:
        """Return the state of the robot as a document."""


class AnotherMaster(Exception):
    """The ROS master is not the one that this process is known to."""


class Screen:
    """The screen, as keys have made it."""

    def __init__(self, colour: bool) -> None:
        self._colour = colour
        self._sort, self._first = Sort.STATE, 0

    def key(self, key: bytes) -> bool:
        """Heed a key; whether it ends the program."""
        if key in SORT:
            self._sort, self._first = self._sort.next, 0
        self._first = max(0, self._first + MOVES.get(key, 0))
        return key in QUIT

    def draw(self, document: Any, notice: str, width: int, height: int) -> str:
        """Return the text that makes the terminal show a document."""
        look = Look(width, height, self._sort, self._first, self._colour)
        told, self._first = glance(document, look, notice)
        return HOME + "\r\n".join(line + CLEAR_LINE for line in told) + CLEAR_REST


def show(watch: Watched) -> int:
    """Show what is watched until q, Ctrl-C or the end of the terminal. Returns the exit status."""
    try:
        with _taken():
            _show(watch)
    except AnotherMaster:  # no node of ours is known to it: this program begins anew
        os.execv(sys.executable, [sys.executable, *sys.argv])
    return 0


def coloured() -> bool:
    """Return whether colours are wanted: https://no-color.org."""
    return not os.environ.get("NO_COLOR") and os.environ.get("TERM", "dumb") != "dumb"


def keys(data: bytes) -> List[bytes]:
    """Yield the keys that were typed."""
    found: List[bytes] = []
    while data:
        key = next((each for each in MOVES if data.startswith(each)), data[:1])
        found.append(key)
        data = data[len(key) :]
    return found


def _show(watch: Watched) -> None:
    screen, notice = Screen(coloured()), ""
    drawn = looked = 0.0
    while True:
        now = time.monotonic()
        if now >= looked + LOOK_S:
            notice, looked = watch.look(), time.monotonic()
        if now >= drawn + DRAW_S:
            width, height = shutil.get_terminal_size()
            sys.stdout.write(screen.draw(watch.document(), notice, width, height))
            sys.stdout.flush()
            drawn = time.monotonic()
        typed = _typed(max(0.0, drawn + DRAW_S - time.monotonic()))
        if typed is None or any([screen.key(key) for key in keys(typed)]):
            return
        if typed:
            drawn = 0.0


def _typed(timeout: float) -> Optional[bytes]:
    """Return what was typed within some seconds; None: the terminal is gone."""
    ready, _, _ = select.select([sys.stdin], [], [], timeout)
    if not ready:
        return b""
    try:
        return os.read(sys.stdin.fileno(), 1024) or None
    except OSError:
        return None


@contextmanager
def _taken() -> Iterator[None]:
    """Take the terminal, with its other screen and key by key; give it back whatever happens."""
    settings = termios.tcgetattr(sys.stdin)
    try:
        tty.setcbreak(sys.stdin)
        sys.stdout.write(ENTER)
        sys.stdout.flush()
        yield
    finally:
        termios.tcsetattr(sys.stdin, termios.TCSADRAIN, settings)
        sys.stdout.write(LEAVE)
        sys.stdout.flush()
