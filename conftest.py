"""The order of the tests: robots, and beside them what computes for long, giving way to them.

Of three or more workers (`pytest -n 3`) the last one computes, in the time that robots leave: they
wait for much of theirs. Fewer workers run the robots last, beside nothing else. The run is closed
with `N passed, N failed`.
"""
import fcntl
import os
import re
import tempfile
from functools import lru_cache
from pathlib import Path
from typing import Any, Iterator, List, Tuple

import pytest
from hypothesis import settings

COMPUTING = (
    *("test_style", "test_packages", "test_learn", "test_site", "test_models", "test_plans"),
    *("test_monitoring_learned", "test_learning_tutorial", "test_charge_estimator", "test_init"),
    *("test_search", "test_endurance", "test_checked_code", "test_faults", "test_resilience"),
)
"""Files that compute for long, and in which nothing waits with a deadline."""
WAITS = re.compile("wait_until|timeout|monotonic|sleep|Thread|socket|chromium")
"""A word of it is in each other file in which something may wait with a deadline."""
ROBOTS = (
    *("test_tutorials", "test_three_computers", "test_master", "test_live_page", "test_install"),
    *("test_reliability", "test_rostests", "test_rostests_of_robots", "test_bench"),
    *("test_cut_off", "test_partition", "test_redteam"),
)
"""Files of tests on real processes: they judge real time. What stays together long goes first."""
ALONE = ("test_reliability", "test_rostests", "test_rostests_of_robots", "test_bench")
"""Those of them whose tests share nothing: any of them may run beside any other."""
LONGEST = ("healers_die", "inject", "rover", "monitor_parameters")
"""The rostests to begin with."""
PRECISE = (
    *("deadline", "takeover", "heal_plain_topics", "failover"),
    *("monitor_detection", "substitute", "init", "test_cut_off"),
)
"""Tests that judge milliseconds, by their case or file: no robot runs beside them."""
ONE_BY_ONE = "the precise ones"
LOCK = os.path.join(tempfile.gettempdir(), f"shsa_robots_of_{os.getuid()}.lock")
SHARE, LOWEST = "/proc/self/autogroup", "19"
"""Of processor time, of all processes in a session."""

# Files run side by side: a second thread of a small matrix only spins.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
settings.register_profile("busy", deadline=None)  # the machine may be: time proves nothing
settings.load_profile("busy")


def module(nodeid: str) -> str:
    """Return the name of a test's file."""
    return nodeid.split("::")[0].rsplit("/", 1)[-1][: -len(".py")]


@lru_cache(maxsize=None)
def computes(file: str) -> bool:
    """Return whether nothing in a file of tests, by its path or a test's name, has a deadline."""
    if module(file) in (*COMPUTING, *ROBOTS):
        return module(file) in COMPUTING
    return not WAITS.search((Path(__file__).parent / file.split("::")[0]).read_text("utf-8"))


def precise(nodeid: str) -> bool:
    """Return whether a test, by its name, judges milliseconds."""
    return not {case(nodeid), module(nodeid)}.isdisjoint(PRECISE)


def gives_way(worker: str, count: int) -> bool:
    """Return whether a worker of so many, by name, runs in the time that the others leave."""
    return count >= 3 and worker == f"gw{count - 1}"


def case(nodeid: str) -> str:
    """The parameters of a test."""
    return nodeid.partition("[")[2][:-1]


@pytest.hookimpl(hookwrapper=True)  # type: ignore[misc]
def pytest_runtest_protocol(item: Any) -> Iterator[None]:
    """Let a robot share the machine with other robots, or have it alone."""
    if module(item.nodeid) not in ROBOTS:
        yield
        return
    alone = precise(item.nodeid)
    with open(LOCK, "w") as lock, open(f"{LOCK}.gate", "w") as gate:
        fcntl.flock(gate, fcntl.LOCK_EX)  # who waits to be alone lets nobody else in meanwhile
        fcntl.flock(lock, fcntl.LOCK_EX if alone else fcntl.LOCK_SH)
        fcntl.flock(gate, fcntl.LOCK_UN)
        yield


def pytest_configure(config: Any) -> None:
    """Have the last worker give way, in a session of its own: each has a share of its own."""
    told = getattr(config, "workerinput", None)
    if told and gives_way(told["workerid"], told["workercount"]):
        os.setsid()
        if os.path.exists(SHARE):
            with open(SHARE, "w", encoding="ascii") as share:
                share.write(LOWEST)
        os.sched_setscheduler(0, os.SCHED_IDLE, os.sched_param(0))


def pytest_collection_modifyitems(items: List[Any]) -> None:
    """Sort: what computes for long first, and robots last, so that some run side by side."""

    def turn(item: Any) -> Tuple[int, int]:
        name = module(item.nodeid)
        if name not in ROBOTS:
            return (0, COMPUTING.index(name)) if name in COMPUTING else (1, 0)
        return (2, 0) if case(item.nodeid) in LONGEST else (3, ROBOTS.index(name))

    items.sort(key=turn)


@pytest.hookimpl(optionalhook=True)  # type: ignore[misc]
def pytest_xdist_make_scheduler(config: Any, log: Any) -> Any:
    """Keep the tests of a file together, but for those that share nothing; and the precise ones."""
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            if precise(nodeid):
                return ONE_BY_ONE
            return nodeid if module(nodeid) in ALONE else nodeid.split("::")[0]

        def _assign_work_unit(self, node: Any) -> None:
            """Have the worker that gives way, if there is one, compute; the others do so last.

            They begin with robots. One of them then runs those that are alone, and the other what
            is no robot: none waits for the other.
            """

            def turn(scope: str) -> int:
                if scope == ONE_BY_ONE:
                    return 1
                return 3 if computes(scope) else 2 * (module(scope) not in ROBOTS)

            if self.numnodes >= 3:
                last = gives_way(node.gateway.id, self.numnodes)
                scopes = [scope for scope in self.workqueue if not last or turn(scope) == 3]
                if not scopes:
                    node.shutdown()
                    return
                self.workqueue.move_to_end(min(scopes, key=turn), last=False)
            super()._assign_work_unit(node)

    return Scheduling(config, log)


def pytest_unconfigure(config: Any) -> None:
    """Print the closing line, after pytest's own summary."""
    reporter = config.pluginmanager.get_plugin("terminalreporter")
    if reporter is None:
        return
    count = {
        outcome: len([r for r in reporter.stats.get(outcome, []) if getattr(r, "when", "call")])
        for outcome in ("passed", "failed", "error", "skipped")
    }
    failed = count["failed"] + count["error"]
    skipped = ", %d skipped" % count["skipped"] if count["skipped"] else ""
    reporter.write_line("%d passed, %d failed%s" % (count["passed"], failed, skipped))
