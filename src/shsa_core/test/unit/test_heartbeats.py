"""Signs of life between processes: who sends them, who hears them, and who hangs."""
import builtins
import errno
import os
import signal
import socket
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Iterator, List, Optional, Set, Tuple

import psutil
import pytest
import rospy

from shsa_core.ros import settings
from shsa_core.ros.processes import heartbeats, kernel
from shsa_core.ros.processes.heartbeats import CUT_OFF, Heart, Sign, Signs
from shsa_core.ros.processes.kernel import NOBODY, ended, gone, identity
from shsa_core.ros.processes.watching import Life
from shsa_core.ros.trust import places
from shsa_core.ros.workers import Workers
from shsa_testing.waiting import wait_until

BEAT = """
import sys, time, rospy
from shsa_core.ros.processes.heartbeats import Heart
rospy.get_name = lambda: "/substitute_a_1"
heart = Heart(sys.argv[1])
while True:
    heart.beat()
    time.sleep(0.02)
"""


@pytest.fixture
def role(monkeypatch: pytest.MonkeyPatch, home: Path) -> str:
    monkeypatch.setattr(rospy, "get_namespace", lambda: "/")
    monkeypatch.setattr(rospy, "get_name", lambda: "/test")
    return f"test {os.getpid()} {time.monotonic()}"


@pytest.fixture
def beating(role: str) -> "Iterator[subprocess.Popen[bytes]]":
    process = subprocess.Popen([sys.executable, "-c", BEAT, role])
    yield process
    process.kill()
    process.wait()


def test_it_is_known_whether_anybody_hears(role: str) -> None:
    heart = Heart(role)
    assert not heart.beat(at_once=True)
    signs = Signs(role)
    assert list(signs.last) == [] and heart.beat(at_once=True)


