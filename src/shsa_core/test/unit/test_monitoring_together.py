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
