"""Reads a journal, strictly: a line that this program could not have written is refused."""
from typing import Any, Dict, Iterator, NamedTuple, Optional, Tuple

from shsa_core.errors import ModelError
from shsa_core.files.regular import open_to_read
from shsa_core.journal.codec import Codec
from shsa_core.journal.coders import CLASS
from shsa_core.journal.lines import (
    ANSWER,
    END,
    HEADER,
    SILENCE,
    VERSION,
    Answer,
    read_answer,
    read_line,
)
from shsa_core.journal.machines import MACHINES, MachineKind, machine_kind

MAX_LINE_BYTES = 100_000_000
CUT = "the recording stops without an end, as when the process is killed"
"""Why a journal without a last line ends."""


class Entry(NamedTuple):
    """An event, where it stands, and what the machine answered.

    None: the recording ends before that.
    """

    where: str
    event: Any
    answer: Optional[Answer]


class Journal:
    """A journal in a file. Raises ModelError if it has no valid header.

    Attributes:
        path: the file.
        kind: which machine it is of.
        setup: the arguments that the machine was made with.
        begun: date and time.
        end: why it ends; known once all entries are read.
    """

    def __init__(self, path: str, kind: Optional[MachineKind] = None) -> None:
        self.path = path
        self.end = CUT
        nothing: Tuple[str, Dict[str, Any]] = (path, {})
        where, header = next(self._lines(), nothing)
        if header.get(HEADER) != VERSION:
            raise ModelError(where, f"is no journal of version {VERSION}")
        name = header.get("machine")
        if kind is None:
            if not isinstance(name, str) or name not in MACHINES:
                raise ModelError(where, f"there is no machine {name!a}: {', '.join(MACHINES)}")
            kind = machine_kind(name)
        self.kind = kind
        self.begun = str(header.get("begun", ""))
        self.setup: Dict[str, Any] = kind.decode_setup(header.get("setup"), where)

    def entries(self) -> Iterator[Entry]:
        """The events in order. Raises ModelError at the first line that is not valid."""
        waiting: Optional[Entry] = None
        lines = self._lines()
        next(lines)
        for where, data in lines:
            if CLASS in data:
                if waiting is not None:
                    yield waiting
                waiting = Entry(where, _decode(self.kind.events, data, where), SILENCE)
            elif ANSWER in data and waiting is not None and waiting.answer is SILENCE:
                waiting = waiting._replace(answer=read_answer(data, where))
            elif END in data:
                self.end = str(data[END])
                break
            else:
                raise ModelError(where, "is neither an event, nor the answer to one, nor the end")
        if waiting is not None:
            known = self.end != CUT or waiting.answer is not SILENCE
            yield waiting if known else waiting._replace(answer=None)

    def _lines(self) -> Iterator[Tuple[str, Dict[str, Any]]]:
        """Each whole line, with its place.

        The last one is not whole if the process was killed while it wrote.
        """
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


def _decode(codec: Codec, data: Dict[str, Any], where: str) -> Any:
    return codec.decode(data, where, "the event")
