"""Reading of frames from a serial port, however often it is unplugged: what gateways share."""
import errno
import os
import time
from typing import Callable, Generic, List, TypeVar

import rospy
import serial

from shsa_rover.framing import Parser

BAUD_RATE = 115200
READ_TIMEOUT_S = 0.5  # s without a byte until the line counts as silent
WRITE_TIMEOUT_S = 0.1
RETRY_DELAY_S = 0.1  # s between attempts to open the port
BACKLOG_S = 0.001  # what comes sooner after the opening has waited for it
REPORT_PERIOD_S = 5.0  # s between two lines about the same trouble

Content = TypeVar("Content")


def reason(error: OSError) -> str:
    """Return why a serial port fails, in words."""
    if error.errno == errno.EWOULDBLOCK:
        return "another process reads it, and two cannot"
    return os.strerror(error.errno) if error.errno else str(error)


class Gateway(Generic[Content]):
    """Reads the frames that `parser` finds at `port`, and hands them to `take`, oldest first.

    It waits for the port as long as it takes, and locks it: two readers of one line would each lose
    what the other one gets. `wake` is called with the line once it is open, and while no frame
    comes. `what` names the device in the log.
    """

    def __init__(
        self,
        what: str,
        port: str,
        parser: Parser[Content],
        take: Callable[[serial.Serial, List[Content]], None],
        wake: Callable[[serial.Serial], None] = lambda line: None,
    ) -> None:
        self._what = what
        self._port = port
        self._parser = parser
        self._take = take
        self._wake = wake
        self._reported_drops = 0

    def run(self) -> None:
        """Runs until the node shuts down."""
        while not rospy.is_shutdown():
            try:
                with serial.Serial(
                    self._port,
                    BAUD_RATE,
                    timeout=READ_TIMEOUT_S,
                    write_timeout=WRITE_TIMEOUT_S,
                    exclusive=True,
                ) as line:
                    rospy.loginfo("Reading the %s at %s.", self._what, self._port)
                    self._wake(line)
                    self._read(line)
            except (serial.SerialException, OSError) as error:
                rospy.logwarn_throttle(
                    REPORT_PERIOD_S, f"Waiting for the serial port {self._port}: {reason(error)}."
                )
                self._parser.reset()
                time.sleep(RETRY_DELAY_S)
        counters = self._parser.counters
        rospy.loginfo(
            "The %s sent %d frames; %d bytes dropped.",
            self._what,
            counters.frames,
            counters.dropped_bytes,
        )

    def _read(self, line: serial.Serial) -> None:
        news = False  # a backlog is none
        last = time.monotonic()
        while not rospy.is_shutdown():
            asked = time.monotonic()
            data = line.read(max(1, line.in_waiting))
            now = time.monotonic()
            news = news or now - asked > BACKLOG_S
            if not data:
                rospy.logwarn_throttle(
                    REPORT_PERIOD_S, f"The serial port {self._port} is open but silent."
                )
            frames = self._parser.feed(data)
            if frames and news:
                self._take(line, frames)
            if frames:
                last = now
            elif now - last >= READ_TIMEOUT_S:
                last = now
                self._wake(line)
            self._report_drops()

    def _report_drops(self) -> None:
        counters = self._parser.counters
        if counters.dropped_bytes != self._reported_drops:
            self._reported_drops = counters.dropped_bytes
            rospy.logwarn_throttle(
                REPORT_PERIOD_S,
                f"{counters.dropped_bytes} bytes dropped since the start: {counters.reasons}"
                f" (serial port {self._port})",
            )
