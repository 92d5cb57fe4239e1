"""Computers made of this machine's namespaces: each with its own address, processes, home and sshd.

They lie on one switch, a bridge in a network namespace of its own, together with this process. All
of it lives only as long as its owner: the kernel takes namespaces away with their last process,
and the first process of each ends when the owner does, `kill -9` included. The temporary folder of
a dead owner is removed at the next start.
"""
import os
import pwd
import re
import secrets
import shutil
import socket
import subprocess
import tempfile
from pathlib import Path
from typing import Dict, Iterator, List, Tuple

import psutil

from shsa_testing.link import Holder, Link, Switch
from shsa_testing.processes import running
from shsa_testing.sshd import find_sshd, write_sshd
from shsa_testing.waiting import wait_until

PROGRAMS = ("ip", "unshare", "nsenter", "mount")
FOLDER = re.compile(r"shsa_computers_(\d+)_")
PATIENCE_S = 20.0
CLEARED = ("ROS_HOSTNAME", "ROS_HOME", "ROS_LOG_DIR", "SSH_AUTH_SOCK")
"""Of our environment: what is of another computer."""
SSH_PORT = 22
# What the first process of a computer does: names, homes and /run of its own; sshd; then it waits
# until its owner ends. bash also takes leave of processes that lost their parents.
FIRST = """set -e
echo "$1" > /proc/sys/kernel/hostname
for file in hosts passwd shadow; do mount --bind "$2/$file" "/etc/$file"; done
mount -t tmpfs tmpfs /run
mkdir -m 755 /run/sshd
ip link set dev lo up
if [ -n "$3" ]; then "$3" -f "$2/sshd_config" -E "$2/sshd.log" < /dev/null > /dev/null; fi
echo ready
read -r _
"""


def refusal(ssh: bool = False) -> str:
    """Return why no computers can be made here, with an sshd each if `ssh`; empty if they can."""
    missing = [name for name in PROGRAMS if shutil.which(name) is None]
    if missing:
        return f"there is no `{missing[0]}` here, which makes the computers' namespaces"
    if ssh and not find_sshd():
        return "there is no sshd here: tools/fetch_sshd fetches one and installs nothing"
    try:
        with Holder("--net", "--mount", "--uts", "--pid", "--fork") as holder:
            holder.ip("link", "add", "name", "switch", "type", "bridge")
            holder.ip("link", "add", "name", "one", "type", "veth", "peer", "name", "two")
    except OSError as error:
        return f"computers made of namespaces are not permitted here, and need root: {error}"
    return ""


class Computer:
    """One computer; `home` is the home of our user there."""

    def __init__(self, name: str, folder: Path, link: Link) -> None:
        self.name = name
        self.address = link.address
        self.folder = folder / name
        self.home = self.folder / "home"
        self.link = link
        self._sshd = ""
        self._holder = Holder()

    def write(self, hosts: str, password: str, sshd: str) -> None:
        """Write the files that make it a computer of its own; `hosts` as in /etc/hosts."""
        self._sshd = sshd
        self.home.mkdir(parents=True)
        (self.folder / "hosts").write_text(f"127.0.0.1 localhost\n{hosts}")
        user = pwd.getpwuid(os.getuid())
        lines = [each for each in Path("/etc/passwd").read_text().splitlines() if each]
        others = [each for each in lines if each.split(":")[0] not in (user.pw_name, "sshd")]
        ours = f"{user.pw_name}:x:{user.pw_uid}:{user.pw_gid}::{self.home}:/bin/bash"
        separated = "sshd:x:65533:65534::/run/sshd:/usr/sbin/nologin"
        (self.folder / "passwd").write_text("\n".join([ours, separated, *others, ""]))
        shadow = self.folder / "shadow"
        shadow.touch(0o600)
        if sshd:
            write_sshd(self.folder, user.pw_name, password)

    def power_on(self) -> None:
        """Start it: its link, its first process and its sshd."""
        kinds = ("--net", "--mount", "--uts", "--pid", "--fork", "--mount-proc")
        self._holder = Holder(*kinds, script=FIRST, words=(self.name, str(self.folder), self._sshd))
        self._holder.start(connect=self.link.connect)

    def power_off(self) -> None:
        """Take its link, then kill all its processes: nobody hears a word of it."""
        if self._holder.pid:
            self.link.disconnect()
            self._holder.kill()

    def words(self, *command: str, **environment: str) -> Tuple[str, ...]:
        """Return the command that runs another one there, in the folder in which we are."""
        given = {"HOME": str(self.home), "ROS_IP": self.address, **environment}
        cleared = [word for name in CLEARED for word in ("-u", name)]
        pairs = [f"{name}={value}" for name, value in given.items()]
        return (*self._holder.enter(), "env", "-C", os.getcwd(), *cleared, *pairs, *command)

    def run(self, *command: str, **environment: str) -> str:
        """Run a command there to its end; what it printed. Raises CalledProcessError."""
        done = subprocess.run(
            self.words(*command, **environment),
            check=True,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            universal_newlines=True,
        )
        return done.stdout

    def processes(self) -> List[psutil.Process]:
        """Its running processes, by their numbers out here."""
        if not self._holder.pid:
            return []
        theirs = _namespace(self._holder.pid)
        return [p for p in psutil.process_iter() if _namespace(p.pid) == theirs and running(p)]


