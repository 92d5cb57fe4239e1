"""Computers made of namespaces come and go, and the rover runs and heals on three of them."""
import json
import os
import socket
import stat
import struct
import subprocess
import sys
import time
from pathlib import Path
from typing import List, Tuple

import psutil
import pytest

from shsa_testing.computers import Computer, Computers, refusal
from shsa_testing.thorough import LONG
from shsa_testing.waiting import wait_until

SETUP = Path(__file__).resolve().parent.parent / "tools" / "hosts_setup"
ROVER = Path(__file__).resolve().parent / "hosts_rover.py"
PATIENCE_S = 30.0
ROVER_TIMEOUT_S = 150.0
OWNER = """
import sys
from shsa_testing.computers import Computers
with Computers("left") as network:
    print(network.folder, *[each.pid for each in network["left"].processes()], flush=True)
    sys.stdin.read()
"""
SENDER = """
import socket, struct, sys, time
from contextlib import suppress
out = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
for number in range(1000000):
    with suppress(OSError):  # the link is down
        out.sendto(struct.pack("!Id", number, time.monotonic()), (sys.argv[1], int(sys.argv[2])))
    time.sleep(0.005)
"""


@pytest.fixture(autouse=True)
def permitted() -> None:
    if refusal():
        pytest.skip(refusal())


def interfaces() -> List[str]:
    """Our own, of switches."""
    return [name for name in psutil.net_if_addrs() if name.startswith(f"shsa{os.getpid()}x")]


def test_they_reach_each_other_see_only_their_own_processes_and_leave_nothing() -> None:
    with Computers("one", "two") as network:
        one, two = network["one"], network["two"]
        assert one.run("hostname") == "one\n"
        assert one.run("getent", "hosts", "two").split() == [two.address, "two"]
        assert str(one.home) in one.run("sh", "-c", "echo ~")
        inside = one.run("sh", "-c", "ls -d /proc/[0-9]*").split()
        assert len(inside) < 5
        processes = one.processes()
        assert processes and interfaces()
        folder = network.folder
    assert not folder.exists() and not interfaces()
    wait_until(lambda: not any(p.is_running() for p in processes), PATIENCE_S, "all have ended")


def test_a_killed_owner_leaves_nothing_that_the_next_one_does_not_remove() -> None:
    owner = subprocess.Popen(
        [sys.executable, "-c", OWNER],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        universal_newlines=True,
    )
    assert owner.stdout is not None
    folder, *pids = owner.stdout.readline().split()
    assert pids
    owner.kill()
    owner.communicate()
    gone = lambda: not any(psutil.pid_exists(int(pid)) for pid in pids)
    wait_until(gone, PATIENCE_S, "its processes have ended")
    left = lambda: [n for n in psutil.net_if_addrs() if n.startswith(f"shsa{owner.pid}x")]
    wait_until(lambda: not left(), PATIENCE_S, "its interfaces are gone")
    assert Path(folder).exists()
    with Computers("next"):
        assert not Path(folder).exists()


class Stream:
    """Numbered packets from a computer, with the time of their departure."""

    def __init__(self, network: Computers, computer: Computer) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((network.here, 0))
        port = self._socket.getsockname()[1]
        words = computer.words(sys.executable, "-c", SENDER, network.here, str(port))
        self._sender = subprocess.Popen(words)

    def close(self) -> None:
        self._socket.close()
        self._sender.kill()
        self._sender.wait()

    def next(self, seconds: float) -> Tuple[int, float]:
        """Return the next packet: its number, and how long it took in s. Raises socket.timeout."""
        self._socket.settimeout(seconds)
        number, sent = struct.unpack("!Id", self._socket.recv(100))
        return int(number), time.monotonic() - sent

    def drain(self) -> None:
        """Take what has arrived already."""
        self._socket.setblocking(False)
        try:
            while True:
                self._socket.recv(100)
        except BlockingIOError:
            return


