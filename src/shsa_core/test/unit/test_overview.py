"""Diagnostics of each service: its state by all its publishers."""
from dataclasses import replace
from types import SimpleNamespace
from typing import Any, Dict, List, Tuple

import pytest
from diagnostic_msgs.msg import DiagnosticStatus
from monitor_bench import NODE, PERIOD, TOPIC, Bench, provision, row, service, streaming

from shsa_core.analysis.registrations import NOTHING
from shsa_core.healing.incident import Incident, State
from shsa_core.model.kinds import Kind
from shsa_core.model.service import AdaptiveDeadline
from shsa_core.monitoring.events import ClockTicked, Message, SubstitutionsChanged
from shsa_core.monitoring.overview import Condition, ServiceHealth
from shsa_core.ros import diagnostics
from shsa_core.ros.diagnostics import ERROR, OK, WARN, MonitorRows, healing_rows

SUBSTITUTE, IDLE, STRANGER = "/substitute_current_1", "/substitute_standby_2", "/stranger"


@pytest.fixture
def bench() -> Bench:
    """The amperemeter publishes well."""
    return streaming()


def shown(bench: Bench) -> ServiceHealth:
    """The only service."""
    (health,) = bench.core.overview()
    return health


def publishers(bench: Bench) -> List[str]:
    return [each.publisher for each in shown(bench).publishers]


def statuses(bench: Bench, rows: MonitorRows) -> Dict[str, DiagnosticStatus]:
    """The monitor's rows as they are published."""
    return {each.name: each for each in rows(bench.core.overview())}


def level(bench: Bench) -> int:
    return int(statuses(bench, MonitorRows())["current"].level)


def substituted() -> Bench:
    """Its node is gone, and a substitute publishes."""
    bench = Bench()
    bench.connect()
    bench.stream(60)
    bench.connect(SUBSTITUTE)
    bench.disconnect()
    bench.substitutes((SUBSTITUTE, True))
    bench.stream(60, SUBSTITUTE)
    return bench


def test_a_service_that_does_well_is_healthy(bench: Bench) -> None:
    assert shown(bench).condition is Condition.HEALTHY
    assert (level(bench), publishers(bench)) == (OK, [NODE])


def test_who_has_not_published_yet_is_starting() -> None:
    bench = Bench()
    assert (shown(bench).condition, level(bench)) == (Condition.STARTING, WARN)
    assert publishers(bench) == []  # the publisher without a name is nobody's value
    bench.connect()
    assert (shown(bench).condition, publishers(bench)) == (Condition.STARTING, [NODE])


def test_who_never_published_is_lost() -> None:
    bench = Bench()
    bench.wait(60.0)
    assert (shown(bench).condition, level(bench)) == (Condition.LOST, ERROR)
    assert shown(bench).detail.startswith("nobody publishes: ")


@pytest.mark.parametrize("fault", ["silent", "node_gone", "out_of_range"])
def test_a_failed_service_that_nobody_heals_is_lost(bench: Bench, fault: str) -> None:
    if fault == "silent":
        bench.wait(1.0)
    elif fault == "node_gone":
        bench.disconnect()
    else:
        bench.stream(20, value=1000.0)
    assert (shown(bench).condition, level(bench)) == (Condition.LOST, ERROR)
    assert NODE in shown(bench).detail
    (row,) = shown(bench).publishers
    assert str(row.kind) == fault


def test_a_service_whose_substitute_publishes_is_substituted() -> None:
    bench = substituted()
    assert (shown(bench).condition, level(bench)) == (Condition.SUBSTITUTED, WARN)
    assert shown(bench).detail.startswith(f"by {SUBSTITUTE}; {NODE}: ")
    assert publishers(bench) == [NODE, SUBSTITUTE]


def test_a_node_that_is_kept_silent_is_substituted_too(bench: Bench) -> None:
    bench.connect(SUBSTITUTE)
    bench.wait(1.0)
    assert level(bench) == ERROR
    bench.substitutes((SUBSTITUTE, True))
    bench.stream(60, SUBSTITUTE)
    assert (shown(bench).condition, level(bench)) == (Condition.SUBSTITUTED, WARN)


