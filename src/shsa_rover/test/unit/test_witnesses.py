"""The rover's current, as the monitor judges it by what its other sensors tell."""
from pathlib import Path
from typing import Dict, Iterator, List, Optional, Tuple

import pytest

from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.health import PublisherHealth
from shsa_core.monitoring.events import Connected, Message, SomChanged, Tick
from shsa_core.monitoring.evidence import checked_provisions
from shsa_core.monitoring.machine import Monitor
from shsa_rover.current_sensor import CurrentSensor
from shsa_rover.drive import SCRIPTED
from shsa_rover.odometry import Odometry
from shsa_rover.rover import Rover
from shsa_testing.failures import failures_in

MODELS = Path(__file__).resolve().parents[2] / "ontology"
STEP_S = 0.02
SENSOR = CurrentSensor()


def drive(seed: int) -> Iterator[Dict[Tuple[str, str], float]]:
    """Return the values of the rover's services in the scripted drive, each period."""
    rover, odometry, time = Rover(seed=seed), Odometry(), 0.0
    for leg in SCRIPTED:
        for _ in range(round(leg.duration / STEP_S)):
            rover.command(leg.velocity, leg.turn_rate)
            rover.step(STEP_S / 2)
            rover.step(STEP_S / 2)
            time += STEP_S
            seen = rover.measure()
            odometry.update(time, seen.wheel_velocity, seen.wheel_turn_rate, 0.001, 0.004)
            yield {
                ("amperemeter", "battery_current"): SENSOR.amperes(seen.current_counts),
                ("voltmeter", "battery_voltage"): seen.battery_voltage,
                ("odometry", "linear_velocity"): odometry.velocity,
                ("odometry", "angular_velocity"): odometry.turn_rate,
                ("acceleration", "linear_acceleration"): odometry.acceleration,
                ("acceleration", "angular_acceleration"): odometry.turn_acceleration,
                ("imu", "angular_velocity"): seen.gyroscope,
                ("imu", "specific_force"): seen.accelerometer,
                ("battery_state", "state_of_charge"): rover.truth().state_of_charge,
                ("steering", "commanded_velocity"): leg.velocity,
                ("steering", "commanded_turn_rate"): leg.turn_rate,
            }


def failures_of(seed: int, current: Optional[float], begin: float) -> List[PublisherHealth]:
    """Run the monitor on a drive in which the amperemeter says `current` from `begin` s on."""
    ontology, errors = load_ontology(str(MODELS / "rover.yaml"))
    assert not errors
    som = read_som(str(MODELS / "rover_som.yaml"))
    core, now, found = Monitor(ontology=ontology), 100.0, []
    core.handle(SomChanged(now, som))
    periods = {service.name: round((service.period or 0.0) / STEP_S) for service in som}
    for service in som:
        core.handle(Connected(now, service.topic, service.node))
    for number, says in enumerate(drive(seed)):
        now += STEP_S
        if current is not None and number * STEP_S >= begin:
            says["amperemeter", "battery_current"] = current
        said = core.handle(Tick(now))
        for service in som:
            if number % periods[service.name] == 0:
                values = tuple(
                    says[service.name, each.property] for each in checked_provisions(service)
                )
                said += core.handle(Message(now, service.topic, service.node, values))
        found += failures_in(said)
    return found


@pytest.mark.parametrize("seed", [0, 1, 2])
def test_a_drive_has_no_failure(seed: int) -> None:
    assert failures_of(seed, None, 0.0) == []


@pytest.mark.parametrize("current", [0.0, 20.0])
def test_a_current_that_is_wrong_in_its_range_is_found(current: float) -> None:
    found = failures_of(0, current, 6.0)
    assert [(each.service, str(each.kind)) for each in found[:1]] == [("amperemeter", "witness")]
    assert {each.service for each in found} == {"amperemeter"}