def test_a_link_is_cut_restored_slowed_and_made_lossy() -> None:
    with Computers("far") as network:
        far = network["far"]
        stream = Stream(network, far)
        stream.next(PATIENCE_S)
        far.link.cut()
        stream.drain()
        with pytest.raises(socket.timeout):
            stream.next(0.3)
        far.link.restore()
        stream.next(PATIENCE_S)
        far.link.impair(loss=0.3, delay=0.05)
        stream.drain()
        wait_until(lambda: stream.next(PATIENCE_S)[1] >= 0.05, PATIENCE_S, "a slow packet")
        packets = [stream.next(PATIENCE_S) for _ in range(150)]
        assert min(took for _, took in packets) >= 0.05
        # 0.3 of some 214, by more than four standard deviations.
        lost = packets[-1][0] - packets[0][0] + 1 - len(packets)
        assert 30 < lost < 120
        far.link.repair()
        stream.drain()
        wait_until(lambda: stream.next(PATIENCE_S)[1] < 0.05, PATIENCE_S, "a fast packet")
        far.power_off()
        assert far.processes() == []
        stream.drain()
        with pytest.raises(socket.timeout):
            stream.next(0.3)
        far.power_on()
        assert far.run("hostname") == "far\n"
        stream.close()


def test_computers_are_prepared_step_by_step_and_again() -> None:
    if refusal(ssh=True):
        pytest.skip(refusal(ssh=True))
    with Computers("here", "there", ssh=True) as network:

        def prepare(*words: str) -> Tuple[int, str]:
            """Return the status of hosts_setup, and what it said."""
            command = network["here"].words(str(SETUP), "--accept", *words, **network.asks)
            done = subprocess.run(
                command, stdout=subprocess.PIPE, universal_newlines=True, timeout=ROVER_TIMEOUT_S
            )
            return done.returncode, done.stdout

        status, said = prepare("there", "nowhere", "--setup", "/nowhere/setup.bash")
        assert status == 1
        assert "[there] copied our key" in said
        assert "[there] NOT READY: no workspace: /nowhere/setup.bash" in said
        assert "[nowhere] NOT READY: no sshd with an ed25519 key answers" in said
        status, said = prepare("there")
        assert status == 0, said
        assert "our key opens it" in said and "secret of healing is copied" in said
        assert "its clock is ahead of ours by" in said
        secrets = [each.home / ".ros" / "shsa" / "secret" for each in network]
        assert len({file.read_bytes() for file in secrets}) == 1
        assert [stat.S_IMODE(file.stat().st_mode) for file in secrets] == [0o600, 0o600]
        told = network["there"].run(str(network["there"].home / ".ros" / "shsa_env"), "env")
        assert f"ROS_IP={network['there'].address}\n" in told
        assert f"ROS_MASTER_URI=http://{network['here'].address}:11311\n" in told
        secrets[1].write_bytes(b"another")
        status, said = prepare("there")
        assert status == 0 and "secret of healing is copied" in said
        assert secrets[1].read_bytes() == secrets[0].read_bytes()


@pytest.mark.skipif(not LONG, reason="make test-long: the tutorial of the three has it healed, too")
def test_the_rover_runs_and_heals_on_three_computers() -> None:
    if refusal(ssh=True):
        pytest.skip(refusal(ssh=True))
    done = subprocess.run(
        [sys.executable, str(ROVER)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
        timeout=ROVER_TIMEOUT_S,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    found = json.loads(done.stdout.splitlines()[-1])
    assert found["where"] == {
        "/battery_current": "raspberry_pi",
        "/imu/data": "raspberry_pi",
        "/odom": "mainboard",
        "/battery_voltage": "mainboard",
        "/battery_state": "mainboard",
        "/cmd_vel": "notebook",
    }
    assert found["state"] == "healed", found
    assert [name.startswith("/substitute") for name in found["publishers"]] == [True], found
    assert found["gap"] < 1.0, found
