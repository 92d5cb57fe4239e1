"""Ends every test run with what runs whole robots, and closes it with `N passed, N failed`."""
from typing import Any, List

from hypothesis import settings

ROBOTS = (
    *("test_rostests", "test_reliability", "test_rostests_of_robots"),
    *("test_bench", "test_three_computers", "test_master", "test_partition"),
    *("test_tutorials", "test_start"),
)
"""Files of tests on real processes: they judge real time. The longest comes first."""

settings.register_profile("busy", deadline=None)  # the machine may be: time proves nothing
settings.load_profile("busy")


def pytest_collection_modifyitems(items: List[Any]) -> None:
    """Those last: where files run side by side, two of them run, and nothing that only computes."""

    def turn(item: Any) -> int:
        name = item.nodeid.split("::")[0].rsplit("/", 1)[-1][: -len(".py")]
        return ROBOTS.index(name) + 1 if name in ROBOTS else 0

    items.sort(key=turn)


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
