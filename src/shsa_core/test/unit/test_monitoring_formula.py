"""The check of a formula: in the SOM, and judged by the monitor at each message."""
import pathlib
from dataclasses import replace
from typing import Any, Optional

import pytest
from monitor_bench import NODE, TOPIC, Bench, message_checks, provision, service
from som_trees import GOOD, changed, som_of, write

from shsa_core.errors import ModelError
from shsa_core.files.som_file import read_som, som_parameters
from shsa_core.model.checks import Formula
from shsa_core.model.service import Service
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.evidence import Evidence, checked_provisions


def keeping(formula: str, **changes: Any) -> Service:
    """The amperemeter, whose messages must keep a formula, and nothing else."""
    value = provision(range=None, checks=(), property="current")
    return service(value, checks=message_checks(Formula(formula)), **changes)


def streaming(formula: str) -> Bench:
    bench = Bench(keeping(formula))
    bench.connect()
    bench.stream(100, value=1.0)  # 2 s
    assert bench.state() == "healthy"
    return bench


def test_a_spike_breaks_what_must_always_hold() -> None:
    bench = streaming("always(current < 5, 1)")
    bench.stream(1, value=6.0)
    assert bench.failures == []  # the first message that breaks it is one
    bench.stream(2)
    assert bench.kinds() == [(NODE, "formula")]
    detail = "always(current < 5, 1) does not hold: current is 1"
    assert bench.failures[0].detail == detail
    bench.stream(45)
    assert bench.state() == "failed"
    bench.stream(10)
    assert bench.state() == "healthy"


def test_a_plain_condition_is_judged_message_by_message() -> None:
    bench = streaming("current < 5")
    for _ in range(10):
        bench.stream(1, value=6.0)
        bench.stream(9)
    assert len(bench.failures) == 1  # twice as many bad ones among ten times as many
    assert bench.kinds() == [(NODE, "formula")]


def test_what_must_come_once_in_a_while() -> None:
    bench = streaming("once(current > 0.5, 1)")
    bench.stream(45, value=0.1)
    assert bench.failures == []
    bench.stream(12, value=0.1)
    assert bench.kinds() == [(NODE, "formula")]


def test_an_answer_must_come_in_time() -> None:
    bench = streaming("within(current > 4, current < 2, 0.5)")
    bench.stream(20, value=5.0)
    bench.stream(20)
    assert bench.failures == []
    bench.stream(20, value=5.0)
    bench.stream(10, value=3.0)
    assert bench.kinds() == [(NODE, "formula")]


def test_functions_with_a_memory_are_part_of_it() -> None:
    bench = streaming("always(abs(derivative(current)) < 100, 0.2)")
    for step in range(50):
        bench.stream(1, value=1.0 + 0.5 * step)  # 25 A/s
    assert bench.failures == []
    bench.stream(5, value=40.0)
    assert bench.kinds() == [(NODE, "formula")]


def test_nothing_is_said_before_enough_was_seen() -> None:
    bench = Bench(keeping("once(current > 0.5, 3)"))
    bench.connect()
    bench.stream(140, value=0.1)
    assert bench.failures == [] and bench.state() == "healthy"
    bench.stream(20, value=0.1)
    assert bench.kinds() == [(NODE, "formula")]


@pytest.mark.parametrize(
    "formula", ["once(current > 4, 0.5)", "within(current < 2, current > 4, 0.5)"]
)
def test_what_has_waited_for_us_is_judged_in_the_publishers_favour(formula: str) -> None:
    for waited in (0.0, 5.0):
        evidence = Evidence(keeping(formula))
        values = [5.0 if step % 20 == 0 else 1.0 for step in range(450)]
        times = [0.02 * step for step in range(200)] + 250 * [9.0]  # the last 5 s are read at once
        late = [0.0] * 200 + [waited] * 250
        found = [
            evidence.look(Message(time, TOPIC, NODE, (value,), waited=wait), False) is None
            for time, value, wait in zip(times, values[:185] + values[200:] + values[:15], late)
        ]
        assert all(found) is (waited > 0.0)


@pytest.mark.parametrize("value", [float("nan"), float("inf"), None])
def test_what_has_no_value_breaks_nothing(value: Optional[float]) -> None:
    bench = streaming("always(1 / current < 5, 1)")
    for _ in range(100):
        bench.wait(0.02)
        bench.send(Message(bench.now, TOPIC, NODE, (value,)))
    bench.stream(20, value=0.0)
    assert bench.failures == []


def test_only_what_a_substitute_writes_is_judged() -> None:
    both = (
        provision(checks=(), range=None, property="v"),
        provision(checks=(), range=None, property="w"),
    )
    both = (both[0], replace(both[1], field="other"))
    of = replace(keeping("v < 3 and w < 3"), provides=both)
    evidence = Evidence(of)
    evidence.written = {both[0].field}
    judged = [evidence.look(Message(1.0, TOPIC, NODE, (1.0, 9.0)), False) is None]
    judged.append(evidence.look(Message(2.0, TOPIC, NODE, (9.0, 1.0)), False) is None)
    assert judged == [True, False]


def test_the_values_of_a_formula_are_read() -> None:
    assert [each.property for each in checked_provisions(keeping("current < 5"))] == ["current"]
    bare = replace(keeping("current < 5"), checks=message_checks())
    assert checked_provisions(bare) == ()


def test_a_formula_stands_in_the_som() -> None:
    som = som_of(changed("checks", {"formula": "always(v > 0,  2)"}))
    (of,) = som
    assert [c.limit for c in of.checks.each if isinstance(c, Formula)] == ["always(v > 0, 2)"]
    assert som_of(som_parameters(som)) == som


@pytest.mark.parametrize(
    "formula, why",
    [
        ("always(v > 0)", "formula: write always(a, T): T is a number of seconds"),
        ("always(w > 0, 2)", "formula uses w, but the service provides v alone"),
        ("v > 0 and", "formula: not an expression"),
        (True, "formula: a number stands where a condition is needed"),
    ],
)
def test_a_broken_formula_is_named_with_its_line(
    tmp_path: pathlib.Path, formula: Any, why: str
) -> None:
    with pytest.raises(ModelError, match="formula") as caught:
        som_of(changed("checks", {"formula": formula}))
    assert why in caught.value.what
    checks = GOOD.replace("provides:", f"checks: {{formula: '{formula}'}}\n    provides:", 1)
    line = checks.splitlines().index(f"    checks: {{formula: '{formula}'}}") + 1
    with pytest.raises(ModelError, match="formula") as caught:
        read_som(write(tmp_path, checks))
    assert f":{line}: " in str(caught.value)
