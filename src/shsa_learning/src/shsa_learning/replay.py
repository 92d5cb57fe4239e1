"""Reads a journal, and makes its decisions again.

A line that this program could not have written is refused.
"""
from dataclasses import dataclass
from time import perf_counter
from typing import Any, Dict, Iterator, NamedTuple, Optional, Tuple

from shsa_core.errors import ModelError
from shsa_core.files.regular import open_to_read
from shsa_core.journal.codec import CLASS
from shsa_core.journal.lines import (
    ANSWER,
    DIGEST,
    END,
    HEADER,
    SILENCE,
    VERSION,
    Answer,
    digest,
    read_line,
)
from shsa_core.journal.machines import MACHINES, MachineKind, machine_kind

MAX_LINE_BYTES = 100_000_000
CUT = "the recording stops without an end, as when the process is killed"
"""The end of a journal without a last line."""


class Entry(NamedTuple):
    """An event, where it stands, and the machine's answer; None: the recording ends before that."""

    where: str
    event: Any
    answer: Optional[Answer]


class Journal:
    """A journal in a file. Raises ModelError if it has no valid header.

    Attributes:
        path: the file.
        kind: the machine.
        setup: the arguments that the machine was made with.
        begun: date and time.
        end: why it ends; known once all entries are read.
    """

    def __init__(self, path: str) -> None:
        self.path = path
        self.end = CUT
        nothing: Tuple[str, Dict[str, Any]] = (path, {})
        where, header = next(self._lines(), nothing)
        if header.get(HEADER) != VERSION:
            raise ModelError(where, f"is no journal of version {VERSION}")
        name = header.get("machine")
        if not isinstance(name, str) or name not in MACHINES:
            raise ModelError(where, f"there is no machine {name!a}: {', '.join(MACHINES)}")
        self.kind = machine_kind(name)
        self.begun = str(header.get("begun", ""))
        self.setup: Dict[str, Any] = _setup(self.kind, header.get("setup"), where)

    def entries(self) -> Iterator[Entry]:
        """Yield the events in order. Raises ModelError at the first line that is not valid."""
        waiting: Optional[Entry] = None
        lines = self._lines()
        next(lines)
        for where, data in lines:
            if CLASS in data:
                if waiting is not None:
                    yield waiting
                waiting = Entry(where, self.kind.events.decode(data, where, "the event"), SILENCE)
            elif ANSWER in data and waiting is not None and waiting.answer is SILENCE:
                waiting = waiting._replace(answer=_answer(data, where))
            elif END in data:
                self.end = str(data[END])
                break
            else:
                raise ModelError(where, "is neither an event, nor the answer to one, nor the end")
        if waiting is not None:
            known = self.end != CUT or waiting.answer is not SILENCE
            yield waiting if known else waiting._replace(answer=None)

    def _lines(self) -> Iterator[Tuple[str, Dict[str, Any]]]:
        """Yield each whole line with its place; a kill may have cut the last one."""
        try:
            with open_to_read(self.path) as file:
                for number in range(1, 1 << 62):
                    where = f"{self.path}:{number}"
                    line = file.readline(MAX_LINE_BYTES)
                    if not line.endswith(b"\n"):
                        if len(line) == MAX_LINE_BYTES:
                            raise ModelError(where, f"is longer than {MAX_LINE_BYTES} bytes")
                        return
                    yield where, read_line(line, where)
        except OSError as error:
            raise ModelError(self.path, f"cannot be read: {error.strerror}") from error


def _setup(kind: MachineKind, data: Any, where: str) -> Dict[str, Any]:
    """Return the arguments of a machine. Raises ModelError."""
    if not isinstance(data, dict):
        raise ModelError(where, "the setup must be an object")
    for name in data:
        if name not in kind.setup:
            raise ModelError(where, f"the setup of {kind.name} has no {name!a}")
    missing = [name for name in kind.required if name not in data]
    if missing:
        raise ModelError(where, f"the setup of {kind.name} lacks {', '.join(missing)}")
    return {n: kind.setup[n].decode(each, where, f"setup.{n}") for n, each in data.items()}


def _answer(data: Any, where: str) -> Answer:
    """Return the answer of a line that has one. Raises ModelError."""
    names, told = data[ANSWER], data.get(DIGEST)
    if not isinstance(names, list) or not all(isinstance(each, str) for each in names):
        raise ModelError(where, "an answer must be a list of names")
    if not isinstance(told, str):
        raise ModelError(where, f"an answer must have a {DIGEST}")
    return Answer(tuple(names), told)


@dataclass(frozen=True)
class Step:
    """One event and the machine's answer now, which took `seconds`.

    `then`: the recorded answer, None: unknown. `error`: what the machine raised. `broken`: the
    invariant that does not hold after the event.
    """

    where: str
    event: Any
    commands: Tuple[Any, ...]
    seconds: float
    now: Answer
    then: Optional[Answer]
    error: str = ""
    broken: str = ""

    @property
    def differs(self) -> bool:
        """True if the answer is not the recorded one."""
        return self.then is not None and self.then != self.now


def replay(journal: Journal) -> Iterator[Step]:
    """Make the decisions of a journal again with a new machine. Raises ModelError."""
    try:
        machine = journal.kind.make(**journal.setup)
    except Exception as raised:  # whatever it is, it comes from this setup
        raise ModelError(journal.path, f"the setup makes no machine: {raised!r}") from raised
    validate = getattr(machine, "validate", None)
    for where, event, then in journal.entries():
        commands: Tuple[Any, ...] = ()
        failed = broken = ""
        begun = perf_counter()
        try:
            commands = tuple(machine.handle(event))
        except Exception as raised:  # as the nodes do, which go on after whatever it was
            failed = repr(raised)
        seconds = perf_counter() - begun
        if validate is not None:
            try:
                validate()
            except Exception as raised:
                broken = str(raised) or repr(raised)
        now = digest(journal.kind.commands, commands) if commands else SILENCE
        yield Step(where, event, commands, seconds, now, then, failed, broken)
