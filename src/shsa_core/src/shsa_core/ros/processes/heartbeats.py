"""Signs of life between healing's processes on one computer, over a socket that is our user's own.

A heartbeat is a datagram, sent by the loop that does the work: a process that hangs sends none. The
kernel says who has sent it, so nobody can speak for another; neither the ROS master nor a
connection is needed, and whoever starts anew hears all of them at once. Each is answered by whether
the reconfigurator is in reach.
"""
import hashlib
import os
import socket
import struct
import threading
import time
from typing import Any, Callable, Dict, Iterable, List, NamedTuple, Optional, Tuple

import rospkg
import rospy

from shsa_core.ros.processes import kernel
from shsa_core.ros.trust.places import master_place

PERIOD_S = 0.1
"""At least between two heartbeats of a process."""
LOOK_S = 0.05
SILENT_S = 0.3
HUNG_S = 1.5
"""Silence in s. The first is three heartbeats; the second is the end of a process."""
STARVED_S = 15.0
"""So long at most a process that has no processor may be silent."""
CREDENTIALS = struct.Struct("3i")
SPACE = socket.CMSG_SPACE(CREDENTIALS.size)
LONGEST = 300
LONGEST_PATH = 100
"""Bytes of a socket's path; the system takes 107."""
MONITOR, RECONFIGURATOR = "monitor", "reconfigurator"
"""Who hears heartbeats."""
HOST = "SHSA_HOST"
"""The environment variable of a substitute that an agent has started: the agent's name."""


def hearer(host: str) -> str:
    """Who hears the heartbeats of the substitutes of an agent; without one: the reconfigurator."""
    return f"agent {host}" if host else RECONFIGURATOR


IN_REACH, CUT_OFF = b"in reach", b"cut off"
ANSWER_S = 0.5
"""So long an answer holds; without one nobody is cut off."""

Told = Callable[[str], None]


class Sign(NamedTuple):
    """The last sign of life: whose process that is, and when it came, in s."""

    pid: int
    time: float


class Heart:
    """Sends heartbeats to whoever hears those for `role`; nobody needs to."""

    def __init__(self, role: str) -> None:
        self._name = rospy.get_name().encode()
        self._address = ""
        try:
            self._address = _address(role)
        except OSError as error:
            rospy.logwarn("Nobody can hear our heartbeats: %s", error)
        self._due = 0.0
        self._heard = time.monotonic()
        self._cut_off = float("-inf")  # when that was told last
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        # The system gives it an address with this, so that it can be answered.
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        self._socket.setblocking(False)

    @property
    def cut_off(self) -> bool:
        """Whether who hears them says that the reconfigurator is out of reach."""
        return time.monotonic() < self._cut_off + ANSWER_S

    @property
    def unheard(self) -> float:
        """For how long in s nobody has heard them."""
        return time.monotonic() - self._heard

    def beat(self) -> None:
        """To be called by the loop at every turn; costs a few microseconds, and raises nothing."""
        now = time.monotonic()
        if now < self._due:
            return
        self._due = now + PERIOD_S
        self._hear()
        try:
            self._socket.sendto(self._name, self._address)
        except BlockingIOError:
            pass  # somebody listens, and not fast enough
        except OSError:
            return  # nobody listens
        self._heard = now

    def _hear(self) -> None:
        """Take the answers that have come."""
        try:
            while True:
                answer, extra, _, _ = self._socket.recvmsg(LONGEST, SPACE)
                if sender(extra) is not None:
                    cut_off = answer == CUT_OFF
                    self._cut_off = time.monotonic() if cut_off else float("-inf")
        except OSError:
            return  # there is none left


class Signs:
    """Hears the heartbeats for `role`, of processes of our own user; `of` is any thread's.

    `heard(name)`, if given, is called for each, in a thread of its own. `cut_off()`: whether the
    reconfigurator is out of reach, as each is told.
    """

    def __init__(
        self,
        role: str,
        heard: Told = lambda name: None,
        cut_off: Callable[[], bool] = lambda: False,
    ) -> None:
        self._last: Dict[str, Sign] = {}
        self._heard, self._cut_off = heard, cut_off
        self._socket: Optional[socket.socket] = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
        self._socket.setsockopt(socket.SOL_SOCKET, socket.SO_PASSCRED, 1)
        try:
            _bind(self._socket, _address(role))
        except OSError as error:
            rospy.logwarn("Who hangs is not noticed: heartbeats cannot be heard: %s", error)
            return
        threading.Thread(target=self._work, name="heartbeats", daemon=True).start()

    def of(self, name: str) -> Optional[Sign]:
        """The last sign of life of a node; None: it has given none."""
        return self._last.get(name)

    def names(self, prefix: str) -> List[str]:
        """The nodes that have given one, and whose names begin so."""
        return [name for name in list(self._last) if name.startswith(prefix)]

    def forget(self, name: str) -> None:
        """A node is gone; whoever comes under its name is another process."""
        self._last.pop(name, None)

    def _work(self) -> None:
        assert self._socket is not None
        while True:
            name, extra, _, address = self._socket.recvmsg(LONGEST, SPACE)
            pid = sender(extra)
            if pid is not None:
                told = name.decode("utf-8", "replace")
                self._last[told] = Sign(pid, time.monotonic())
                self._heard(told)
                self._answer(address)

    def _answer(self, address: Any) -> None:
        """Tell a process whether the reconfigurator is in reach; nobody is waited for."""
        assert self._socket is not None
        answer = CUT_OFF if self._cut_off() else IN_REACH
        try:
            self._socket.sendto(answer, socket.MSG_DONTWAIT, address)
        except OSError:
            return  # it has ended, or does not listen


