"""Several nodes at fault: when one excuses another, and when no more."""
from typing import Any, Dict, Optional, Tuple

import pytest
from monitor_bench import PERIOD, Bench, provision, row, service

from shsa_core.model.service import Service
from shsa_core.monitoring.events import SubstitutionsChanged

SUBSTITUTE = "/substitute_1"


def named(name: str, period: Optional[float] = PERIOD, **more: Any) -> Service:
    """The service of the node `/a_n` on the topic `/a`."""
    value = provision(property=name)
    return service(value, name=name, topic=f"/{name}", node=f"/{name}_n", period=period, **more)


def robot(*services: Service) -> Bench:
    """All do well."""
    bench = Bench(*services)
    for each in services:
        bench.connect(each.node, each.topic)
    stream(bench, 2.0, {each.name: 1.0 for each in services})
    return bench


def stream(bench: Bench, seconds: float, values: Dict[str, float], **every: int) -> None:
    """A value on each topic, so many periods apart, by a node `/a_n`, or by its substitute."""
    for number in range(round(seconds / PERIOD)):
        bench.wait(PERIOD)
        for name, value in values.items():
            topic = f"/{name}"
            replaced = bench.state(SUBSTITUTE, topic) is not None
            if number % every.get(name, 1) == 0:
                bench.message(value, SUBSTITUTE if replaced else f"/{name}_n", topic)


def substitute(bench: Bench, name: str) -> None:
    whole = (row(SUBSTITUTE, True, f"/{name}", service=name),)
    bench.send(SubstitutionsChanged(bench.now, whole, whole=True))
    bench.connect(SUBSTITUTE, f"/{name}")


# What is computed from what


@pytest.mark.parametrize("dies", [True, False])
@pytest.mark.parametrize("fault, kind", [((1e6, 1), "out_of_range"), ((1.0, 3), "rate_low")])
def test_who_reads_of_a_substitute_is_not_excused_by_whom_that_replaces(
    dies: bool, fault: Tuple[float, int], kind: str
) -> None:
    value, every = fault
    bench = robot(named("a"), named("b", derived_from=("a",)))
    stream(bench, 3.0, {"a": value, "b": 1.0}, a=every)
    if dies:
        bench.disconnect("/a_n", "/a")
    substitute(bench, "a")
    stream(bench, 3.0, {"a": 1.0, "b": 1.0})
    stream(bench, 10.0, {"a": 1.0, "b": value}, b=every)
    assert bench.kinds() == [("/a_n", kind), ("/b_n", kind)]


# Ranges


def blames_b(bench: Bench, *others: str) -> bool:
    """Tell if b is blamed once it is out of range, while `others` go on to be."""
    stream(bench, 10.0, {"b": 1e6, **{each: 1e6 for each in others}})
    return ("/b_n", "out_of_range") in bench.kinds()


def test_an_event_of_long_ago_excuses_nobody() -> None:
    """One message out of range is no failure, and there was no other since."""
    bench = robot(named("a", period=None), named("b"))
    bench.message(1e6, "/a_n", "/a")
    stream(bench, 5.0, {"b": 1.0})
    assert bench.failures == [] and blames_b(bench)


@pytest.mark.parametrize("hangs", [True, False])
def test_who_failed_long_ago_excuses_nobody(hangs: bool) -> None:
    bench = robot(named("a"), named("b"))
    stream(bench, 2.0, {"a": 1e6, "b": 1.0})
    stream(bench, 12.0, {"b": 1.0} if hangs else {"a": 1e6, "b": 1.0})
    assert bench.kinds() == [("/a_n", "out_of_range")]
    assert blames_b(bench) if hangs else blames_b(bench, "a")


def test_who_failed_first_of_what_befell_both_excuses_the_other() -> None:
    bench = robot(named("a"), named("b"))
    stream(bench, 0.2, {"a": 1e6, "b": 1.0})
    assert bench.kinds() == [("/a_n", "out_of_range")] and not blames_b(bench, "a")


def test_what_reaches_a_second_sensor_later_befell_both() -> None:
    bench = robot(named("a"), named("b"))
    stream(bench, 2.0, {"a": 1e6, "b": 1.0})
    assert not blames_b(bench, "a")


def test_a_node_that_was_killed_for_it_excuses_nobody() -> None:
    bench = robot(named("a"), named("b"))
    stream(bench, 0.5, {"a": 1e6, "b": 1.0})
    bench.disconnect("/a_n", "/a")
    assert blames_b(bench)


# Rates


def test_nodes_that_are_always_slow_excuse_nobody_who_becomes_so() -> None:
    """At three quarters of the rate in the SOM, which is allowed."""
    bench = robot(*map(named, "abc"))
    for every in (1, 3):
        for number in range(round(20.0 / PERIOD)):
            bench.wait(PERIOD)
            for name in "ab" if number % 4 else "":
                bench.message(node=f"/{name}_n", topic=f"/{name}")
            if number % every == 0:
                bench.message(node="/c_n", topic="/c")
    assert bench.kinds() == [("/c_n", "rate_low")]


def test_of_nodes_that_load_reaches_one_after_the_other_the_last_is_excused() -> None:
    bench = robot(*map(named, "abc"))
    slow = {"a": (3.0, 0.75), "b": (6.0, 0.75), "c": (9.0, 0.5)}
    due = dict.fromkeys(slow, 0.0)
    for quarter in range(round(40.0 / PERIOD) * 4):
        bench.wait(PERIOD / 4)
        for name, (begins, pace) in slow.items():
            time = quarter * PERIOD / 4
            if time >= due[name] - 1e-9:
                due[name] += PERIOD / (pace if time >= begins else 1.0)
                bench.message(node=f"/{name}_n", topic=f"/{name}")
    assert bench.kinds() == []
