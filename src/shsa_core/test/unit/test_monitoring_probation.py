"""Changes of the SOM: what a healthy publisher violates at once is refused."""
import json
from dataclasses import replace
from math import nan
from typing import Any, List

import pytest
from monitor_bench import (
    NODE,
    PERIOD,
    TOPIC,
    Bench,
    message_checks,
    provision,
    service,
    with_value_checks,
)

from shsa_core.journal.codec import Codec
from shsa_core.model.checks import Jump, RateHigh, RateLow, StaleStamp
from shsa_core.model.service import Service
from shsa_core.monitoring.events import ChangeAdopted, Command, Message


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.connect()
    made.stream(60)
    return made


def stream(bench: Bench) -> List[Command]:
    bench.wait(PERIOD)
    return bench.send(Message(bench.now, TOPIC, NODE, (1.0,)))


def counts(bench: Bench, wanted: Service) -> bool:
    return bench.core.service_of(TOPIC, NODE) == wanted and not bench.refused


@pytest.mark.parametrize(
    "change, says",
    [
        (dict(value=provision(range=(100.0, 200.0))), "out_of_range: battery_current is 1"),
        (dict(period=1e9), "rate_high: 20 messages came in"),
        (dict(period=0.005), "rate_low: 5"),
        (dict(period=1e-4), "rate_low: 5"),
        (dict(deadline=1e-9), "silent: no message for 0.0"),
        (dict(deadline=0.5), "silent: no message for 0.010 s"),
        (dict(checks=message_checks(RateHigh(0.5))), "rate_high"),
        (dict(checks=message_checks(StaleStamp(0.1))), "stale_stamp"),
        (dict(value=with_value_checks(Jump(0.01))), "jump"),
    ],
)
def test_what_a_healthy_publisher_violates_at_once_is_refused(
    bench: Bench, change: Any, says: str
) -> None:
    value = change.pop("value", None)
    bench.watch(service(value, **change))
    for step in range(100):
        bench.stream(1, value=1.0 + 0.1 * (step % 2), age=0.3)
    (refused,) = bench.refused
    assert says in refused.text and NODE in refused.text and "so far" in refused.text
    assert refused.service == service()
    assert counts(Bench(), service()) and bench.core.service_of(TOPIC, NODE) == service()
    assert bench.failures == [] and bench.state() == "healthy"


def test_a_rate_is_refused_where_few_messages_came_before() -> None:
    for count in range(1, 40):
        bench = Bench()
        bench.connect()
        bench.stream(count)
        bench.watch(service(period=1e6))
        bench.stream(60)
        assert len(bench.refused) == 1 and bench.failures == [], count


@pytest.mark.parametrize(
    "changed",
    [
        service(provision(range=None)),
        service(provision(range=(-5.0, 61.0))),
        service(provision(checks=())),
        service(deadline=500.0),
        service(checks=message_checks()),
        service(needed=True),
    ],
)
def test_what_only_allows_more_counts_at_once(bench: Bench, changed: Service) -> None:
    bench.watch(changed)
    assert counts(bench, changed)
    bench.stream(50)
    assert bench.failures == []


@pytest.mark.parametrize(
    "changed",
    [
        service(provision(range=(0.0, 2.0))),
        service(provision(range=(-50.0, 2.0))),
        service(period=0.025),
        service(deadline=3.0),
        service(checks=message_checks(RateLow(0.9))),
        service(checks=message_checks(bad=1)),
        service(provision(checks=(Jump(5.0),))),
        service(period=None),
    ],
)
def test_what_it_conforms_to_counts_soon(bench: Bench, changed: Service) -> None:
    bench.watch(changed)
    said = [each for _ in range(12) for each in stream(bench)]
    assert counts(bench, changed)
    adopted = [each.service for each in said if isinstance(each, ChangeAdopted)]
    assert adopted == ["current"]
    bench.stream(50)
    assert bench.failures == []


def test_the_numbers_so_far_judge_meanwhile(bench: Bench) -> None:
    bench.watch(service(provision(range=(0.0, 1e6))))
    bench.stream(3, value=1000.0)
    assert bench.kinds() == [(NODE, "out_of_range")]


def test_the_new_numbers_judge_afterwards(bench: Bench) -> None:
    bench.watch(service(provision(range=(0.0, 2.0))))
    bench.stream(12)
    bench.stream(3, value=3.0)
    assert bench.kinds() == [(NODE, "out_of_range")]


def test_what_does_not_judge_counts_at_once(bench: Bench) -> None:
    bench.watch(service(needed=True))
    assert counts(bench, service(needed=True))


def test_a_refused_change_leaves_the_rest_of_the_service_changed(bench: Bench) -> None:
    bench.watch(service(provision(range=(100.0, 200.0), quality=0.5), needed=True))
    bench.stream(10)
    wanted = service(provision(quality=0.5), needed=True)
    assert [refused.service for refused in bench.refused] == [wanted]


def test_after_a_refusal_the_numbers_can_be_put_back_and_changed_again(bench: Bench) -> None:
    bench.watch(service(period=1e9))
    bench.stream(30)
    bench.watch(service())
    assert bench.core.service_of(TOPIC, NODE) == service()
    bench.watch(service(period=0.025))
    bench.stream(12)
    assert bench.core.service_of(TOPIC, NODE) == service(period=0.025)
    assert len(bench.refused) == 1


