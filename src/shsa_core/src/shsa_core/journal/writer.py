"""Writes a journal in a thread, so that the machine never waits for the disk."""
import os
import stat
import threading
from collections import deque
from datetime import datetime, timezone
from typing import Any, Callable, Deque, Mapping, Optional, Sequence

from shsa_core.journal import lines
from shsa_core.journal.machines import machine_kind

LIMIT_BYTES = 50_000_000  # of a file
WRITE_PERIOD_S = 0.2
"""Pause between writes: a kill loses at most what was recorded in it."""
WAITING = 100_000
"""Records that may wait for the disk; more end the recording."""
BATCH = 50
"""Lines that are made at once, before other threads have their turn."""

Handle = Callable[[Any], Sequence[Any]]
"""Handles an event of a machine; returns its commands."""


class JournalWriter:
    """Records the events of one machine and its answers in a new file that only its owner can read.

    An older journal of the same path is kept as `path.1`. Recording takes a microsecond; a thread
    writes, so that a slow disk holds nobody up. What cannot go on, because the disk is full or the
    limit is reached, ends the recording with one warning: there are no gaps, so that what was
    recorded can always be replayed from its start.

    Args:
        path: the file.
        machine: a name in MACHINES.
        setup: the arguments that the machine was made with.
        warn: is called once with why the recording ended, maybe by another thread.
    """

    def __init__(
        self,
        path: str,
        machine: str,
        setup: Mapping[str, Any],
        warn: Callable[[str], None],
    ) -> None:
        self._path, self._warn = path, warn
        self._kind = machine_kind(machine)
        self._waiting: Deque[Any] = deque()
        self._closing = threading.Event()
        self._size = 0
        self._file: Optional[int] = None
        self._thread = threading.Thread(target=self._work, name="journal", daemon=True)
        self.recording = True
        try:
            begun = datetime.now(timezone.utc).isoformat(timespec="seconds")
            header = {lines.HEADER: lines.VERSION, "machine": machine, "begun": begun}
            header["setup"] = self._kind.encode_setup(setup)
            _keep_former(path)
            self._file = lines.create(path)
            self._write(lines.write_line(header))
        except (OSError, TypeError, ValueError) as error:
            self._stop(str(error))
        else:
            self._thread.start()

    def recorded(self, handle: Handle) -> Handle:
        """Return what handles an event, with the event and its answer recorded."""

        def recorded(event: Any) -> Sequence[Any]:
            if self.recording:
                self._waiting.append(event)
            commands = handle(event)
            if self.recording and commands:
                self._waiting.append(list(commands))
            return commands

        return recorded

    def close(self) -> None:
        """Write what is left, and that the recording was ended in order."""
        self._closing.set()
        if self._thread.is_alive():
            self._thread.join(10.0 * WRITE_PERIOD_S)

    def _work(self) -> None:
        while self.recording and not self._closing.wait(WRITE_PERIOD_S):
            self._drain()
        self._drain()
        self._end("closed")

    def _drain(self) -> None:
        count = len(self._waiting)
        try:
            if count > WAITING:
                raise OSError(f"the disk is too slow, {count} records wait for it")
            for start in range(0, count, BATCH):
                batch = [self._waiting.popleft() for _ in range(min(BATCH, count - start))]
                data = b"".join(map(self._line, batch))
                if self._size + len(data) > LIMIT_BYTES:
                    why = f"the limit of {LIMIT_BYTES:g} bytes is reached"
                    self._end(why)
                    self._warn(f"The journal {self._path} ends: {why}.")
                    return
                self._write(data)
        except (OSError, TypeError, ValueError, AttributeError) as error:
            self._stop(str(error))

    def _line(self, record: Any) -> bytes:
        if not isinstance(record, list):
            return lines.write_line(self._kind.events.encode(record))
        names, told = lines.digest(self._kind.commands, record)
        return lines.write_line({lines.ANSWER: names, lines.DIGEST: told})

    def _write(self, data: bytes) -> None:
        assert self._file is not None
        self._size += len(data)
        lines.write_all(self._file, data)

    def _end(self, why: str) -> None:
        if self.recording:
            try:
                self._write(lines.write_line({lines.END: why}))
            except OSError as error:
                self._stop(str(error))
            self._close_file()

    def _stop(self, why: str) -> None:
        if self.recording:
            self._close_file()
            self._warn(f"The journal {self._path} cannot be written: {why}.")

    def _close_file(self) -> None:
        self.recording = False
        self._waiting.clear()
        if self._file is not None:
            os.close(self._file)
            self._file = None


def _keep_former(path: str) -> None:
    """Rename a journal that is there already; what is no journal is left alone. Raises OSError."""
    if not os.path.lexists(path):
        return
    if not stat.S_ISREG(os.lstat(path).st_mode):
        raise OSError("there is something that is no file")
    with open(path, "rb") as file:
        if file.read(len(lines.START)) != lines.START:
            raise OSError("there is a file that is no journal")
    os.replace(path, path + ".1")
