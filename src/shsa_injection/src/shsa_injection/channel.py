"""The unix socket between an injectable node and whoever makes it fail: for one user alone.

It never shows on the ROS graph. The kernel tells both ends who the other one is.
"""
import contextlib
import json
import os
import socket
import stat
import struct
from typing import Any, Dict, Iterator, Mapping, Tuple

from shsa_core.errors import ShsaError

FOLDER = "shsa_injection"
LONGEST_LINE = 65536
_CREDENTIALS = struct.Struct("3i")


def folder(environment: Mapping[str, str]) -> str:
    """Make and return the folder of the sockets, below the ROS_HOME of an environment.

    Raises ShsaError if others could reach what is in it.
    """
    home = environment.get("ROS_HOME") or os.path.join(os.path.expanduser("~"), ".ros")
    path = os.path.join(home, FOLDER)
    os.makedirs(home, exist_ok=True)
    with contextlib.suppress(FileExistsError):
        os.mkdir(path, 0o700)
    found = os.lstat(path)
    if not stat.S_ISDIR(found.st_mode) or found.st_uid != os.getuid() or found.st_mode & 0o077:
        raise ShsaError(f"{path} must be a folder of this user's own, with the mode 0700")
    return path


def listen(environment: Mapping[str, str]) -> Tuple[socket.socket, str]:
    """Return the socket of this process, and its path."""
    path = os.path.join(folder(environment), f"{os.getpid()}.socket")
    with contextlib.suppress(FileNotFoundError):
        os.unlink(path)  # of a process that had the same number
    listening = socket.socket(socket.AF_UNIX)
    with _short(path) as address:
        listening.bind(address)
    listening.listen()
    return listening, path


def clear(environment: Mapping[str, str]) -> None:
    """Remove the sockets of processes that were killed."""
    path = folder(environment)
    for name in os.listdir(path):
        number = name.split(".")[0]
        if number.isdigit() and not os.path.exists(f"/proc/{number}"):
            with contextlib.suppress(FileNotFoundError):
                os.unlink(os.path.join(path, name))


def connect(pid: int, environment: Mapping[str, str], timeout: float) -> socket.socket:
    """Return a connection to an injectable process.

    Raises ShsaError if it is not injectable, or if somebody else answers in its place.
    """
    path = os.path.join(folder(environment), f"{pid}.socket")
    connection = socket.socket(socket.AF_UNIX)
    connection.settimeout(timeout)
    try:
        with _short(path) as address:
            connection.connect(address)
    except OSError as error:
        connection.close()
        raise ShsaError(f"process {pid} does not listen at {path}: {error.strerror}") from error
    if peer(connection) != (pid, os.getuid()):
        connection.close()
        raise ShsaError(f"another process than {pid} answers at {path}")
    return connection


def peer(connection: socket.socket) -> Tuple[int, int]:
    """Process and user at the other end, as the kernel knows them."""
    told = connection.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _CREDENTIALS.size)
    pid, user, _ = _CREDENTIALS.unpack(told)
    return pid, user


def send(connection: socket.socket, document: Mapping[str, Any]) -> None:
    """Send a document as one line."""
    connection.sendall(json.dumps(document).encode() + b"\n")


def receive(connection: socket.socket) -> Dict[str, Any]:
    """Read the next document; empty at the end of the connection. Raises ShsaError."""
    line = b""
    while not line.endswith(b"\n"):
        part = connection.recv(4096)
        if not part:
            return {}
        line += part
        if len(line) > LONGEST_LINE:
            raise ShsaError("a line on the socket is too long")
    try:
        document = json.loads(line)
    except ValueError as error:
        raise ShsaError(f"not a JSON document: {error}") from error
    if not isinstance(document, dict):
        raise ShsaError("the document must be a mapping")
    return document


@contextlib.contextmanager
def _short(path: str) -> Iterator[str]:
    """Yield a path of a socket that is short enough for the kernel, whatever its folder."""
    descriptor = os.open(os.path.dirname(path), os.O_RDONLY | os.O_DIRECTORY)
    try:
        yield f"/proc/self/fd/{descriptor}/{os.path.basename(path)}"
    finally:
        os.close(descriptor)
