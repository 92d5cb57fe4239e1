"""The stamp of a substitute's message: the time of the data that it stands on."""
from typing import Dict, Optional


class Stamps:
    """Stamps in ns of ROS time; 0: not known, or none.

    A stamp is never newer than now, and on one topic none is older than the one before, be that
    the original's. Where both cannot be, as when ROS time was set back, it is not newer than now.
    """

    def __init__(self) -> None:
        self._latest: Dict[str, int] = {}
        self._ahead: Optional[int] = None  # ROS time less the clock of the events

    def clock(self, time: float, ros_time: int) -> None:
        """It is `ros_time` at the `time` of an event; 0: that is not known."""
        if ros_time:
            self._ahead = ros_time - _ns(time)

    def begin(self, topic: str, stamp: int) -> None:
        """The last good message of a topic had this stamp."""
        self._latest[topic] = max(stamp, self._latest.get(topic, 0))

    def latest(self, topic: str) -> int:
        """The newest stamp on a topic; 0: none yet."""
        return self._latest.get(topic, 0)

    def of(self, topic: str, oldest: int, time: float) -> int:
        """The stamp of a message that is made now.

        `oldest` is that of the oldest input; 0: there is no input.
        """
        now = oldest if self._ahead is None else _ns(time) + self._ahead
        stamp = min(max(oldest or now, self.latest(topic)), now)
        self._latest[topic] = stamp
        return stamp


def _ns(time: float) -> int:
    return int(round(time * 1e9))
