"""The listings of a Markdown page, and a reader who types them as they stand.

A listing of commands is run by a test, or the page says why not, in a comment above it:
`<!-- not run: needs the real rover -->`. A page that one test follows from its first listing to its
last says `<!-- followed by: test/test_start.py -->`; test_listings.py runs those of other pages.
"""
import contextlib
import os
import re
import signal
import socket
import subprocess
import uuid
from pathlib import Path
from typing import Dict, Iterator, List, NamedTuple

import psutil

from shsa_testing.processes import marked
from shsa_testing.waiting import wait_until

ROOT = Path(__file__).resolve().parent.parent
PATIENCE_S = 60.0  # a busy machine; what is typed usually takes 15 s

_MARK = "SHSA_READER"
_NOT_RUN = re.compile(r"<!-- not run: (.+) -->$")
_FOLLOWED = re.compile(r"^<!-- followed by: (\S+) -->$", re.MULTILINE)
_SHELLS = ("bash", "sh", "console")
_PROGRAM = re.compile(
    r"([A-Z_]+=\S+ )*(~?[\w./-]*/)?"  # settings, and a folder
    r"(shsa\w*|ros[a-z]+|make|source|sudo|cp|mv|mkdir|cd|cat|sed|tail|kill|ssh|scp|git|apt-get|pip"
    r"|catkin\w*|docker|hosts_setup|bench|reliability|fuzz|mutation|python3|systemctl|journalctl"
    r"|chromium|curl|install)\b(?!:)"
)


class Listing(NamedTuple):
    """A block of code: `language` is empty where it is indented, or not said.

    `line`: its first, from 1. `not_run`: why no test runs it, in words.
    """

    page: Path
    line: int
    language: str
    text: str
    not_run: str

    @property
    def commands(self) -> bool:
        """True if it is typed into a terminal."""
        if self.language:
            return self.language in _SHELLS
        return _PROGRAM.match(self.text) is not None

    def __str__(self) -> str:
        return f"{os.path.relpath(str(self.page), str(ROOT))}:{self.line}"


def listings(page: Path) -> List[Listing]:
    """Return the listings of a page, fenced or indented by four spaces, in order."""
    found: List[Listing] = []
    lines = page.read_text("utf-8").splitlines()
    at, not_run = 0, ""
    while at < len(lines):
        line, begun, language = lines[at], at, ""
        mark = _NOT_RUN.match(line)
        if mark:
            not_run = mark.group(1)
            at += 1
        elif line.startswith("```"):
            language, block = line[3:].strip("{} "), []
            at += 1
            while lines[at] != "```":
                block.append(lines[at])
                at += 1
            at += 1
            found.append(Listing(page, begun + 2, language, "\n".join(block), not_run))
            not_run = ""
        elif line.startswith("    ") and _begins(lines[:at]):
            while at < len(lines) and (lines[at].startswith("    ") or not lines[at]):
                at += 1
            text = "\n".join(each[4:] for each in lines[begun:at]).strip("\n")
            found.append(Listing(page, begun + 1, "", text, not_run))
            not_run = ""
        else:
            not_run = "" if line else not_run
            at += 1
    return found


def _begins(before: List[str]) -> bool:
    """Return whether an indented line is the first of a listing, by the lines before it."""
    return not before or not before[-1] or before[-1].endswith("-->")


def follower(page: Path) -> str:
    """Return the test that a page says it is followed by; empty: none."""
    found = _FOLLOWED.search(page.read_text("utf-8"))
    return found.group(1) if found else ""


class Page:
    """A page that a test follows: its listings of commands, each taken once and in order."""

    def __init__(self, path: Path) -> None:
        self._left = [each for each in listings(path) if each.commands and not each.not_run]

    def take(self, begins: str = "") -> str:
        """Return the commands of the next listing; they must begin with some words."""
        assert self._left, f"the page has no more listings; {begins!r} was expected"
        listing = self._left.pop(0)
        assert listing.text.startswith(begins), f"{listing}: {begins!r} was expected"
        return listing.text

    def finished(self) -> None:
        """Nothing that a reader would type was left out."""
        assert not self._left, f"not typed: {', '.join(map(str, self._left))}"


def seen(line: str, text: str) -> bool:
    """Return whether a text shows a line, in which `...` stands for anything."""
    parts = [re.escape(part) for part in line.strip().split("...")]
    return re.search(".*".join(parts), text) is not None


class Terminal:
    """A shell that ends at the first command that fails."""

    def __init__(self, output: Path, commands: str, environment: Dict[str, str]) -> None:
        self._output = output
        with open(output, "w") as file:
            self.process = subprocess.Popen(
                ["bash", "-ec", commands],
                cwd=str(output.parent),
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )

    def shown(self) -> str:
        return self._output.read_text()

    def shows(self, text: str) -> None:
        """Wait until it shows a text of one line, in which `...` stands for anything."""
        try:
            ended = lambda: self.process.poll() is not None
            wait_until(lambda: seen(text, self.shown()) or ended(), PATIENCE_S, text)
        finally:
            assert seen(text, self.shown()), f"{text!r} not in {self.shown()}"

    def ends(self) -> None:
        """Press Ctrl-C, and wait until it has ended."""
        os.killpg(self.process.pid, signal.SIGINT)
        self.process.wait(PATIENCE_S)


class Reader:
    """Types what stands on a page, in a folder, on a master of its own."""

    def __init__(self, folder: Path, environment: Dict[str, str]) -> None:
        self.folder = folder
        self._environment = environment
        self._opened = 0

    def opens_terminal(self, commands: str) -> Terminal:
        """Type commands, and do not wait for them."""
        self._opened += 1
        return Terminal(self.folder / f"terminal_{self._opened}", commands, self._environment)

    def types(self, *commands: str) -> str:
        """Type commands, each of which must succeed; what they print."""
        terminal = self.opens_terminal("\n".join(commands))
        status = terminal.process.wait(PATIENCE_S)
        assert status == 0, f"{commands}: {terminal.shown()}"
        return terminal.shown()


@contextlib.contextmanager
def new_reader(folder: Path) -> Iterator[Reader]:
    """Return a reader; all that it has started ends with the block."""
    mark = uuid.uuid4().hex
    with socket.socket() as probe:
        probe.bind(("", 0))
        master = f"http://localhost:{probe.getsockname()[1]}"
    settings = {_MARK: mark, "ROS_MASTER_URI": master, "ROS_LOG_DIR": str(folder / "log")}
    settings["PYTHONUNBUFFERED"] = "1"  # a terminal shows each line at once, and a file does not
    try:
        yield Reader(folder, {**os.environ, **settings})
    finally:
        _end(mark)


def _end(mark: str) -> None:
    for number in (signal.SIGINT, signal.SIGKILL):
        for process in marked(_MARK, mark):
            with contextlib.suppress(psutil.NoSuchProcess):
                process.send_signal(number)
        try:
            wait_until(lambda: not marked(_MARK, mark), 15.0, "everything has ended")
            return
        except AssertionError:
            continue
