"""The cost of a substitute: its share of a core, and the bytes of its messages on a link.

Estimates by measured figures, which docs/explanation/experiments.md has with their measurement.
"""
from dataclasses import dataclass
from typing import Collection, Dict, Iterable, Optional

from shsa_core.model.service import Service

PROCESS_CORES = 0.003
"""A substitute's process, before anything comes or goes: its heartbeat, and threads that wait."""
READ_CORE_S = 0.0002
"""For each message that is read, in s of a core."""
WRITTEN = 1.75
"""A message that is computed and published costs as much as so many that are read."""
EVENT_RATE_HZ = 10.0
"""An event-driven topic is taken to publish so often."""
FRAME_BYTES = 70
"""A message has these beside it: its length, and headers of TCP, IP and Ethernet."""
MESSAGE_BYTES: Dict[str, int] = {
    "std_msgs/Float64": 8,
    "std_msgs/Float32": 4,
    "shsa_msgs/Float64Stamped": 24,
    "nav_msgs/Odometry": 712,
    "sensor_msgs/Imu": 328,
    "sensor_msgs/BatteryState": 100,
    "sensor_msgs/JointState": 150,
    "sensor_msgs/LaserScan": 6000,
    "geometry_msgs/Twist": 48,
    "geometry_msgs/TwistStamped": 72,
    "geometry_msgs/AccelStamped": 72,
    "geometry_msgs/PoseStamped": 80,
}
"""A message of each type in bytes, serialized, with a frame's name of 8 letters."""
OTHER_BYTES = 256  # of a message of any other type


@dataclass(frozen=True)
class Host:
    """One computer of the robot: its CPUs, and what its link carries in bytes/s; None: any."""

    name: str
    cores: Optional[float] = None
    link: Optional[float] = None


@dataclass(frozen=True)
class Cost:
    """`cores` of a computer, and bytes/s of its network `link`."""

    cores: float
    link: float = 0.0


def rate(service: Service) -> float:
    """Return the rate at which a service publishes, in Hz."""
    return 1.0 / service.period if service.period else EVENT_RATE_HZ


def traffic(service: Service) -> float:
    """Return the bytes/s of a service on a link, each time that it crosses it."""
    return rate(service) * (MESSAGE_BYTES.get(service.type, OTHER_BYTES) + FRAME_BYTES)


def cost(inputs: Iterable[Service], output: Service, here: Collection[str]) -> Cost:
    """Return the cost of a substitute on a computer, which services call one of `here`.

    What comes from elsewhere crosses its link, and so does the output. A service counts once.
    """
    idle = idle_cost(inputs, here)
    return Cost(idle.cores + WRITTEN * READ_CORE_S * rate(output), idle.link + traffic(output))


def idle_cost(inputs: Iterable[Service], here: Collection[str]) -> Cost:
    """Return the cost of an idle process for plans that read `inputs`."""
    read = {each.name: each for each in inputs}.values()
    crossing = sum(traffic(each) for each in read if each.host not in here)
    return Cost(PROCESS_CORES + READ_CORE_S * sum(map(rate, read)), crossing)
