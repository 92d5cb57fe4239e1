"""Keeps records in a file, so that they outlive the process; the newest line of a key counts.

A line is one JSON object: the first has the format's version and the owner of the records, any
other a record, or the keys of those that are gone.
"""
import contextlib
import os
from typing import Any, Callable, Dict, Iterable, Mapping, NamedTuple, Optional, Tuple

from shsa_core.errors import ModelError
from shsa_core.files.regular import read_own
from shsa_core.journal.codec import Codec
from shsa_core.journal.lines import create, read_line, write_all, write_line

VERSION = 1
HEADER, REMOVED = "records", "removed"
LIMIT_BYTES = 20_000_000
"""The longest file that is read."""
GROWTH_BYTES = 1_000_000
"""The file is written anew after it has grown by this."""


class Former(NamedTuple):
    """The owner of the records that were read, and the records."""

    owner: Mapping[str, str]
    records: Tuple[Any, ...]


class RecordFile:
    """Keeps records in a file that only its owner can read or write.

    `write` is done when it returns: what was written is there after a `kill -9`, though not after
    a loss of power. What cannot be written is told once, and again when it can. The file of a
    former process stays until the first `write`.

    Args:
        path: the file; its folder must be there.
        codec: of the records.
        owner: of the records, as texts by name.
        warn: is called when nothing can be written, and when it can be again.
    """

    def __init__(
        self, path: str, codec: Codec, owner: Mapping[str, str], warn: Callable[[str], None]
    ) -> None:
        self._path, self._codec, self._owner, self._warn = path, codec, dict(owner), warn
        self._kept: Dict[str, bytes] = {}
        self._file: Optional[int] = None
        self._grown = 0
        self._fails = False

    def write(self, records: Iterable[Any], removed: Iterable[str] = ()) -> None:
        """Add and replace records, each with its `key`, and drop those of keys. Raises nothing."""
        lines = {each.key: write_line(self._codec.encode(each)) for each in records}
        gone = [key for key in removed if self._kept.pop(key, None) is not None]
        self._kept.update(lines)
        new = b"".join([*lines.values(), *([write_line({REMOVED: gone})] if gone else [])])
        try:
            self._grown += len(new)
            if self._file is None or self._grown > GROWTH_BYTES:
                self._write_anew()
            else:
                write_all(self._file, new)
        except OSError as error:
            self.close()  # the whole is written next time: there are no gaps
            self._tell(error)
        else:
            self._tell(None)

    def _write_anew(self) -> None:
        self.close()
        beside = self._path + ".new"
        with contextlib.suppress(FileNotFoundError):
            os.unlink(beside)
        self._file = create(beside)
        write_all(self._file, write_line({HEADER: VERSION, **self._owner}))
        write_all(self._file, b"".join(self._kept.values()))
        os.replace(beside, self._path)
        self._grown = 0

    def close(self) -> None:
        """Close the file; the next write begins it anew."""
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def _tell(self, error: Optional[OSError]) -> None:
        if (error is not None) is not self._fails:
            self._fails = error is not None
            why = f"cannot be written: {error}" if error is not None else "can be written again"
            self._warn(f"The records in {self._path} {why}.")


def read_records(path: str, codec: Codec) -> Former:
    """Return the records in a file, none if there is no file; a last line that was cut is left out.

    Raises ModelError if it is somebody else's, others can write it, or something is malformed.
    """
    try:
        data = read_own(path, LIMIT_BYTES)
    except FileNotFoundError:
        return Former({}, ())
    except OSError as error:
        raise ModelError(path, f"cannot be read: {error}") from error
    lines = data.split(b"\n")[:-1]
    if not lines:
        return Former({}, ())
    owner = read_line(lines[0], f"{path}:1")
    if owner.pop(HEADER, None) != VERSION or not _are_texts(owner.values()):
        raise ModelError(f"{path}:1", "these are no records")
    kept: Dict[str, Any] = {}
    for number, line in enumerate(lines[1:], 2):
        where = f"{path}:{number}"
        fields = read_line(line, where)
        if REMOVED not in fields:
            record = codec.decode(fields, where, "record")
            kept[record.key] = record
            continue
        keys = fields[REMOVED]
        if not isinstance(keys, list) or not _are_texts(keys):
            raise ModelError(where, "the keys of what is gone must be texts")
        for key in keys:
            kept.pop(key, None)
    return Former(owner, tuple(kept.values()))


def _are_texts(values: Iterable[Any]) -> bool:
    return all(isinstance(each, str) for each in values)