def test_a_container_with_our_home_takes_no_heartbeats_of_ours(
    role: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Each calls its master localhost."""
    heart, ours = Heart(role), Signs(role)
    (tmp_path / "net").symlink_to("net:[7]")
    monkeypatch.setattr(places, "NAMESPACES", str(tmp_path))
    theirs = Signs(role)
    assert heart.beat(at_once=True)
    wait_until(lambda: list(ours.last) == ["/test"], 10.0, "we hear it")
    assert not theirs.last and Heart(role).beat(at_once=True)
    wait_until(lambda: list(theirs.last) == ["/test"], 10.0, "they hear theirs")


def test_a_computer_that_tells_no_boot_has_no_heartbeats(
    role: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(places, "BOOT_ID", str(tmp_path / "none"))
    Signs(role)
    assert not Heart(role).beat(at_once=True)


def test_a_sign_of_life_comes_with_its_process(
    role: str, beating: "subprocess.Popen[bytes]"
) -> None:
    signs = Signs(role)
    wait_until(lambda: signs.last.get("/substitute_a_1"), 10.0, "a heartbeat")
    sign = signs.last.get("/substitute_a_1")
    assert sign is not None and sign.pid == beating.pid
    assert list(signs.last) == ["/substitute_a_1"]


def test_only_its_hearer_can_answer_a_heartbeat_also_after_that_began_anew(role: str) -> None:
    """Anybody can see the address of a socket in the system's space."""
    heart = Heart(role)
    for cut_off in (True, False):
        signs = Signs(role, lambda: CUT_OFF if cut_off else b"7")

        def told() -> bool:
            heart.beat(at_once=True)
            cut = heart.cut_off or heart.answer != b"7"
            return signs.last.get("/test") is not None and cut is cut_off

        wait_until(told, 10.0, "its hearer answers")
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as stranger:
            with pytest.raises(PermissionError):
                stranger.sendto(CUT_OFF, heart._socket.getsockname())


def test_who_is_stopped_hangs_and_another_is_heard(
    role: str, beating: "subprocess.Popen[bytes]"
) -> None:
    told: List[bool] = []
    signs = Signs(role)
    Life(
        signs,
        lambda name: name.startswith("/substitute_"),
        lambda event: told.append(event.heard),
        patience=300,
    )
    wait_until(lambda: told == [True], 10.0, "its first heartbeat is told")
    beating.send_signal(signal.SIGSTOP)
    wait_until(lambda: told[1:] == [False], 10.0, "it hangs")
    beating.send_signal(signal.SIGCONT)
    wait_until(lambda: told[2:] == [True], 10.0, "it is heard")


def test_who_is_slow_to_give_a_sign_lives(role: str) -> None:
    """As one of low priority on a busy computer."""
    told: List[bool] = []
    signs = Signs(role)
    Life(signs, lambda name: True, lambda event: told.append(event.heard), patience=30)
    slow = BEAT.replace("0.02", "1.0")
    process = subprocess.Popen([sys.executable, "-c", slow, role])
    heard: Set[Optional[Sign]] = set()

    def three() -> bool:
        heard.add(signs.last.get("/substitute_a_1"))
        return len(heard - {None}) == 3

    try:
        wait_until(three, 20.0, "three heartbeats")
    finally:
        process.kill()
        process.wait()
    assert told == [True]


STARVES = """
import hashlib, os, sys, threading, time, rospy
from shsa_core.ros.processes.heartbeats import Heart
rospy.get_name = lambda: "/substitute_a_1"
Heart(sys.argv[1]).beat()
os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
work = lambda: hashlib.pbkdf2_hmac("sha256", b"", b"", 10**9)
for _ in range(5):
    threading.Thread(target=work, daemon=True).start()
time.sleep(600.0)
"""


def test_who_waits_for_the_processor_does_not_hang_before_long(role: str) -> None:
    """Five threads share a core, so that there is always one that waits for it."""
    told: List[Tuple[bool, float]] = []
    tell = lambda event: told.append((event.heard, time.monotonic()))
    Life(Signs(role), lambda name: True, tell, 3)
    process = subprocess.Popen([sys.executable, "-c", STARVES, role])
    try:
        hung = lambda: told and told[-1][0] is False
        wait_until(hung, 30.0, "it counts as one that hangs")
    finally:
        process.kill()
        process.wait()
    assert told[0][0] is True and told[-1][1] - told[0][1] > 1.5


def test_who_is_heard_by_nobody_knows_it(role: str) -> None:
    heart = Heart(role)
    heart.beat()
    wait_until(lambda: heart.unheard > 0.1, 5.0, "time passes")
    Signs(role)

    def heard() -> bool:
        heart.beat()
        return heart.unheard < 0.05

    wait_until(heard, 5.0, "somebody hears it")


def test_who_is_heard_is_told_whether_the_reconfigurator_is_in_reach(
    role: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    away = [True]
    heart = Heart(role)

    def told(cut_off: bool) -> bool:
        heart.beat()
        return heart.cut_off is cut_off

    heart.beat()
    assert not heart.cut_off  # nobody says so
    signs = Signs(role, lambda: CUT_OFF if away[0] else b"7")
    wait_until(lambda: told(True), 5.0, "it is cut off")
    away[0] = False
    wait_until(lambda: told(False), 5.0, "it is in reach")
    away[0] = True
    wait_until(lambda: told(True), 5.0, "it is cut off again")
    monkeypatch.setattr(settings, "CALL_S", 0.0)
    assert not heart.cut_off and signs.last.get("/test")  # an answer does not hold for ever


def test_who_hears_goes_on_after_an_error(role: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    failures = [RuntimeError("no memory")]

    def answer() -> bytes:
        if failures:
            raise failures.pop()
        return b"7"

    heart, _ = Heart(role), Signs(role, answer)

    def told() -> bool:
        heart.beat(at_once=True)
        return heart.answer == b"7"

    wait_until(told, 10.0, "it is answered again")


def test_the_one_that_came_last_hears(role: str) -> None:
    first, second = Signs(role), Signs(role)
    Heart(role).beat()
    wait_until(lambda: second.last.get("/test"), 5.0, "a heartbeat")
    assert first.last.get("/test") is None


@pytest.mark.parametrize("processors", (0, 100_000))
def test_a_computer_is_crowded_by_the_processors_that_are_ours(
    monkeypatch: pytest.MonkeyPatch, processors: int
) -> None:
    """As in a container that has some of them."""
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: set(range(processors)))
    monkeypatch.setattr(os, "cpu_count", lambda: 100_000 - processors)
    assert kernel.crowded() is not bool(processors)


def test_a_process_is_known_by_its_start_as_well() -> None:
    known = identity(os.getpid())
    assert not ended(known) and ended((known[0], known[1] + 1.0))
    assert ended(NOBODY) and identity(0) == NOBODY


def test_nobody_is_dead_because_there_is_no_descriptor_to_look(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    known, process = identity(os.getpid()), psutil.Process()

    def refuse(*_: object, **__: object) -> int:
        raise OSError(errno.EMFILE, "Too many open files")

    monkeypatch.setattr(builtins, "open", refuse)
    assert not ended(known) and not gone(process)


STRANGER = """
import glob, os, socket, sys
os.setgid(65534); os.setuid(65534)
refused = 0
for path in glob.glob(sys.argv[1] + "/shsa/*.socket") or sys.argv[2:]:
    try:
        socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM).sendto(b"x", path)
    except PermissionError:
        refused += 1
sys.exit(refused != 1)
"""


@pytest.fixture
def home(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    with tempfile.TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        monkeypatch.setenv("ROS_HOME", folder)
        yield Path(folder)


@pytest.mark.skipif(os.geteuid() != 0, reason="nobody but root can be somebody else")
@pytest.mark.parametrize("mode", (0o700, 0o755))
def test_nobody_else_can_fill_the_queue(role: str, home: Path, mode: int) -> None:
    (home / "shsa").mkdir()
    (home / "shsa").chmod(mode)
    signs = Signs(role)
    (path,) = (home / "shsa").glob("*.socket")
    assert path.stat().st_mode & 0o777 == 0o600
    done = subprocess.run([sys.executable, "-c", STRANGER, str(home), str(path)], check=False)
    assert done.returncode == 0
    Heart(role).beat()
    wait_until(lambda: signs.last.get("/test"), 5.0, "our own is heard")


def test_a_folder_that_others_can_write_is_not_used(role: str, home: Path) -> None:
    (home / "shsa").mkdir()
    (home / "shsa").chmod(0o777)
    Signs(role)
    assert not list((home / "shsa").iterdir())


def test_what_an_ended_one_has_left_is_replaced_and_a_path_may_be_long(
    role: str, home: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_HOME", str(home / ("x" * 150)))
    code = """
import os, sys, rospy
from shsa_core.ros.processes.heartbeats import Signs
rospy.get_namespace = lambda: "/"
Signs(sys.argv[1])
os._exit(0)
"""
    subprocess.run([sys.executable, "-c", code, role], check=True)
    assert len(list(home.glob("*/shsa/*.socket"))) == 1
    signs = Signs(role)
    Heart(role).beat()
    wait_until(lambda: signs.last.get("/test"), 5.0, "a heartbeat")


def test_who_is_heard_registers_once_with_a_master_that_was_started_anew(
    role: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    heart, answers, registered = Heart(role, Workers("test")), [b""], []
    monkeypatch.setattr(heartbeats, "register_again", lambda: registered.append(answers[-1]))
    Signs(role, lambda: answers[-1])

    def answered() -> bool:
        heart.beat(at_once=True)
        return heart.answer == answers[-1]

    for answer in (b"7", CUT_OFF, b"7", b"8", CUT_OFF, b"8", b"9"):
        answers.append(answer)
        wait_until(answered, 5.0, "it is answered")
    wait_until(lambda: len(registered) == 2, 5.0, "it has registered with both")
    assert registered[-1] == b"9"


def test_a_heart_that_is_made_on_the_way_to_a_message_needs_no_thread(
    role: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("threading.Thread.start", lambda _: pytest.fail("a thread is started"))
    assert not Heart(role).beat(at_once=True)
