"""Changes of the SOM: what a healthy publisher violates at once is refused."""
import json
from dataclasses import replace

import pytest
from monitor_bench import (
    NODE,
    PERIOD,
    TOPIC,
    Bench,
    message_checks,
    provision,
    service,
    streaming,
    table,
)

from shsa_core.journal.codec import Codec
from shsa_core.model.checks import Checks, Jump, RateHigh, default_checks
from shsa_core.model.log import Level, Log
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.events import Command, SomChanged


@pytest.fixture
def bench() -> Bench:
    return streaming()


def counts(bench: Bench, wanted: Service) -> bool:
    return bench.core.service_of(TOPIC, NODE) == wanted and not bench.refused


@pytest.mark.parametrize(
    "changed, says",
    [
        (service(provision(range=(100.0, 200.0))), "out_of_range: battery_current is 1"),
        (service(period=1e9), "rate_high: 50 messages came in"),
        (service(period=0.03), "rate_high: 50 messages came in"),
        (service(period=1e-4), "rate_low: 50"),
        (service(deadline=0.5), "silent: no message for 0.020 s"),
        (service(checks=message_checks(RateHigh(0.5))), "rate_high"),
    ],
)
def test_what_a_healthy_publisher_violates_at_once_is_refused(
    bench: Bench, changed: Service, says: str
) -> None:
    bench.watch(replace(changed, needed=True))
    (refused,) = bench.refused
    assert (
        says in refused.text
        and NODE in refused.text
        and ("so far" in refused.text or "checks" in refused.text)
    )
    kept = service(needed=True)
    assert refused.service == kept == bench.core.service_of(TOPIC, NODE)
    bench.stream(50)
    bench.stream(3, value=99.0)
    assert bench.kinds() == [(NODE, "out_of_range")]


@pytest.mark.parametrize(
    "changed",
    [
        service(provision(range=None)),
        service(provision(range=(-5.0, 61.0))),
        service(provision(range=(0.0, 2.0))),
        service(provision(checks=())),
        service(provision(checks=(*default_checks(True), Jump(5.0)))),
        service(deadline=500.0),
        service(deadline=3.0),
        service(period=0.025),
        service(period=0.016),
        service(checks=message_checks()),
        service(checks=Checks(bad=1)),
        service(period=None),
    ],
)
def test_what_it_conforms_to_counts_at_once(bench: Bench, changed: Service) -> None:
    said = bench.send(SomChanged(bench.now, Som([changed])))
    (told,) = (each for each in said if isinstance(each, Log))
    assert told.text.startswith("Changed: current: ") and f"it concerns {NODE}" in told.text
    assert told.level is Level.INFO and "allows more" not in told.text
    assert counts(bench, changed)
    bench.stream(50)
    assert bench.failures == []


def test_a_longer_period_blames_nobody_for_the_rate_of_the_file() -> None:
    """With 0.029 s more than 51.7 Hz would be too many: a healthy node has that for a second."""
    bench = streaming()
    bench.watch(service(period=0.029, weakened="period", fastest=PERIOD))
    assert not bench.refused
    bench.stream(100, period=0.8 * PERIOD)
    assert bench.failures == [] and bench.state() == "healthy"
    bench.stream(200, period=0.4 * PERIOD)
    assert bench.kinds() == [(NODE, "rate_high")]


def test_what_is_weaker_than_the_file_is_told_with_that(bench: Bench) -> None:
    """Also where it is less than before: the sum counts."""
    bench.watch(service(provision(range=(-5.0, 90.0)), weakened="range"))
    changed = service(provision(range=(-5.0, 70.0)), weakened="range: 70")
    said = bench.send(SomChanged(bench.now, Som([changed])))
    (told,) = (each for each in said if isinstance(each, Log))
    assert told.level is Level.WARN and told.text.endswith(
        "it allows more than the SOM file: range: 70"
    )
    said = bench.send(SomChanged(bench.now, Som([service()])))
    (told,) = (each for each in said if isinstance(each, Log))
    assert told.level is Level.INFO and "allows more" not in told.text


