"""Gateways of what the microcontroller samples: one channel of its frames becomes a topic."""
from typing import Callable, List

import rospy
import serial
from shsa_msgs.msg import Float64Stamped

from shsa_rover.frame import Frame, Parser
from shsa_rover.ros.gateway import REPORT_PERIOD_S, Gateway
from shsa_rover.ros.parameters import flag_parameter, text_parameter


def publish_channel(
    channel: int, topic: str, value_of: Callable[[int], float], variance: float
) -> None:
    """Publish `value_of` the counts of a channel, with their time of arrival, until the shutdown.

    The microcontroller only sends, so its wire goes to as many receivers as there are gateways.
    """
    port = text_parameter("~port")
    publisher = rospy.Publisher(topic, Float64Stamped, queue_size=10)

    def take(_: serial.Serial, frames: List[Frame]) -> None:
        # Frames that waited are no news: only the newest one is the value now.
        channels = frames[-1].channels
        if len(channels) <= channel:
            rospy.logwarn_throttle(
                REPORT_PERIOD_S,
                f"Nothing for {topic}: the frames at {port} have {len(channels)} channels;"
                f" channel {channel} is needed.",
            )
            return
        message = Float64Stamped(data=value_of(channels[channel]), variance=variance)
        message.header.stamp = rospy.Time.now()
        message.header.frame_id = "battery"
        publisher.publish(message)

    Gateway("microcontroller", port, Parser(flag_parameter("~checksum", False)), take).run()
