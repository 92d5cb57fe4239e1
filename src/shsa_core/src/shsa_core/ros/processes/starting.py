"""The substitutes' processes: forked from a prepared one or started by rosrun, confined, found."""
import json
import os
import resource
import shutil
import signal
import socket
import subprocess
import threading
import time
from contextlib import suppress
from typing import Callable, Dict, List, Mapping, NamedTuple, Optional, Sequence

import psutil
import rospy
from roslib.packages import find_node
from rospkg import RosPack

from shsa_core.errors import ShsaError
from shsa_core.healing.events import StartSubstitute
from shsa_core.ros import settings
from shsa_core.ros.processes import kernel
from shsa_core.ros.processes.children import Children, Started
from shsa_core.ros.processes.heartbeats import HOST
from shsa_core.ros.processes.kernel import NAME, robot_processes
from shsa_core.ros.processes.prepared import LARGEST_ORDER_B, OPTION, SPACE, VARIABLES
from shsa_core.ros.trust import secret
from shsa_core.substitution import signals

PACKAGE = "shsa_core"
LIMITS = {
    "core": (resource.RLIMIT_CORE, 0),
    "data": (resource.RLIMIT_DATA, 8 * 1024**3),
    "nofile": (resource.RLIMIT_NOFILE, 16384),
}
"""Of a process; in bytes, and open files: the stacks of as many threads take all of the data."""
INHERITED = ("CMAKE_PREFIX_PATH", "LD_LIBRARY_PATH", "PATH", "PYTHON", "ROS", "SHSA_")
OF_USER = ("HOME", "LANG", "LC_", "LOGNAME", "TMPDIR", "TZ", "USER")
"""Of our environment a substitute inherits nothing but what begins with one of these."""


class Setup(NamedTuple):
    """The way to start substitutes, whose names begin with `prefix`.

    `secret_file`: by which they know their reconfigurator. `journals`: what the paths of their
    journals begin with; empty: they keep none. `sandbox`: a command to run each of them in. `host`:
    the name of the agent that we are part of; empty: of none. `forks`: without a sandbox they are
    forked from a prepared process, which has loaded the message `types`; `ready` is called, in a
    thread, whenever one is there. `restarts`: nodes may be started again.
    """

    prefix: str
    secret_file: str = ""
    journals: str = ""
    sandbox: Sequence[str] = ()
    host: str = ""
    forks: bool = False
    types: Sequence[str] = ()
    restarts: bool = True
    ready: Callable[[], object] = lambda: None


class Substitutes:
    """Starts and stops substitutes.

    `ended(node, detail)` is called whenever a process has ended that nobody stopped;
    `cleared(node)` after each end, to clear what the node left registered. Neither may wait.
    `forking`: the prepared process; None: nothing is forked.
    """

    def __init__(
        self, ended: Callable[[str, str], None], cleared: Callable[[str], object], setup: Setup
    ) -> None:
        self._ended, self._cleared = ended, cleared
        self._setup = setup
        self._slots: Dict[str, int] = {}  # numbers of journals: there are never many
        self.children = Children(self._over)
        packages = RosPack()
        found = {name: find_node(PACKAGE, name, packages) for name in ("substitute", "standby")}
        if not all(found.values()):
            raise ShsaError(f"{PACKAGE} lacks {' or '.join(found)}; is the workspace built?")
        self._files = {os.path.realpath(path) for paths in found.values() for path in paths}
        self._paths = {name: each[0] for name, each in found.items()}
        folder, limits = packages.get_path(PACKAGE), wrapper(setup.sandbox)
        # As paths in the package: rosrun takes twice as long where it has to look for a name.
        self._rosrun = {
            name: [*limits, "rosrun", PACKAGE, os.path.relpath(path, folder)]
            for name, path in self._paths.items()
        }
        inherits = (each for each in os.environ.items() if each[0].startswith(INHERITED + OF_USER))
        self._variables = {
            **dict(inherits),
            "ROS_NAMESPACE": setup.prefix.rsplit("/", 1)[0] or "/",
            secret.VARIABLE: setup.secret_file,
            HOST: setup.host,
        }
        self.forking: Optional[Forking] = None
        if setup.forks and not setup.sandbox:
            run = [*limits, self._paths["substitute"]]
            self.forking = Forking(run, self._variables, setup)

    def start(self, command: StartSubstitute) -> None:
        """Start a muted substitute, idle without a program. Raises OSError."""
        node, program = command.node, command.program
        executable, words = "standby", [NAME + node.rsplit("/", 1)[1]]
        own: Dict[str, str] = {}
        if command.shared:
            words.insert(0, signals.SHARED)
        if program is not None:
            strings = (",".join(program.inputs), program.code, ",".join(program.outputs))
            executable, words = "substitute", [*strings, *words]
            own[signals.VARIABLE] = signals.encode(command.inputs, command.outputs)
        slot = self._free_slot()
        if self._setup.journals:
            own[signals.JOURNAL] = f"{self._setup.journals}{slot}.journal"
        process: Optional[psutil.Process] = None
        if self.forking is not None:
            process = self.forking.start([self._paths[executable], *words], own)
        if process is None:
            process = Started([*self._rosrun[executable], *words], env={**self._variables, **own})
        self._keep(node, process, slot)

    def take_up(self) -> List[str]:
        """Make ours the substitutes of this master and agent that run, registered or not."""
        taken: List[str] = []
        for each in robot_processes():
            here = each.variables.get(HOST, "") == self._setup.host
            ours = any(os.path.realpath(word) in self._files for word in each.words[:2])
            named = each.node.startswith(self._setup.prefix)
            if here and ours and named and self.children.process(each.node) is None:
                self._keep(each.node, each.process, self._free_slot())
                taken.append(each.node)
        return taken

    def _keep(self, node: str, process: psutil.Process, slot: int) -> None:
        self._slots[node] = slot
        self.children.keep(node, process)

    def _over(self, node: str, how: str) -> None:
        if self._slots.pop(node, None) is None:
            return  # it is a node that was started again
        if how:
            self._ended(node, how)
        self._cleared(node)

    def _free_slot(self) -> int:
        return min(set(range(1, len(self._slots) + 2)).difference(self._slots.values()))


