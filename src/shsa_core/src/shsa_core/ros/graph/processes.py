"""The substitutes' processes, each started by rosrun."""
import itertools
import os
import signal
import subprocess
import threading
from typing import Callable, Dict, Sequence, Set

from roslib.packages import find_node, get_pkg_dir

from shsa_core.errors import ShsaError
from shsa_core.healing.events import StartSubstitute
from shsa_core.substitution import signals

PACKAGE = "shsa_core"
STOP_TIMEOUT_S = 2.0


class Processes:
    """Starts and stops substitutes.

    `ended(node, detail)` is called, in a thread of its own, whenever a process has ended that
    nobody stopped; `cleared(node)` after each end, to clear what the node left registered.
    `journals`: what the paths of the substitutes' journals begin with; empty: they keep none. Who
    comes later takes the path of one that has ended, so that there are never many.
    """

    def __init__(
        self,
        ended: Callable[[str, str], None],
        cleared: Callable[[str], None],
        journals: str,
    ) -> None:
        self._ended = ended
        self._cleared = cleared
        self._journals = journals
        self._slots: Dict[str, int] = {}
        self._running: Dict[str, "subprocess.Popen[bytes]"] = {}
        self._stopped: Set[str] = set()
        self._lock = threading.Lock()
        self._executables = {name: _path(name) for name in ("substitute", "standby")}

    def start(self, command: StartSubstitute) -> None:
        """Start a muted substitute, idle without a program.

        Raises OSError if the process cannot be made.
        """
        node, program = command.node, command.program
        namespace, name = node.rsplit("/", 1)
        environment = dict(os.environ, ROS_NAMESPACE=namespace or "/")
        words = ["rosrun", PACKAGE, self._executables["standby"]]
        if program is not None:
            strings = (",".join(program.inputs), program.code, ",".join(program.outputs))
            words = ["rosrun", PACKAGE, self._executables["substitute"], *strings]
            environment[signals.VARIABLE] = signals.encode(command.inputs, command.outputs)
        slot = self._free_slot()
        if self._journals:
            environment[signals.JOURNAL] = f"{self._journals}{slot}.journal"
        words.append(f"__name:={name}")
        process = subprocess.Popen(
            words, env=environment, stdin=subprocess.DEVNULL, start_new_session=True
        )
        with self._lock:
            self._running[node] = process
            self._slots[node] = slot
        threading.Thread(target=self._wait, args=(node, process), daemon=True).start()

    def _free_slot(self) -> int:
        """The smallest number that no running process has."""
        with self._lock:
            taken = set(self._slots.values())
        return next(number for number in itertools.count(1) if number not in taken)

    def stop(self, node: str) -> None:
        """Ask a substitute to leave, kill it if it does not, and wait until it is gone."""
        with self._lock:
            process = self._running.get(node)
            self._stopped.add(node)
        if process is not None:
            end(process)

    def _wait(self, node: str, process: "subprocess.Popen[bytes]") -> None:
        status = process.wait()
        with self._lock:
            del self._running[node], self._slots[node]
            planned = node in self._stopped
            self._stopped.discard(node)
        self._cleared(node)
        if not planned:
            self._ended(node, f"exit status {status}")


def _path(executable: str) -> str:
    """An executable of this package as a path in it.

    rosrun takes twice as long where it has to look for a name.

    Raises ShsaError if it is not built.
    """
    found = find_node(PACKAGE, executable)
    if not found:
        raise ShsaError(f"{PACKAGE} has no executable {executable}; is the workspace built?")
    return os.path.relpath(found[0], get_pkg_dir(PACKAGE))


def run_command(words: Sequence[str], ended: Callable[[str], None]) -> None:
    """Run a program, given as a list and through no shell.

    `ended(detail)` is called when it has ended, in a thread.
    """

    def work() -> None:
        try:
            process = subprocess.Popen(words, stdin=subprocess.DEVNULL, start_new_session=True)
        except OSError as error:
            ended(str(error))
            return
        ended(f"exit status {process.wait()}")

    threading.Thread(target=work, daemon=True).start()


def end(process: "subprocess.Popen[bytes]") -> None:
    """End a process and all that it started."""
    for number in (signal.SIGINT, signal.SIGKILL):
        try:
            os.killpg(process.pid, number)
            process.wait(STOP_TIMEOUT_S)
            return
        except ProcessLookupError:
            return
        except subprocess.TimeoutExpired:
            continue
