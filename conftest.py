"""The order of the tests: robots and what computes side by side, the latter giving way.

Of three or more workers (`pytest -n 3`) the last one runs what only computes, and only in the time
that robots leave: they wait half of theirs. Fewer workers run the robots last, beside nothing else.
The run is closed with `N passed, N failed`.
"""
import os
from typing import Any, List

import pytest
from hypothesis import settings

FIRST = ("test_packages", "test_install", "test_learn", "test_style", "test_models")
"""Files that compute for long: none of them is left when the robots begin."""
ROBOTS = (
    *("test_reliability", "test_master", "test_rostests", "test_rostests_of_robots"),
    *("test_bench", "test_three_computers", "test_tutorials", "test_live_page", "test_partition"),
    *("test_start", "test_cut_off"),
)
"""Files of tests on real processes: they judge real time."""
ALONE = ("test_reliability", "test_rostests", "test_rostests_of_robots", "test_bench")
"""Those of them whose tests share nothing: any of them may run beside any other."""
LONGEST = ("flapping", "heal_amperemeter", "inject", "healers_die")
"""The rostests to begin with."""
SHARE, LOWEST = "/proc/self/autogroup", "19"
"""Of processor time, of all processes in a session."""

# Files run side by side: a second thread of a small matrix only spins.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
settings.register_profile("busy", deadline=None)  # the machine may be: time proves nothing
settings.load_profile("busy")


def module(nodeid: str) -> str:
    """The name of a test's file."""
    return nodeid.split("::")[0].rsplit("/", 1)[-1][: -len(".py")]


def gives_way(worker: str, count: int) -> bool:
    """Whether a worker of so many, by its name, runs in the time that the others leave."""
    return count >= 3 and worker == f"gw{count - 1}"


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
    """Those last: then some of them run side by side, and nothing that only computes."""

    def turn(item: Any) -> int:
        name = module(item.nodeid)
        if name not in ROBOTS:
            return 0 if name in FIRST else 1
        case = item.nodeid.partition("[")[2][:-1]
        return 2 if case in LONGEST else 3 + ROBOTS.index(name)

    items.sort(key=turn)


@pytest.hookimpl(optionalhook=True)  # type: ignore[misc]
def pytest_xdist_make_scheduler(config: Any, log: Any) -> Any:
    """Keep the tests of a file together, but for those that share nothing."""
    from xdist.scheduler import LoadScopeScheduling

    class Scheduling(LoadScopeScheduling):  # type: ignore[misc]
        def _split_scope(self, nodeid: str) -> str:
            return nodeid if module(nodeid) in ALONE else nodeid.split("::")[0]

        def _assign_work_unit(self, node: Any) -> None:
            """Robots first, where there is a worker for the rest; that one is given no robot."""
            if self.numnodes >= 3:
                robots = [scope for scope in self.workqueue if module(scope) in ROBOTS]
                others = [scope for scope in self.workqueue if module(scope) not in ROBOTS]
                last = gives_way(node.gateway.id, self.numnodes)
                if last and not others:
                    node.shutdown()
                    return
                first = others if last or not robots else robots
                self.workqueue.move_to_end(first[0], last=False)
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
