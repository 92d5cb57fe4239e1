"""`injectable NODE ARGUMENTS`: runs a Python node so that its messages can be made to fail.

What is no Python program runs as it is. Between faults the node runs its own code and rospy's
alone; there is one more thread, which waits at a unix socket.
"""
import atexit
import contextlib
import os
import runpy
import select
import shutil
import socket
import sys
import threading
import time
from typing import Any, Dict

from shsa_core.errors import ShsaError
from shsa_injection import channel

LONGEST_REQUEST_S = 1.0  # s that whoever connects has to say what is wanted


class Server:
    """Makes this process fail as it is asked to.

    A fault lasts until its deadline, or until the connection on which it was asked for is closed:
    it ends with whoever asked for it.
    """

    def __init__(self) -> None:
        channel.clear(os.environ)
        self._socket, self._path = channel.listen(os.environ)
        atexit.register(self._remove, os.getpid())
        threading.Thread(target=self._serve, name="injectable", daemon=True).start()

    def _remove(self, pid: int) -> None:
        if os.getpid() == pid:  # not a child's
            with contextlib.suppress(OSError):
                os.unlink(self._path)

    def _serve(self) -> None:
        while True:
            connection, _ = self._socket.accept()
            threading.Thread(target=self._answer, args=(connection,), daemon=True).start()

    def _answer(self, connection: socket.socket) -> None:
        with connection:
            if channel.peer(connection)[1] != os.getuid():
                return
            connection.settimeout(LONGEST_REQUEST_S)
            try:
                request = channel.receive(connection)
                fault = _fault(request)
                if request.get("only_asks"):
                    channel.send(connection, {"detail": fault.detail})
                    return
                end = fault.begin()
            except (ShsaError, OSError, KeyError, TypeError, ValueError) as error:
                with contextlib.suppress(OSError):
                    channel.send(connection, {"refused": str(error) or repr(error)})
                return
            try:
                with contextlib.suppress(OSError):  # whoever asked is gone: that is the end as well
                    channel.send(connection, {"detail": fault.detail})
                    _wait_for_end(connection, end)
            finally:
                told = fault.end()
            with contextlib.suppress(OSError):
                channel.send(connection, told)


def _fault(request: Dict[str, Any]) -> Any:
    """Make the requested fault. Loaded only now: a node that never fails need not wait."""
    if "values" in request:
        from shsa_injection.inside.publishing import PublishingFault

        return PublishingFault(request)
    from shsa_injection.inside.reading import ReadingFault

    return ReadingFault(request)


def _wait_for_end(connection: socket.socket, end: float) -> None:
    """Wait until a moment of the monotonic clock, or until the other end closes."""
    while True:
        left = end - time.monotonic()
        if left <= 0.0 or select.select([connection], [], [], min(left, 3600.0))[0]:
            return


def is_python(path: str) -> bool:
    """Return whether a file is a Python program."""
    with open(path, "rb") as file:
        first = file.readline(200)
    return path.endswith(".py") or (first.startswith(b"#!") and b"python" in first)


def main() -> None:
    """Run the node that the arguments name."""
    if len(sys.argv) < 2:
        sys.exit("usage: injectable NODE [ARGUMENT ...]")
    words = sys.argv[1:]
    path = shutil.which(words[0])
    if path is None:
        sys.exit(f"injectable: {words[0]} is no program")
    if not is_python(path):
        print(f"injectable: {path} is no Python program; only its process can fail", flush=True)
        os.execv(path, words)
    try:
        Server()
    except (ShsaError, OSError) as error:  # a node that cannot be made to fail is still a node
        print(f"injectable: the messages of {path} cannot fail: {error}", flush=True)
    sys.argv = words
    sys.path[0] = os.path.dirname(os.path.realpath(path))
    runpy.run_path(path, run_name="__main__")
