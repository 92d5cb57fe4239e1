"""`rover_simulator`: stands for the rover's hardware, in real time."""
import time
from contextlib import ExitStack, closing
from dataclasses import asdict, replace

import rospy
from shsa_msgs.msg import Float64Stamped

from shsa_core.ros.node import run
from shsa_rover import frame, imu_sentence
from shsa_rover.pioneer_base import PioneerBase
from shsa_rover.pseudo_terminal import PseudoTerminal
from shsa_rover.ros.parameters import flag_parameter, number_parameter, text_parameter
from shsa_rover.rover import Rover, Truth
from shsa_rover.worlds import GREATEST_PAYLOAD, STEEPEST, World, named_world

STEP_S = 0.01
STEPS_PER_SAMPLE = 2
LONGEST_BACKLOG_S = 0.5


def world_parameters(seed: int) -> World:
    """Return the world of the name in `~world`, with what other parameters say of it."""
    world = named_world(text_parameter("~world", "as_fitted"), seed)
    return replace(
        world,
        payload=number_parameter("~payload", world.payload, 0.0, GREATEST_PAYLOAD),
        floor=text_parameter("~floor", world.floor),
        slope=number_parameter("~slope", world.slope, 0.0, STEEPEST),
        state_of_charge=number_parameter("~state_of_charge", world.state_of_charge, 0.05, 1.0),
    )


class Lines:
    """The serial lines of the hardware, as pseudo-terminals.

    The microcontroller only sends: its wire goes to both computers, and `microcontroller` has a
    port for each of them.
    """

    def __init__(self, ports: ExitStack) -> None:
        first = text_parameter("~port")

        def plug_in(name: str) -> PseudoTerminal:
            port = text_parameter(f"~{name}_port", f"{first}_{name}")
            return ports.enter_context(closing(PseudoTerminal(port)))

        self.microcontroller = (
            ports.enter_context(closing(PseudoTerminal(first))),
            plug_in("voltage"),
        )
        self.base = plug_in("base")
        self.imu = plug_in("imu")


class Simulator:
    """Steps the rover, and plays its microcontroller, its base and its IMU on their lines."""

    def __init__(self) -> None:
        seed = int(number_parameter("~seed", 0, 0, 2**31))
        self._rover = Rover(seed, world=world_parameters(seed))
        self._base = PioneerBase()
        self._checked = flag_parameter("~checksum", False)
        self._truth = {
            name: rospy.Publisher(f"simulation/{name}", Float64Stamped, queue_size=10)
            for name in Truth.__dataclass_fields__
        }

    def run(self) -> None:
        """Runs until the node shuts down; the lines' links are removed at the end."""
        with ExitStack() as ports:
            lines = Lines(ports)
            rospy.loginfo(
                "The simulated rover is ready. Its microcontroller is at %s, its base at %s, its"
                " IMU at %s.",
                " and ".join(line.link for line in lines.microcontroller),
                lines.base.link,
                lines.imu.link,
            )
            self._loop(lines)

    def _loop(self, lines: Lines) -> None:
        period = STEP_S * STEPS_PER_SAMPLE
        due = time.monotonic()
        while not rospy.is_shutdown():
            self._sample(lines)
            due += period
            wait = due - time.monotonic()
            if wait > 0.0:
                time.sleep(wait)
            elif -wait > LONGEST_BACKLOG_S:
                rospy.logwarn("The simulation was held up for %.1f s, which it skips.", -wait)
                due = time.monotonic()

    def _sample(self, lines: Lines) -> None:
        heard = self._base.heard
        lines.base.write(self._base.feed(lines.base.read()))
        if self._base.heard != heard:  # which also resets its watchdog
            self._rover.command(self._base.velocity, self._base.turn_rate)
        for _ in range(STEPS_PER_SAMPLE):
            self._rover.step(STEP_S)
        self._send(lines)
        stamp = rospy.Time.now()
        for name, value in asdict(self._rover.truth()).items():
            publisher = self._truth[name]
            if publisher.get_num_connections():
                message = Float64Stamped(data=value)
                message.header.stamp = stamp
                publisher.publish(message)

    def _send(self, lines: Lines) -> None:
        seen = self._rover.measure()
        counts = frame.encode([seen.current_counts, seen.voltage_counts], self._checked)
        for line in lines.microcontroller:
            line.write(counts)
        lines.base.write(self._base.report(seen.left_speed, seen.right_speed, seen.battery_voltage))
        reading = imu_sentence.ImuReading(seen.gyroscope, seen.accelerometer)
        lines.imu.write(imu_sentence.encode(reading))


def main() -> None:
    """The node's entry point."""
    run("rover_simulator", lambda: Simulator().run())
