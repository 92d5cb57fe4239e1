"""REP 117: a lidar that sees nothing, or of which one reading is of no use, is well."""
from math import inf, nan
from typing import Any, Dict

import pytest
from monitor_bench import NODE, TOPIC, Bench

from shsa_core.files.document import from_parameters
from shsa_core.files.som_file import merge_parameters, read_tree, som_parameters
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.events import Message


def lidar(**checks: Any) -> Service:
    """A lidar as the SOM describes it, with these checks of its value."""
    value: Dict[str, Any] = {"field": "min(ranges[10:50])", "range": [0.1, 10.0], "checks": checks}
    entry: Dict[str, Any] = {
        "topic": "/scan",
        "type": "sensor_msgs/LaserScan",
        "node": "/lidar",
        "period": 0.02,
    }
    tree = {"services": {"lidar": {**entry, "provides": {"distance": value}}}}
    som, errors = read_tree(from_parameters(tree, "som"))
    assert errors == []
    (found,) = som
    return found


def after(service: Service, *values: float) -> Bench:
    """The bench after half a second of each value."""
    bench = Bench(service)
    bench.connect("/lidar", "/scan")
    for value in values:
        for _ in range(25):
            bench.now += 0.02
            bench.message(value, "/lidar", "/scan")
    return bench


@pytest.mark.parametrize("value", [inf, -inf, nan])
def test_a_distance_that_is_no_number_is_no_evidence(value: float) -> None:
    assert after(lidar(), value).failures == []
    assert after(lidar(stuck=0.1), value).failures == []
    assert after(lidar(jump=1.0), 3.0, value, 9.0).failures == []


def test_a_distance_out_of_its_range_still_is() -> None:
    assert after(lidar(), 11.0).kinds() == [("/lidar", "out_of_range")]


def test_a_distance_that_jumps_or_is_stuck_still_is() -> None:
    assert after(lidar(stuck=0.1), 3.0).kinds() == [("/lidar", "stuck")]
    assert after(lidar(jump=1.0), 3.0, 9.0).kinds() == [("/lidar", "jump")]


def test_who_asks_for_numbers_gets_them() -> None:
    for value in (inf, nan):
        assert after(lidar(not_a_number=True), value).kinds() == [("/lidar", "not_a_number")]


@pytest.mark.parametrize("checks", [{}, {"not_a_number": True}, {"not_a_number": False}])
def test_what_was_asked_for_outlasts_the_parameter_server(checks: Any) -> None:
    som = Som([lidar(**checks)])
    assert merge_parameters(som, som_parameters(som)) == (som, [])


def test_a_message_that_does_not_name_a_value_is_no_evidence() -> None:
    bench = Bench()
    bench.connect()
    for _ in range(20):
        bench.now += 0.02
        bench.send(Message(bench.now, TOPIC, NODE, (None,)))
    assert bench.failures == [] and bench.state() == "healthy"


def test_other_values_must_be_numbers_as_ever() -> None:
    bench = Bench()
    bench.connect()
    for _ in range(20):
        bench.now += 0.02
        bench.message(inf)
    assert [kind for _, kind in bench.kinds()] == ["not_a_number"]