def test_a_node_that_is_kept_with_wrong_values_is_lost_whoever_stands_by(bench: Bench) -> None:
    bench.connect(SUBSTITUTE)
    bench.substitutes((SUBSTITUTE, False))
    bench.stream(60, value=1000.0)
    assert (shown(bench).condition, level(bench)) == (Condition.LOST, ERROR)
    assert publishers(bench) == [NODE]


def test_a_substitute_that_fails_leaves_the_service_lost() -> None:
    bench = substituted()
    bench.disconnect(SUBSTITUTE)
    assert (shown(bench).condition, level(bench)) == (Condition.LOST, ERROR)


def test_a_stranger_who_sends_nonsense_makes_a_healthy_service_doubtful(bench: Bench) -> None:
    bench.connect(STRANGER)
    for _ in range(60):
        bench.stream(1, STRANGER, value=1000.0, period=PERIOD / 2)
        bench.stream(1, period=PERIOD / 2)
    assert (shown(bench).condition, level(bench)) == (Condition.DOUBTFUL, WARN)
    assert STRANGER in shown(bench).detail
    bench.disconnect(STRANGER)
    assert shown(bench).condition is Condition.HEALTHY


def test_who_stands_by_is_not_listed(bench: Bench) -> None:
    idle = row(IDLE, False, TOPIC, service="")
    bench.send(SubstitutionsChanged(bench.now, (idle, row(SUBSTITUTE, False, TOPIC))))
    bench.connect(IDLE)
    bench.connect(SUBSTITUTE)
    bench.stream(20)
    assert (shown(bench).condition, publishers(bench)) == (Condition.HEALTHY, [NODE])
    bench.disconnect()
    assert publishers(bench) == [NODE]


def test_services_that_share_a_topic_do_each_as_their_own_node_does() -> None:
    left = service(name="left", topic="/joints", node="/left")
    value = provision(property="other", field="other")
    bench = Bench(left, service(value, name="right", topic="/joints", node="/right"))
    for node in ("/left", "/right"):
        bench.connect(node, "/joints")
    for _ in range(60):
        bench.stream(1, "/left", topic="/joints", period=PERIOD / 2)
        bench.stream(1, "/right", topic="/joints", period=PERIOD / 2)
    bench.disconnect("/right", "/joints")
    found = {each.service.name: each for each in bench.core.overview()}
    conditions = {name: each.condition for name, each in found.items()}
    assert conditions == {"left": Condition.HEALTHY, "right": Condition.LOST}
    assert [each.publisher for each in found["left"].publishers] == ["/left"]
    bench.connect(STRANGER, "/joints")
    bench.stream(60, STRANGER, topic="/joints")
    for each in bench.core.overview():
        assert STRANGER in [row.publisher for row in each.publishers]


