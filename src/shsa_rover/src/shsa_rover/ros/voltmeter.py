"""`voltmeter`: the gateway from the microcontroller's serial line to `/battery_voltage`."""
from shsa_core.ros.node import run
from shsa_rover.frame import VOLTAGE
from shsa_rover.ros.analog import publish_channel
from shsa_rover.sensors import SensorParameters
from shsa_rover.voltage_sensor import VoltageSensor


def serve() -> None:
    """Publishes volts until the node shuts down."""
    variance = SensorParameters().voltage_variance
    publish_channel(VOLTAGE, "battery_voltage", VoltageSensor().volts, variance)


def main() -> None:
    """The node's entry point."""
    run("voltmeter", serve)
