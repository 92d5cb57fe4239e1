"""`amperemeter`: the gateway from the microcontroller's serial line to `/battery_current`."""
from shsa_core.ros.node import run
from shsa_rover.current_sensor import CurrentSensor
from shsa_rover.frame import CURRENT
from shsa_rover.ros.analog import publish_channel
from shsa_rover.sensors import SensorParameters, quantisation_variance


def serve() -> None:
    """Publishes amperes until the node shuts down."""
    sensor = CurrentSensor()
    noise = SensorParameters().current_noise
    variance = noise**2 + quantisation_variance(sensor.resolution)
    publish_channel(CURRENT, "battery_current", sensor.amperes, variance)


def main() -> None:
    """The node's entry point."""
    run("amperemeter", serve)