def wrapper(sandbox: Sequence[str]) -> List[str]:
    """Return what confines a command. Raises ShsaError if there is no such program."""
    if sandbox and shutil.which(sandbox[0]) is None:
        raise ShsaError(f"there is no program {sandbox[0]} to run the substitutes in")
    limits = []
    for name, (number, limit) in LIMITS.items():
        hard = resource.getrlimit(number)[1]  # which nobody may raise
        limits.append(f"--{name}={limit if hard == resource.RLIM_INFINITY else min(limit, hard)}")
    return ["prlimit", *limits, "setpriv", "--no-new-privs", *sandbox]


LONGEST_ANSWER_B = 100


class Forking:
    """Keeps a prepared process, by a command and an environment, in a thread; it ends with ours."""

    def __init__(self, words: Sequence[str], variables: Mapping[str, str], setup: Setup) -> None:
        self._words = [*words, OPTION, " " * SPACE, *setup.types]
        self._variables = {**variables, **VARIABLES}
        self._ready = setup.ready
        self._lock = threading.Lock()
        self._process: Optional["subprocess.Popen[bytes]"] = None
        self._line: Optional[socket.socket] = None  # to a process that is ready
        self._thread = threading.Thread(target=self._keep, name="prepared process", daemon=True)
        self._thread.start()

    def start(self, words: List[str], variables: Mapping[str, str]) -> Optional[psutil.Process]:
        """Fork a process with a command line and `variables`; None: that cannot be done now."""
        order = json.dumps({"words": words, "variables": variables}).encode()
        with self._lock:
            line, process = self._line, self._process
            if line is None or process is None or len(order) > LARGEST_ORDER_B:
                return None
            try:
                if kernel.stopped(process.pid):
                    raise BlockingIOError("the prepared process is stopped")
                line.settimeout(settings.PATIENCE_S)
                line.send(order, socket.MSG_DONTWAIT)
                pid = int(line.recv(LONGEST_ANSWER_B) or b"0")
            except OSError as error:
                rospy.logwarn("%s could not be forked: %r", words[-1], error)
                self._line, pid = None, 0
                process.kill()
                with suppress(OSError):  # a fork of the last moment is ours; later none begins
                    line.shutdown(socket.SHUT_RDWR)
                    pid = int(line.recv(LONGEST_ANSWER_B) or b"0")
        try:
            return psutil.Process(pid) if pid else None
        except psutil.NoSuchProcess:
            return None  # it has ended already
        except OSError:
            os.kill(pid, signal.SIGKILL)  # nobody could look after it: there is no descriptor left
            raise

    def _keep(self) -> None:
        pause = settings.FIRST_PAUSE_S
        while not rospy.is_shutdown():
            began, why = time.monotonic(), "it has ended"
            try:
                self._serve()
            except Exception as error:  # whatever it is, the next one may do
                why = str(error)
            if time.monotonic() > began + settings.LONGEST_PAUSE_S:
                pause = settings.FIRST_PAUSE_S
            if not rospy.is_shutdown():
                text = "No prepared process: %s. Substitutes are started by rosrun; again in %g s."
                rospy.logwarn(text, why, pause)
                time.sleep(pause)
            pause = min(2 * pause, settings.LONGEST_PAUSE_S)

    def _serve(self) -> None:
        ours, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        ours.settimeout(None)  # rospy gives every socket a minute
        with ours:
            with its:
                process = subprocess.Popen(
                    self._words, env=self._variables, stdin=its.fileno(), start_new_session=True
                )
            self._process = process
            try:
                if ours.recv(LONGEST_ANSWER_B):
                    with self._lock:
                        self._line = ours
                    self._ready()
                    process.wait()
            finally:
                with self._lock:
                    self._line = None
                process.kill()
                process.wait()
