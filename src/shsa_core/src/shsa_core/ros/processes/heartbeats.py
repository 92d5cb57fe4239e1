"""Signs of life between healing's processes on one computer, over a socket that is our user's own.

A heartbeat is a datagram, sent by the loop that does the work: a process that hangs sends none. The
kernel says who has sent it. Each is answered by which process the master is, or that the
reconfigurator is out of reach.
"""
import hashlib
import os
import socket
import struct
import time
from contextlib import suppress
from typing import Callable, Dict, Iterable, NamedTuple, Optional, Tuple

import rospkg
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros import settings
from shsa_core.ros.master.announce import register_again
from shsa_core.ros.trust.places import origin
from shsa_core.ros.workers import Workers, repeating

CREDENTIALS = struct.Struct("3i")
SPACE = socket.CMSG_SPACE(CREDENTIALS.size)
LONGEST_B = 300
MONITOR, RECONFIGURATOR = "monitor", "reconfigurator"
"""The hearers of heartbeats."""
HOST = "SHSA_HOST"
"""The environment variable of a substitute that an agent has started: the agent's name."""
CUT_OFF = b"cut off"


def hearer(host: str) -> str:
    """Return the hearer of the substitutes of an agent; without one: the reconfigurator."""
    return f"agent {host}" if host else RECONFIGURATOR


class Sign(NamedTuple):
    """The last sign of life: whose process that is, and when it came, in s."""

    pid: int
    time: float


class Heart:
    """Sends heartbeats to `role`, keeps its last `answer`; `calls` registers with a new master."""

    def __init__(self, role: str, calls: Optional[Workers] = None) -> None:
        self._name = rospy.get_name().encode()
        self._address = ""
        try:
            self._address = _address(role)
        except (OSError, ShsaError) as error:
            rospy.logwarn("Our heartbeats cannot be sent: %s", error)
        self._due, self._answered, self.answer = 0.0, time.monotonic(), b""
        self._master, self._calls = b"", calls
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        # The system gives it an address with this, so that it can be answered.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.setblocking(False)

    @property
    def cut_off(self) -> bool:
        """True if their hearer says that the reconfigurator is out of reach."""
        return self.answer == CUT_OFF and self.unheard < settings.CALL_S

    @property
    def unheard(self) -> float:
        """Return for how long in s nobody has answered them."""
        return time.monotonic() - self._answered

    def beat(self, at_once: bool = False) -> bool:
        """Beat if that is due, or `at_once`; return false if nobody listens. Raises nothing."""
        now = time.monotonic()
        if now < self._due and not at_once:
            return True
        self._due = now + settings.TURN_S
        with suppress(OSError):  # there is no answer left
            while True:
                self.answer, self._answered = self._socket.recv(LONGEST_B), now
        if self.answer.isdigit() and self.answer != self._master:
            if self._master and self._calls:  # maybe nobody had noted that it knew us
                self._calls.put(register_again)
            self._master = self.answer
        try:
            self._socket.connect(self._address)  # from now on nobody else can send to us
            self._socket.send(self._name)
        except BlockingIOError:
            return True  # somebody listens, and not fast enough
        except OSError:
            return False
        return True


class Signs:
    """Hears the heartbeats for `role`, of processes of our own user, in a thread of its own.

    `last`: the last sign of each node, to be forgotten when it is gone. Each sender is told
    `answer()`: the number of the master's process, or CUT_OFF.
    """

    def __init__(self, role: str, answer: Callable[[], bytes] = lambda: b"") -> None:
        self.last: Dict[str, Sign] = {}
        self._answer = answer
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        try:
            _bind(self._socket, _address(role))
        except (OSError, ShsaError) as error:
            rospy.logwarn("Heartbeats cannot be received; a hung process goes unnoticed: %s", error)
            return
        repeating("heartbeats", settings.REST_S, self._work).start()

    def _work(self) -> None:
        while True:
            name, extra, _, address = self._socket.recvmsg(LONGEST_B, SPACE)
            pid = sender(extra)
            if pid is not None:
                self.last[name.decode("utf-8", "replace")] = Sign(pid, time.monotonic())
                with suppress(OSError):  # it has ended, or does not listen; nobody is waited for
                    self._socket.sendto(self._answer(), socket.MSG_DONTWAIT, address)


def sender(extra: Iterable[Tuple[int, int, bytes]]) -> Optional[int]:
    """Return the process that has sent a datagram; None: it is not of our user."""
    for level, kind, data in extra:
        if level == socket.SOL_SOCKET and kind == socket.SCM_CREDENTIALS:
            pid, user, _ = CREDENTIALS.unpack(data[: CREDENTIALS.size])
            return int(pid) if user == os.getuid() else None
    return None


def _address(role: str) -> str:
    # In the system's own space, without our folder, anybody could take its name, or fill its queue.
    # Containers, and computers, may share our home, and each calls its master localhost.
    place = origin() + f" {rospy.get_namespace()} {role}".encode()
    name = hashlib.sha256(place).hexdigest()[:32] + ".socket"
    folder = os.path.join(rospkg.get_ros_home(), "shsa")
    os.makedirs(folder, 0o700, exist_ok=True)
    # The folder's own path may be longer than a socket's: the system takes 107 bytes.
    return f"/proc/self/fd/{os.open(folder, os.O_PATH | os.O_DIRECTORY)}/{name}"


def _bind(listener: socket.socket, path: str) -> None:
    folder = os.stat(os.path.dirname(path))
    if folder.st_uid != os.geteuid() or folder.st_mode & 0o022:
        raise OSError(f"others can write the folder of {path}")
    with suppress(FileNotFoundError):
        os.unlink(path)
    os.fchmod(listener.fileno(), 0o600)  # the file that `bind` makes has this mode
    listener.bind(path)
