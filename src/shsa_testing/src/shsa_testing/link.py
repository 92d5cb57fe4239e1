"""The links between computers made of namespaces: cut, restored, slow or lossy."""
import itertools
import os
import subprocess
import sys
from pathlib import Path
from typing import Callable, List, Optional, Tuple

import psutil

WIRE = Path(__file__).with_name("wire.py")
BLOCK = "10.199"
"""Each switch takes a free /24 of these addresses."""


class Holder:
    """The first process of new namespaces; they end with it, and it ends with its owner.

    It runs a bash script, which says `ready` and then reads on until its input ends. `kinds` are
    options of `unshare`.
    """

    def __init__(
        self, *kinds: str, script: str = "echo ready; read -r _", words: Tuple[str, ...] = ()
    ) -> None:
        self._command = ["unshare", *kinds, "bash", "-c", script, "shsa_computer", *words]
        self._kinds = [kind for kind in kinds if kind not in ("--fork", "--mount-proc")]
        self._process: Optional["subprocess.Popen[str]"] = None
        self.pid = 0

    def __enter__(self) -> "Holder":
        self.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    def start(self, connect: Optional[Callable[[int], None]] = None) -> None:
        """Start it, and `connect` its process number. Raises OSError if refused."""
        self._process = subprocess.Popen(
            self._command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            start_new_session=True,
            universal_newlines=True,
        )
        assert self._process.stdout is not None and self._process.stderr is not None
        if self._process.stdout.readline() != "ready\n":
            said = self._process.stderr.read().strip()
            self._process.communicate()
            raise OSError(said or f"{' '.join(self._command[:6])} ended")
        children = psutil.Process(self._process.pid).children()
        self.pid = children[0].pid if "--fork" in self._command else self._process.pid
        if connect is not None:
            connect(self.pid)

    def kill(self) -> None:
        """Kill it, and with it all processes of its process namespace."""
        if self._process is None:
            return
        if self.pid:
            _kill(self.pid)
        self.pid = 0
        self._process.kill()
        self._process.communicate()
        self._process = None

    def enter(self) -> List[str]:
        """Return the words before a command that runs inside."""
        return ["nsenter", f"--target={self.pid}", *self._kinds, "--"]

    def ip(self, *words: str) -> None:
        """Run `ip` inside. Raises OSError."""
        call(*self.enter(), "ip", *words)


class Switch:
    """A bridge in a network namespace of its own; `here` is this process's address on it."""

    _numbers = itertools.count(1)

    def __init__(self) -> None:
        self.holder = Holder("--net")
        self._ours = f"shsa{os.getpid()}x{next(self._numbers)}"
        self._count = 1
        self._net = ""

    @property
    def here(self) -> str:
        """The address of this process on it."""
        return f"{self._net}.1"

    def start(self) -> None:
        """Make it, and connect this process. Raises OSError."""
        self.holder.start()
        self.holder.ip("link", "add", "name", "switch", "type", "bridge")
        self.holder.ip("link", "set", "dev", "switch", "up")
        peer = ("type", "veth", "peer", "name", "here", "netns", str(self.holder.pid))
        call("ip", "link", "add", "name", self._ours, *peer)
        self._net = _free_net()
        call("ip", "address", "add", f"{self.here}/24", "dev", self._ours)
        call("ip", "link", "set", "dev", self._ours, "up")
        self.attach("here")

    def stop(self) -> None:
        """Take it away, and the link to this process at once."""
        self.holder.kill()
        subprocess.run(["ip", "link", "delete", self._ours], stderr=subprocess.DEVNULL, check=False)

    def link(self) -> "Link":
        """Return a further link, of a computer that is not connected yet."""
        self._count += 1
        return Link(self, f"{self._net}.{self._count}")

    def attach(self, port: str, bridge: str = "switch") -> None:
        """Make one of its interfaces a port of a bridge in it."""
        self.holder.ip("link", "set", "dev", port, "master", bridge, "up")