class Watch:
    """Tells which of the nodes that have given signs of life give none any more.

    `silent(name)` after SILENT_S, `hung(name)` after HUNG_S, `heard(name)` at its first one and
    once it does again; in a thread of its own. Time in which this process was not scheduled itself
    does not count; nor does, for HUNG_S, time in which the other one was not, up to STARVED_S: what
    stands by comes last, and to start it anew would leave less time for it.
    """

    def __init__(
        self, signs: "Signs", silent: Told, hung: Told, heard: Told, prefix: str = ""
    ) -> None:
        self._signs, self._prefix = signs, prefix
        self._silent, self._hung, self._heard = silent, hung, heard
        self._seen: Dict[str, Tuple[Optional[Sign], float]] = {}  # and when it was new
        # Who is silent, and how long it had waited for a processor by then.
        self._quiet: Dict[str, float] = {}
        threading.Thread(target=self._work, name="signs of life", daemon=True).start()

    def is_silent(self, name: str) -> bool:
        """Whether a node gives no sign of life now."""
        return name in self._quiet

    def _work(self) -> None:
        looked, awake = time.monotonic(), 0.0
        while not rospy.is_shutdown():
            time.sleep(LOOK_S)
            before, looked = looked, time.monotonic()
            awake += min(looked - before, 2 * LOOK_S)
            for name in self._signs.names(self._prefix):
                self._look(name, awake)

    def _look(self, name: str, awake: float) -> None:
        sign = self._signs.of(name)
        if sign is None:
            return
        if name not in self._seen:
            self._heard(name)
        last, since = self._seen.get(name, (None, awake))
        self._seen[name] = sign, awake if sign != last else since
        silence = awake - self._seen[name][1]
        if silence < SILENT_S:
            if self._quiet.pop(name, None) is not None:
                self._heard(name)
        elif silence >= HUNG_S and self._hangs(name, sign.pid, silence):
            self._signs.forget(name)
            del self._seen[name]
            self._hung(name)
        elif name not in self._quiet:
            self._quiet[name] = kernel.waited(sign.pid)
            self._silent(name)

    def _hangs(self, name: str, pid: int, silence: float) -> bool:
        """Whether a silent process would have given a sign if it had been given the time to."""
        if silence >= STARVED_S:
            return True
        starved = kernel.waited(pid) - self._quiet.get(name, 0.0)
        return silence - starved >= HUNG_S


def sender(extra: Iterable[Tuple[int, int, bytes]]) -> Optional[int]:
    """The number of the process that has sent a datagram; None: it is not of our user."""
    for level, kind, data in extra:
        if level == socket.SOL_SOCKET and kind == socket.SCM_CREDENTIALS:
            pid, user, _ = CREDENTIALS.unpack(data[: CREDENTIALS.size])
            return int(pid) if user == os.getuid() else None
    return None


def _address(role: str) -> str:
    """A socket for each ROS master, namespace and role, in a folder that only our user can write.

    In the system's own space, without a folder, anybody could take its name, or fill its queue.
    Raises OSError.
    """
    place = f"{master_place()} {rospy.get_namespace()} {role}"
    name = hashlib.sha256(place.encode()).hexdigest()[:32] + ".socket"
    folder = os.path.join(rospkg.get_ros_home(), "shsa")
    os.makedirs(folder, 0o700, exist_ok=True)
    path = os.path.join(folder, name)
    if len(os.fsencode(path)) > LONGEST_PATH:
        path = f"/proc/self/fd/{os.open(folder, os.O_PATH | os.O_DIRECTORY)}/{name}"
    return path


def _bind(listener: socket.socket, path: str) -> None:
    """Hear what is sent to `path`, in the place of who has ended. Raises OSError."""
    folder = os.stat(os.path.dirname(path))
    if folder.st_uid != os.geteuid() or folder.st_mode & 0o022:
        raise OSError(f"others can write the folder of {path}")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(path)
        except (FileNotFoundError, ConnectionRefusedError):
            if os.path.lexists(path):
                os.unlink(path)
    os.fchmod(listener.fileno(), 0o600)  # the file that `bind` makes has this mode
    listener.bind(path)