def test_the_mark_goes_once_the_file_says_the_same(bench: Bench) -> None:
    wide = service(provision(range=(-5.0, 90.0)))
    bench.watch(replace(wide, weakened="range"))
    said = bench.send(SomChanged(bench.now, Som([wide])))
    assert not any(isinstance(each, Log) for each in said) and counts(bench, wide)


def test_a_refused_change_keeps_its_mark(bench: Bench) -> None:
    wide = service(provision(range=(-5.0, 90.0)), weakened="range")
    bench.watch(wide)
    bench.stream(10, value=80.0)
    bench.watch(service())
    assert bench.refused[0].service == wide == bench.core.service_of(TOPIC, NODE)


def test_a_rate_is_refused_where_few_messages_came_before() -> None:
    for count in range(2, 40):
        bench = Bench()
        bench.connect()
        bench.stream(count)
        bench.watch(service(period=1e6))
        bench.stream(60)
        assert len(bench.refused) == 1 and bench.failures == [], count


def test_what_does_not_judge_is_no_change_of_numbers(bench: Bench) -> None:
    changed = service(provision(quality=0.5), needed=True)
    said = bench.send(SomChanged(bench.now, Som([changed])))
    assert counts(bench, changed) and not any(isinstance(each, Log) for each in said)


def test_after_a_refusal_the_numbers_can_be_put_back_and_changed_again(bench: Bench) -> None:
    bench.watch(service(period=0.025))
    bench.watch(service(period=1e9))
    kept = service(period=0.025)
    assert [each.service for each in bench.refused] == [kept]
    bench.watch(kept)
    assert bench.core.service_of(TOPIC, NODE) == kept
    bench.watch(service())
    assert bench.core.service_of(TOPIC, NODE) == service() and len(bench.refused) == 1


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


def test_a_quiet_button_does_not_become_periodic() -> None:
    bench = Bench(service(period=None))
    bench.connect()
    bench.wait(20.0)
    bench.watch(service())
    bench.wait(20.0)
    assert "silent: no message for 20.000 s" in bench.refused[0].text
    assert bench.failures == [] and bench.state() == "healthy"


def test_the_service_of_another_node_is_no_change_of_numbers(bench: Bench) -> None:
    bench.watch(replace(service(period=0.001), node="/other"))
    assert bench.refused == []


def test_what_was_never_good_is_told_as_that() -> None:
    bench = Bench(service(provision(range=(100.0, 200.0))))
    bench.connect()
    bench.stream(3)
    assert "the SOM may be wrong" in bench.failures[0].detail
    assert "the SOM may be wrong" in table(bench.core)[0].detail


def test_a_rate_that_was_never_good_is_told_as_that() -> None:
    bench = Bench(service(period=10.0))
    bench.connect()
    bench.stream(100)
    assert bench.failures == [] and bench.state(NODE) == "healthy"
    assert "`period` in the SOM may be wrong" in bench.told[0]


@pytest.mark.parametrize("period", [0.5 * PERIOD, 2.0 * PERIOD])
def test_a_rosbag_at_another_rate_is_not_blamed(period: float) -> None:
    """Nobody heeds /clock, and the SOM has the rate of the node that was recorded."""
    bench, player = Bench(), "/play_1"
    bench.connect(player)
    bench.stream(200, player, period=period)
    assert bench.failures == [] and bench.state(player) == "healthy"
    assert "`period` in the SOM may be wrong" in bench.told[0]
    bench.stream(100, player)
    assert bench.rows[TOPIC, player].detail == ""
    bench.stream(200, player, period=period)
    assert [kind for _, kind in bench.kinds()] == ["rate_high" if period < PERIOD else "rate_low"]


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
    for said in (bench.refused[0], Log(Level.WARN, "Changed: current")):
        assert codec.decode(json.loads(json.dumps(codec.encode(said))), "here", "it") == said