class Link:
    """The link of one computer to the switch."""

    def __init__(self, switch: Switch, address: str) -> None:
        self.address = address
        self._switch = switch
        self._number = address.rsplit(".", 1)[1]
        self._port = f"port{self._number}"
        self._inside: List[str] = []
        self._wire: Optional["subprocess.Popen[bytes]"] = None

    def connect(self, pid: int) -> None:
        """Plug it into the computer whose first process that is."""
        self._inside = ["nsenter", f"--target={pid}", "--net", "--"]
        peer = ("type", "veth", "peer", "name", "eth0", "netns", str(pid))
        self._switch.holder.ip("link", "add", "name", self._port, *peer)
        call(*self._inside, "ip", "address", "add", f"{self.address}/24", "dev", "eth0")
        call(*self._inside, "ip", "link", "set", "dev", "eth0", "up")
        self._switch.attach(self._port)

    def disconnect(self) -> None:
        """Unplug it for good: its computer loses the interface."""
        self._end_wire()
        self._switch.holder.ip("link", "delete", "dev", self._port)

    def cut(self) -> None:
        """Pull the cable: neither end is told more than that it is out."""
        self._switch.holder.ip("link", "set", "dev", self._port, "down")

    def restore(self) -> None:
        """Plug the cable in again."""
        self._switch.holder.ip("link", "set", "dev", self._port, "up")

    def impair(self, loss: float = 0.0, delay: float = 0.0) -> None:
        """Lose this part of the packets and delay the others by so many s, each way.

        `tc netem` does it, or `wire` where the kernel has no netem.
        """
        ends = ([*self._switch.holder.enter()], self._port), (self._inside, "eth0")
        netem = ("root", "netem", "loss", f"{100 * loss:g}%", "delay", f"{1e6 * delay:.0f}us")
        self.repair()
        try:
            for inside, interface in ends if loss or delay else ():
                call(*inside, "tc", "qdisc", "replace", "dev", interface, *netem)
        except OSError as error:
            if "kind is unknown" not in str(error):
                raise
            self._start_wire(loss, delay)

    def repair(self) -> None:
        """Take back what `impair` did."""
        if self._wire is not None:
            self._end_wire()
            self._switch.attach(self._port)
        for inside, interface in (
            (self._switch.holder.enter(), self._port),
            (self._inside, "eth0"),
        ):
            command = [*inside, "tc", "qdisc", "delete", "dev", interface, "root"]
            # There may be none, which is an error of tc.
            subprocess.run(command, stderr=subprocess.DEVNULL, check=False)

    def _start_wire(self, loss: float, delay: float) -> None:
        near, far, between = (f"{end}{self._number}" for end in ("near", "far", "between"))
        self._wire = subprocess.Popen(
            [
                *self._switch.holder.enter(),
                sys.executable,
                str(WIRE),
                near,
                far,
                str(loss),
                str(delay),
            ],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        assert self._wire.stdout is not None
        if self._wire.stdout.readline() != b"ready\n":
            raise OSError(f"{WIRE} ended with status {self._wire.wait()}")
        holder = self._switch.holder
        holder.ip("link", "add", "name", between, "type", "bridge")
        holder.ip("link", "set", "dev", between, "up")
        for port, bridge in ((near, between), (far, "switch"), (self._port, between)):
            self._switch.attach(port, bridge)

    def _end_wire(self) -> None:
        if self._wire is not None:
            self._wire.communicate()  # its input ends
            self._wire = None
            self._switch.holder.ip("link", "delete", "dev", f"between{self._number}")


def call(*command: str) -> str:
    """Run a command; what it printed. Raises OSError with what it said."""
    done = subprocess.run(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True
    )
    if done.returncode != 0:
        raise OSError(f"{' '.join(command)}: {done.stdout.strip()}")
    return done.stdout


def _kill(pid: int) -> None:
    try:
        psutil.Process(pid).kill()
    except psutil.NoSuchProcess:
        return


def _free_net() -> str:
    """Return a /24 that no interface here has an address in; where it begins tells owners apart."""
    taken = call("ip", "-4", "address", "show")
    numbers = [1 + (os.getpid() + step) % 254 for step in range(254)]
    return next(
        net for net in (f"{BLOCK}.{number}" for number in numbers) if f" {net}." not in taken
    )
