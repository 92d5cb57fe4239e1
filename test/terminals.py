"""A program in a terminal of its own: what it shows, and what is typed."""
import os
import pty
import select
import time
from typing import Mapping, Sequence, Tuple


def typed_once_shown(
    command: Sequence[str],
    environment: Mapping[str, str],
    steps: Sequence[Tuple[str, bytes]],
    timeout: float = 60.0,
) -> Tuple[str, int]:
    """Return all that a command shows, and its exit status as `os.waitpid` has it.

    `steps`: what is waited for, and what is typed then. Raises AssertionError if it does not come
    within `timeout` s, or if the program does not end.
    """
    pid, terminal = pty.fork()
    if not pid:
        os.execvpe(command[0], list(command), {**environment, "TERM": "xterm"})
    waiting, shown, seen = list(steps), b"", 0
    deadline = time.monotonic() + timeout
    try:
        while True:
            left = max(0.0, deadline - time.monotonic())
            assert select.select([terminal], [], [], left)[0], (waiting, shown[-4000:])
            try:
                new = os.read(terminal, 65536)
            except OSError:  # nobody has it open any more
                break
            if not new:
                break
            shown += new
            if waiting and waiting[0][0].encode() in shown[seen:]:
                os.write(terminal, waiting.pop(0)[1])
                seen = len(shown)
            assert waiting == [] or time.monotonic() < deadline, (waiting, shown[-4000:])
    finally:
        os.close(terminal)
    assert not waiting, (waiting, shown[-4000:])
    return shown.decode("utf-8", "replace"), os.waitpid(pid, 0)[1]
