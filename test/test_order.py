"""The order of the tests, in conftest.py at the top: it names what there is."""
import os
import shutil
import subprocess
import sys
from pathlib import Path

import conftest
from rostests import SELDOM

ROOT = Path(__file__).resolve().parent.parent
TEST = """
import os
def test_it():
    with open("ran", "a") as ran:
        print(__name__, os.environ["PYTEST_XDIST_WORKER"], os.sched_getscheduler(0), file=ran)
"""


WAITS = "# wait_until"
CASES = """
import pytest
@pytest.mark.parametrize("name", ["takeover", "gate"])
def test_case(name):
    test_it()
"""


def test_the_files_that_have_their_turn_are_there() -> None:
    files = {path.stem for folder in ("src", "test") for path in (ROOT / folder).rglob("test_*.py")}
    assert {*conftest.COMPUTING, *conftest.ROBOTS} <= files
    assert {*conftest.ALONE} <= {*conftest.ROBOTS}


def test_the_rostests_to_begin_with_are_there() -> None:
    assert {*conftest.LONGEST} <= {path.stem for path in ROOT.glob("*/*/test/rostest/*.test")}


def test_what_is_tried_seldom_has_others_that_stand_for_it() -> None:
    tests = {path.name for path in ROOT.glob("*/*/test/*/*")}
    assert {f"{name}.test" for name in SELDOM} | {*SELDOM.values()} <= tests
    assert {Path(name).stem for name in SELDOM.values()}.isdisjoint(SELDOM)


def test_the_robots_that_have_the_machine_alone_are_there() -> None:
    rostests = {path.stem for path in ROOT.glob("*/*/test/rostest/*.test")}
    assert {*conftest.PRECISE} <= {*rostests, *conftest.ROBOTS, "failover"}


def test_the_last_worker_gives_way_and_only_computes(tmp_path: Path) -> None:
    shutil.copy(str(ROOT / "conftest.py"), str(tmp_path))
    names = (*conftest.ROBOTS, *conftest.COMPUTING[:3], "test_one", "test_other")
    for name in names:
        more = {"test_one": WAITS, "test_rostests": CASES}.get(name, "")
        (tmp_path / f"{name}.py").write_text(TEST + more)
    command = [sys.executable, "-m", "pytest", "-n", "3", "-p", "no:cacheprovider", "."]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    done = subprocess.run(command, cwd=tmp_path, env=environment, stdout=subprocess.PIPE)
    assert done.returncode == 0, done.stdout.decode()
    ran = [line.split() for line in (tmp_path / "ran").read_text().splitlines()]
    assert {name for name, _, _ in ran} == {*names} and len(ran) == len(names) + 2
    last = [name for name, worker, _ in ran if worker == "gw2"]
    assert last and {*last} <= {*conftest.COMPUTING, "test_other"}
    for _, worker, policy in ran:
        idle = int(policy) == os.SCHED_IDLE
        assert idle or worker != "gw2"
