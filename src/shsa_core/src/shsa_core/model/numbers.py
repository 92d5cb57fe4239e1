"""Compares the numbers by which the publishers of a service are judged with other ones."""
from math import inf
from typing import Optional

from shsa_core.model.service import Service, is_within


def allows_more(new: Service, old: Service) -> bool:
    """Tell if a publisher may do what it might not before."""
    pairs = list(zip(new.provides, old.provides))
    return (
        (new.period or inf) > (old.period or inf)
        or (new.checks.bad, new.checks.of) != (old.checks.bad, old.checks.of)
        or not set(old.checks.each) <= set(new.checks.each)
        or any(not set(before.checks) <= set(now.checks) for now, before in pairs)
        or any(not is_within(now.range, before.range) for now, before in pairs)
    )


def differences(new: Service, old: Service, when: str) -> str:
    """Return the numbers that differ, in words; `when` the old ones count."""
    said = []
    if new.period != old.period:
        said.append(f"period: {_word(new.period)} ({when} {_word(old.period)})")
    if new.deadline != old.deadline:
        said.append(f"deadline: {new.deadline or 'usual'} ({when} {old.deadline or 'usual'})")
    if new.checks != old.checks:
        said.append("checks")
    for now, before in zip(new.provides, old.provides):
        if now.range != before.range:
            what = f"range of {now.property}: {now.range or 'none'}"
            said.append(f"{what} ({when} {before.range or 'none'})")
        if now.checks != before.checks:
            said.append(f"checks of {now.property}")
    return ", ".join(said)


def _word(period: Optional[float]) -> str:
    return "none" if period is None else f"{period:g}"
