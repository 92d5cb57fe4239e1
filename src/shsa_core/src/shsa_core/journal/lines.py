"""The lines of a journal: each is one JSON object, known by its first key.

- `{"journal": 1, "machine": NAME, "begun": DATE, "setup": {...}}`: the first line
- `{"class": "FailureSeen", "time": 12.5, ...}`: an event
- `{"answer": ["AskToLeave", "Log"], "sha1": "..."}`: the machine's answer to it, if any
- `{"end": WHY}`: the last line, if the recording was ended
"""
import hashlib
import json
import os
from contextlib import suppress
from typing import Any, NamedTuple, NoReturn, Sequence, Tuple

from shsa_core.errors import ModelError
from shsa_core.journal.codec import Codec

VERSION = 1
"""Of these lines: a field that an older journal lacks has its default, and answers may differ."""
HEADER, ANSWER, DIGEST, END = "journal", "answer", "sha1", "end"
START = b'{"journal":'
"""The first bytes of every journal."""
_write = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode


class Answer(NamedTuple):
    """A machine's answer to an event: the classes of its commands, and their SHA-1."""

    names: Tuple[str, ...]
    digest: str


SILENCE = Answer((), "")


def digest(codec: Codec, commands: Sequence[Any]) -> Answer:
    """Return the answer that these commands are."""
    if not commands:
        return SILENCE
    text = _write([codec.encode(command) for command in commands])
    names = tuple(type(command).__name__ for command in commands)
    return Answer(names, hashlib.sha1(text.encode()).hexdigest())


def write_line(data: Any) -> bytes:
    """Return `data` as one line."""
    return _write(data).encode() + b"\n"


def create(path: str) -> int:
    """Open a new file that only its owner can read or write. Raises OSError."""
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    return os.open(path, flags, 0o600)


def write_all(file: int, data: bytes) -> None:
    """Write all of the data to a file descriptor. Raises OSError."""
    while data:
        data = data[os.write(file, data) :]


def write_anew(path: str, data: bytes) -> int:
    """Write a file beside a path, and put it in its place; return it, open. Raises OSError."""
    beside = path + ".new"
    with suppress(FileNotFoundError):
        os.unlink(beside)
    file = create(beside)
    try:
        write_all(file, data)
        os.replace(beside, path)
    except OSError:
        os.close(file)
        raise
    return file


def read_line(line: bytes, where: str) -> Any:
    """Return the JSON object that a line is. Raises ModelError."""
    try:
        data = json.loads(line.decode("utf-8"), parse_constant=_refuse_constant)
    except (ValueError, RecursionError) as error:
        raise ModelError(where, f"is not a line of a journal: {error}") from error
    if not isinstance(data, dict):
        raise ModelError(where, "is not a line of a journal: it is no JSON object")
    return data


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is not JSON")
