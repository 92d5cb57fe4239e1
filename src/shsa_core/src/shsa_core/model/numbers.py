"""Compares the numbers by which the publishers of a service are judged with other ones."""
from math import inf
from typing import Any, List, Tuple

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
    pairs = list(zip(new.provides, old.provides))
    told: List[Tuple[str, Any, Any]]
    told = [("period", new.period, old.period), ("deadline", new.deadline, old.deadline)]
    told += [(f"range of {now.property}", now.range, before.range) for now, before in pairs]
    said = [f"{what}: {n or 'none'} ({when} {b or 'none'})" for what, n, b in told if n != b]
    said += ["checks"] if new.checks != old.checks else []
    said += [f"checks of {now.property}" for now, was in pairs if now.checks != was.checks]
    return ", ".join(said)