def test_a_failed_publisher_contradicts_nobody(bench: Bench) -> None:
    bench.stream(3, value=99.0)
    changed = service(provision(range=(0.0, 100.0)))
    bench.watch(changed)
    assert counts(bench, changed)
    bench.stream(6, value=99.0)
    assert bench.state() == "healthy"


def test_nobody_there_contradicts_nobody() -> None:
    bench = Bench()
    bench.watch(service(period=1e6))
    assert counts(bench, service(period=1e6))


def test_a_node_that_starts_anew_with_other_values_decides_for_the_change(bench: Bench) -> None:
    changed = service(provision(range=(100.0, 200.0)))
    bench.watch(changed)
    bench.disconnect()
    bench.wait(1.0)
    bench.connect()
    bench.stream(1, value=150.0)
    assert counts(bench, changed) and bench.state() == "healthy"
    bench.stream(3)
    assert bench.kinds() == [(NODE, "node_gone"), (NODE, "out_of_range")]


def test_a_node_that_starts_anew_as_before_does_not(bench: Bench) -> None:
    bench.watch(service(provision(range=(100.0, 200.0))))
    bench.disconnect()
    bench.connect()
    bench.stream(10)
    assert len(bench.refused) == 1 and bench.state() == "healthy"


def test_a_quiet_button_does_not_become_periodic() -> None:
    bench = Bench(service(period=None))
    bench.connect()
    bench.watch(service())
    bench.wait(20.0)
    assert "silent: no message for 0.100 s" in bench.refused[0].text
    assert bench.failures == [] and bench.state() == "healthy"


def test_a_monitor_that_was_not_scheduled_refuses_nothing(bench: Bench) -> None:
    bench.watch(service(deadline=2.0))
    bench.now += 0.09
    bench.wake(0.05)
    bench.send(Message(bench.now, TOPIC, NODE, (1.0,), waited=0.09))
    bench.stream(12)
    assert counts(bench, service(deadline=2.0))


def test_a_change_of_two_values_is_read_for_both() -> None:
    x = provision(property="x", field="x", range=None, checks=())
    y = provision(property="y", field="y", range=(0.0, 2.0))
    bench = Bench(service(provides=(x, y)))
    bench.connect()
    for _ in range(60):
        bench.wait(PERIOD)
        bench.send(Message(bench.now, TOPIC, NODE, (1.0,)))
    new = provision(property="x", field="x", range=(5.0, 6.0))
    bench.watch(service(provides=(new, y)))
    for _ in range(5):
        bench.wait(PERIOD)
        bench.send(Message(bench.now, TOPIC, NODE, (1.0, 1.0)))
    assert "x is 1, 5 to 6 are allowed" in bench.refused[0].text
    for _ in range(3):
        bench.wait(PERIOD)
        bench.send(Message(bench.now, TOPIC, NODE, (9.0,)))
    assert bench.kinds() == [(NODE, "out_of_range")]


@pytest.mark.parametrize("values", [None, (), (1.0, 2.0, 3.0), (nan,)])
def test_values_that_do_not_fit_end_nothing(bench: Bench, values: Any) -> None:
    bench.watch(service(provision(range=(0.0, 2.0))))
    for _ in range(2):
        bench.send(Message(bench.now, TOPIC, NODE, values))
    assert bench.failures == []


def test_the_service_of_another_node_is_no_change_of_numbers(bench: Bench) -> None:
    bench.watch(replace(service(period=0.001), node="/other"))
    assert bench.refused == []


def test_what_was_never_good_is_told_as_that() -> None:
    bench = Bench(service(provision(range=(100.0, 200.0))))
    bench.connect()
    bench.stream(3)
    assert "the SOM may be wrong" in bench.failures[0].detail
    assert "the SOM may be wrong" in bench.core.table()[0].detail


def test_a_rate_that_was_never_good_is_told_as_that() -> None:
    bench = Bench(service(period=10.0))
    bench.connect()
    bench.stream(100)
    assert bench.kinds() == [(NODE, "rate_high")]
    assert "the SOM may be wrong" in bench.failures[0].detail


def test_a_node_that_was_always_too_slow_is_told_as_that() -> None:
    bench = Bench()
    bench.connect()
    bench.stream(3, period=2.0)
    assert bench.kinds()[0] == (NODE, "silent")
    assert "the SOM may be wrong" in bench.failures[0].detail


def test_what_was_good_once_is_told_as_usual(bench: Bench) -> None:
    bench.stream(3, value=99.0)
    bench.stream(10)
    bench.stream(200, period=PERIOD / 4)
    assert [str(each.kind) for each in bench.failures] == ["out_of_range", "rate_high"]
    bench.wait(1.0)
    assert not any("SOM" in failure.detail for failure in bench.failures)


def test_what_became_of_a_change_can_be_journaled(bench: Bench) -> None:
    bench.watch(service(provision(range=(100.0, 200.0)), period=1e6))
    bench.stream(40)
    codec = Codec(Command)
    for said in (bench.refused[0], ChangeAdopted(1.0, "current", "period: 1 (so far 2)")):
        assert codec.decode(json.loads(json.dumps(codec.encode(said))), "here", "it") == said
