"""`amperemeter`: the gateway from the microcontroller's serial line to `/battery_current`."""
import os
import time

import rospy
import serial
from shsa_msgs.msg import Float64Stamped

from shsa_core.ros.node import run
from shsa_rover.current_sensor import CurrentSensor
from shsa_rover.frame import Parser
from shsa_rover.sensors import SensorParameters, quantisation_variance
from shsa_rover.ros.parameters import flag_parameter, text_parameter

BAUD_RATE = 115200
READ_TIMEOUT_S = 0.5  # s without a byte until the line counts as silent
RETRY_DELAY_S = 0.1  # s between attempts to open the port
REPORT_PERIOD_S = 5.0  # s between two lines about the same trouble


class Amperemeter:
    """Reads frames and publishes amperes; waits for the port as long as it takes."""

    def __init__(self) -> None:
        self._port = text_parameter("~port")
        self._sensor = CurrentSensor()
        noise = SensorParameters().current_noise
        self._variance = noise**2 + quantisation_variance(self._sensor.resolution)
        self._parser = Parser(flag_parameter("~checksum", False))
        self._publisher = rospy.Publisher("battery_current", Float64Stamped, queue_size=10)
        self._reported_drops = 0
        self._stale_frames = 0

    def run(self) -> None:
        """Runs until the node shuts down."""
        while not rospy.is_shutdown():
            try:
                with serial.Serial(self._port, BAUD_RATE, timeout=READ_TIMEOUT_S) as line:
                    rospy.loginfo("Reading the current sensor at %s.", self._port)
                    self._read(line)
            except (serial.SerialException, OSError) as error:
                reason = os.strerror(error.errno) if error.errno else str(error)
                rospy.logwarn_throttle(
                    REPORT_PERIOD_S, f"Waiting for the serial port {self._port}: {reason}."
                )
                self._parser.reset()
                time.sleep(RETRY_DELAY_S)
        rospy.loginfo(
            "The amperemeter read %d frames; %d bytes dropped, %d frames too old.",
            self._parser.counters.frames,
            self._parser.counters.dropped_bytes,
            self._stale_frames,
        )

    def _read(self, line: serial.Serial) -> None:
        while not rospy.is_shutdown():
            data = line.read(max(1, line.in_waiting))
            if not data:
                rospy.logwarn_throttle(
                    REPORT_PERIOD_S, f"The serial port {self._port} is open but silent."
                )
            frames = self._parser.feed(data)
            if frames:
                # Frames that waited are no news: only the newest one is the current now.
                self._stale_frames += len(frames) - 1
                current = self._sensor.amperes(frames[-1].channels[0])
                message = Float64Stamped(data=current, variance=self._variance)
                message.header.stamp = rospy.Time.now()
                message.header.frame_id = "battery"
                self._publisher.publish(message)
            self._report_drops()

    def _report_drops(self) -> None:
        dropped = self._parser.counters.dropped_bytes
        if dropped != self._reported_drops:
            self._reported_drops = dropped
            reasons = ", ".join(
                f"{n} {why}" for why, n in self._parser.counters.dropped.items() if n
            )
            rospy.logwarn_throttle(
                REPORT_PERIOD_S, f"{dropped} bytes dropped since the start: {reasons}"
            )


def main() -> None:
    """The node's entry point."""
    run("amperemeter", lambda: Amperemeter().run())