def test_a_row_has_its_publishers_as_values(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, rows = substituted(), MonitorRows()
    monkeypatch.setattr(diagnostics.clock, "now", lambda: bench.now)
    statuses(bench, rows)
    bench.stream(50, SUBSTITUTE)
    status = statuses(bench, rows)["current"]
    assert (status.hardware_id, status.message.split(":")[0]) == (NODE, "substituted")
    values = {each.key: each.value for each in status.values}
    assert list(values) == ["topic", NODE, SUBSTITUTE, "battery_current"]
    assert values["topic"] == TOPIC
    assert values[NODE].startswith("failed, node_gone")
    assert values[SUBSTITUTE] == "healthy, 50.0 Hz, last good message 0.00 s ago"


def test_a_row_has_the_deadline_that_is_learned() -> None:
    bench = Bench(service(deadline=AdaptiveDeadline(0.01)))
    found = {each.key: each.value for each in statuses(bench, MonitorRows())["current"].values}
    assert found["deadline"] == (
        "0.100 s, the fixed deadline until 18000 gaps are known, 0 are so far"
    )


def test_a_row_has_the_newest_values_of_who_is_healthy() -> None:
    bench = substituted()
    bench.stream(50, SUBSTITUTE, value=2.5)
    found = {each.key: each.value for each in statuses(bench, MonitorRows())["current"].values}
    assert found["battery_current"] == "2.5"


def test_a_value_that_nobody_tells_is_not_in_the_row() -> None:
    bench = substituted()
    bench.stream(50, SUBSTITUTE)
    for told in ((None,), None):
        bench.send(Message(bench.now, TOPIC, SUBSTITUTE, told))
        status = statuses(bench, MonitorRows())["current"]
        assert "battery_current" not in {each.key for each in status.values}


def test_the_last_good_message_is_as_old_as_it_is_while_simulated_time_stands(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    bench = Bench()
    monkeypatch.setattr(diagnostics.clock, "now", lambda: bench.now)
    bench.send(ClockTicked(bench.now, 0.0, simulated=True))
    bench.connect()
    bench.stream(10)
    bench.wait(5.0)
    bench.send(ClockTicked(bench.now, 0.0, simulated=True))
    bench.stream(1)
    found = {each.key: each.value for each in statuses(bench, MonitorRows())["current"].values}
    assert found[NODE].endswith("last good message 0.00 s ago")


def test_no_row_is_missed_by_an_analyzer_after_a_return() -> None:
    """As any analyzer does, it keeps the last level of each name that it has ever seen."""
    bench, rows = Bench(), MonitorRows()
    seen: Dict[str, Tuple[float, int]] = {}

    def look() -> None:
        for name, status in statuses(bench, rows).items():
            seen[name] = (bench.now, status.level)

    look()
    bench.connect()
    bench.stream(60)
    look()
    bench.connect(SUBSTITUTE)
    bench.disconnect()
    look()
    assert seen == {"current": (bench.now, ERROR)}
    bench.substitutes((SUBSTITUTE, True))
    bench.stream(60, SUBSTITUTE)
    look()
    assert seen == {"current": (bench.now, WARN)}
    bench.connect()
    bench.stream(20)
    bench.substitutes()
    bench.disconnect(SUBSTITUTE)
    bench.stream(60)
    look()
    assert seen == {"current": (bench.now, OK)}


def incident(state: State) -> Incident:
    made = Incident(1, "current", TOPIC, ("battery_current",), NODE, Kind.SILENT, "x", 1.0)
    return replace(made, state=state, substitute=SUBSTITUTE)


DOES = ("takes /cmd_vel", "broadcasts tf")


@pytest.mark.parametrize(
    "state, expected",
    [
        (State.HEALING, WARN),
        (State.HEALED, WARN),
        (State.RETURNING, OK),
        (State.UNHEALED, ERROR),
        (State.SAFE, ERROR),
        (State.KEPT, ERROR),
    ],
)
def test_a_row_of_healing_is_named_after_the_service(state: State, expected: int) -> None:
    current = replace(service(), needed=True)
    other = replace(current, name="other")
    open_ = {"current": incident(state)}
    watch: Any = SimpleNamespace(answers=True, hung=[], known=NOTHING, kept_at=0.0)
    first, second, maintenance, master = healing_rows(
        ([current, other], open_, watch, (), {NODE: DOES}, state is State.KEPT)
    )
    assert maintenance.name == "maintenance"
    assert maintenance.level == (WARN if state is State.KEPT else OK)
    assert (master.name, master.level) == ("ROS master", OK)
    assert (first.name, first.level, first.hardware_id) == ("current", expected, NODE)
    assert first.message == f"{state}: x"
    assert [each.value for each in first.values if each.key == "substitute"] == [SUBSTITUTE]
    assert (second.name, second.level, second.message) == ("other", OK, "well")
    for each in (first, second):
        assert ("its node also", " and ".join(DOES)) in [(v.key, v.value) for v in each.values]


def test_what_live_parameters_allow_is_a_warning_until_it_is_taken_back() -> None:
    bench, rows = streaming(), MonitorRows()
    bench.watch(service(provision(range=(-5.0, 90.0)), weakened="range: 90"))
    status = statuses(bench, rows)["current"]
    assert status.level == WARN and "allows more than the SOM file: range: 90" in status.message
    assert {e.key: e.value for e in status.values}["allows more than the SOM file"] == "range: 90"
    bench.watch(service())
    status = statuses(bench, rows)["current"]
    assert (status.level, status.message) == (OK, "healthy")
    assert not any("allows" in each.key for each in status.values)
