"""Current sensor, battery and motors against what their laws say."""
import math
from pathlib import Path

import pytest
from hypothesis import given, strategies as st
from ruamel.yaml import YAML

from shsa_rover.battery import Battery, BatteryParameters
from shsa_rover.chassis import Effort
from shsa_rover.current_sensor import CurrentSensor
from shsa_rover.motors import PowerParameters, motor_power


@given(st.floats(-37.0, 37.0))
def test_the_adc_costs_half_a_count_at_most(current: float) -> None:
    sensor = CurrentSensor()
    assert abs(sensor.amperes(sensor.counts(current)) - current) <= 0.5 * sensor.resolution + 1e-9


def test_the_current_sensor_follows_its_data_sheet() -> None:
    sensor = CurrentSensor()
    assert sensor.counts(0.0) == 512
    assert sensor.amperes(512) == 0.0
    # 66 mV/A: 10 A are 3.16 V, of 5 V and 1024 steps.
    assert sensor.counts(10.0) == round(3.16 / 5.0 * 1024)
    assert (sensor.counts(-1000.0), sensor.counts(1000.0)) == (0, 1023)


def test_the_charge_that_is_drawn_is_the_charge_that_is_lost() -> None:
    battery = Battery(0.8)
    charge = 0.0
    for second in range(3600):
        battery.draw(40.0 + 30.0 * math.sin(second / 60.0), 1.0)
        charge += battery.current
    assert battery.soc == pytest.approx(0.8 - charge / 3600.0 / 21.6, abs=1e-9)


def test_what_the_load_gets_is_what_it_asks_for() -> None:
    battery = Battery(0.6)
    for power in (0.0, 30.0, 120.0, -20.0):
        battery.draw(power, 0.0)
        assert battery.voltage * battery.current == pytest.approx(power, abs=1e-9)


def test_sag_comes_at_once_and_then_slowly() -> None:
    p = BatteryParameters()
    battery = Battery(0.8)
    rest = battery.voltage
    assert rest == pytest.approx(battery.open_circuit_voltage)
    battery.draw(100.0, 1e-6)
    assert rest - battery.voltage == pytest.approx(p.resistance * battery.current, rel=1e-3)
    for _ in range(2000):
        battery.draw(100.0, 0.1)
    sag = battery.open_circuit_voltage - battery.voltage
    assert sag == pytest.approx(p.resting_resistance * battery.current, rel=1e-3)


def test_a_battery_that_has_long_supplied_a_current_stays_where_it_is() -> None:
    battery = Battery(0.8, resting_current=2.4)
    before = battery.voltage
    battery.draw(before * 2.4, 0.01)
    assert battery.voltage == pytest.approx(before, abs=1e-5)


def test_the_open_circuit_voltage_follows_the_table() -> None:
    for soc, volts in BatteryParameters().open_circuit:
        assert Battery(soc).open_circuit_voltage == pytest.approx(volts)
    assert Battery(0.625).open_circuit_voltage == pytest.approx(12.45)


def test_more_than_the_greatest_power_gives_the_greatest_power() -> None:
    battery = Battery(0.5)
    source = battery.open_circuit_voltage
    battery.draw(1e6, 0.01)
    assert battery.current == pytest.approx(0.5 * source / battery.parameters.resistance)
    for _ in range(100000):
        battery.draw(1e6, 1.0)
    assert battery.soc == 0.0 and math.isfinite(battery.voltage)


def test_the_estimator_knows_the_battery_that_is_simulated() -> None:
    file = Path(__file__).resolve().parents[2] / "config" / "battery.yaml"
    known, p = YAML(typ="safe").load(file.read_text(encoding="utf-8")), BatteryParameters()
    assert known["capacity"] == p.capacity
    for name in ("resistance", "polarisation_resistance"):
        assert known[name] == pytest.approx(getattr(p, name))
    steps = len(known["open_circuit"]) - 1
    table = [(i / steps, volts) for i, volts in enumerate(known["open_circuit"])]
    assert table == [pytest.approx(point) for point in p.open_circuit]


def test_motors_take_what_work_and_windings_cost_and_never_give() -> None:
    p = PowerParameters()
    assert motor_power(Effort(0.0, 0.7), p) == 0.0
    pushing = motor_power(Effort(20.0, 0.5), p)
    assert pushing == pytest.approx(
        20.0 * 0.5 / p.gear_efficiency + p.armature_resistance * (20.0 / p.force_per_ampere) ** 2
    )
    assert motor_power(Effort(-20.0, -0.5), p) == pushing
    assert motor_power(Effort(-20.0, 0.5), p) == 0.0
    assert motor_power(Effort(50.0, 0.0), p) > 0.0
