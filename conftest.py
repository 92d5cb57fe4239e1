"""Closes every test run with the plain line `N passed, N failed`."""
from typing import Any


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
