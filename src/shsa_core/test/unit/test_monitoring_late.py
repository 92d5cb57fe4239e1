"""The monitor's own lateness, and what a turn looks at and says."""
from typing import Any, List

import pytest
from monitor_bench import DEADLINE, NODE, Bench, service

from shsa_core.monitoring.events import Disconnected, HealthChanged, Message, Tick
from shsa_core.monitoring.publishers import Publisher


@pytest.fixture
def bench() -> Bench:
    made = Bench()
    made.connect()
    made.stream(60)  # it is connected for longer than CHANGEOVER_S
    return made


def test_a_late_monitor_grants_what_it_lost(bench: Bench) -> None:
    bench.now += DEADLINE + 0.05
    bench.wake(0.05)
    assert bench.failures == []
    assert bench.core.next_deadline == pytest.approx(bench.now + 0.05)
    bench.message()
    bench.stream(50)
    assert bench.failures == []


def test_a_monitor_that_is_always_late_still_finds_silence(bench: Bench) -> None:
    last = bench.now
    while not bench.failures and bench.now < last + 10.0:
        bench.now = bench.core.next_deadline + 0.03
        bench.wake(0.03)
    assert bench.now <= last + 2 * (DEADLINE + 0.03)


def test_a_hairs_breadth_of_lateness_is_not_granted(bench: Bench) -> None:
    bench.wait(DEADLINE - 1e-6)
    bench.now = bench.core.next_deadline + 0.001
    bench.wake(0.001)
    assert bench.kinds() == [(NODE, "silent")]


def test_the_lateness_of_one_turn_excuses_nobody_in_the_next(bench: Bench) -> None:
    bench.wait(0.5 * DEADLINE)
    bench.wake(10.0)
    bench.wait(DEADLINE)
    assert bench.kinds() == [(NODE, "silent")]


def many(count: int) -> Bench:
    """Many healthy topics."""
    bench = Bench(
        *(service(name=f"s{i}", topic=f"/t{i}", node=f"/n{i}", period=1.0) for i in range(count))
    )
    for i in range(count):
        bench.connect(f"/n{i}", f"/t{i}")
        bench.now += 0.001
        bench.message(node=f"/n{i}", topic=f"/t{i}")
    return bench


def test_a_tick_looks_at_those_that_are_due_and_a_message_at_its_publisher(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = many(50)
    looked: List[str] = []
    real: Any = vars(Publisher)["deadline"].fget

    def counting(publisher: Publisher) -> float:
        looked.append(publisher.name)
        return float(real(publisher))

    monkeypatch.setattr(Publisher, "deadline", property(counting))
    core = bench.core
    core.handle(Message(bench.now, "/t7", "/n7", (1.0,)))
    core.handle(Tick(bench.now))
    assert len(looked) == 0
    first = core.next_deadline
    core.handle(Tick(first))
    assert set(looked) == {"/n0"} and len(looked) < 10
    del looked[:]
    core.handle(Disconnected(first, "/t5", "/n5"))
    assert len(looked) < 10


def test_only_what_changed_is_said() -> None:
    bench = many(50)
    said = bench.send(Disconnected(bench.now, "/t5", "/n5"))
    assert isinstance(said[0], HealthChanged)
    assert [each.key for each in said[0].rows] == [("/t5", "/n5")] and said[0].removed == ()
    bench.watch(
        *(service(name=f"s{i}", topic=f"/t{i}", node=f"/n{i}", period=1.0) for i in range(49))
    )
    assert bench.changes[-1].rows == () and bench.changes[-1].removed == (("/t49", "/n49"),)