def _namespace(pid: int) -> str:
    try:
        return os.readlink(f"/proc/{pid}/ns/pid")
    except OSError:
        return f"of {pid}, which is gone"


class Computers:
    """`with Computers("raspberry_pi", "notebook") as network:` has these, connected to each other.

    `network.here` is the address of this process on their switch. With `ssh`, an sshd answers at
    each one's port 22, and takes a password at first; `network.asks` is the environment in which
    ssh is told it. Raises OSError where `refusal` says why.
    """

    def __init__(self, *names: str, ssh: bool = False) -> None:
        self._names = names
        self._ssh = ssh

    def __enter__(self) -> "Computers":
        _remove_leftovers()
        self.folder = Path(tempfile.mkdtemp(prefix=f"shsa_computers_{os.getpid()}_"))
        self.folder.chmod(0o755)  # the lower half of an sshd passes through it
        self._switch = Switch()
        try:
            self._start()
        except BaseException:
            self.__exit__()
            raise
        return self

    def _start(self) -> None:
        self._switch.start()
        self.here = self._switch.here
        made = [Computer(name, self.folder, self._switch.link()) for name in self._names]
        self._computers: Dict[str, Computer] = {each.name: each for each in made}
        hosts = "".join(f"{each.address} {each.name}\n" for each in made)
        sshd = find_sshd() if self._ssh else ""
        password = secrets.token_hex(8)
        askpass = self.folder / "askpass"
        askpass.touch(0o700)
        askpass.write_text(f"#!/bin/sh\necho {password}\n")
        # ssh before 8.4 asks a program only where there seems to be a display.
        self.asks = {"SSH_ASKPASS": str(askpass), "SSH_ASKPASS_REQUIRE": "force", "DISPLAY": ":0"}
        for computer in made:
            computer.write(hosts, password, sshd)
            computer.power_on()
        if self._ssh:
            up = lambda: all(_answers(each.address) for each in made)
            wait_until(up, PATIENCE_S, "each sshd answers")

    def __exit__(self, *_: object) -> None:
        for computer in getattr(self, "_computers", {}).values():
            computer.power_off()
        self._switch.stop()
        shutil.rmtree(str(self.folder), ignore_errors=True)

    def __getitem__(self, name: str) -> Computer:
        return self._computers[name]

    def __iter__(self) -> Iterator[Computer]:
        return iter(self._computers.values())


def _answers(address: str) -> bool:
    try:
        with socket.create_connection((address, SSH_PORT), 1.0) as connection:
            return connection.recv(4) == b"SSH-"
    except OSError:
        return False


def _remove_leftovers() -> None:
    """Remove the folders of owners that ended without doing so."""
    for folder in Path(tempfile.gettempdir()).iterdir():
        owner = FOLDER.match(folder.name)
        if owner and folder.is_dir() and not psutil.pid_exists(int(owner.group(1))):
            shutil.rmtree(str(folder), ignore_errors=True)
