"""A fault of the serial line, inside the node that reads it: received bytes pass through it."""
import math
import sys
import threading
import time
from typing import Any, Dict, Mapping

from shsa_core.errors import ShsaError
from shsa_injection.line_faults import line_fault

_begun = threading.Lock()


class ReadingFault:
    """Lets what this process reads by pyserial pass through a fault, from `begin` to `end`.

    A request has `fault`, `seed` and `seconds` (None: until its end). It works on a real port as
    on a simulated one.
    """

    def __init__(self, request: Mapping[str, Any]) -> None:
        self._word = str(request["fault"])
        self._seconds = request["seconds"]
        self._fault = line_fault(self._word, int(request["seed"]))
        self.detail = self._fault.detail
        self._serial: Any = sys.modules.get("serial")
        if self._serial is None:
            raise ShsaError("this process reads no serial line: it has not loaded pyserial")
        self._on = False
        self._counts = {"came": 0, "received": 0}

    def begin(self) -> float:
        """Fail from now on; until when, in s of the monotonic clock."""
        if not _begun.acquire(blocking=False):
            raise ShsaError("the serial line fails already")
        line, self._on = self._serial.Serial, True
        self._own_read, self._own_open = line.read, line.open

        def read(port: Any, size: int = 1) -> bytes:
            return self._read(port, size)

        def open_(port: Any) -> None:
            self._open(port)

        line.read, line.open = read, open_
        return math.inf if self._seconds is None else time.monotonic() + float(self._seconds)

    def end(self) -> Dict[str, int]:
        """Be well again; how many bytes came, and how many were received."""
        self._on = False
        line = self._serial.Serial
        line.read, line.open = self._own_read, self._own_open
        _begun.release()
        return self._counts

    def _read(self, port: Any, size: int) -> bytes:
        """Replaces pyserial's method: as many bytes, as long a wait."""
        end = math.inf if port.timeout is None else time.monotonic() + port.timeout
        while True:
            data: bytes = self._own_read(port, size)
            if not self._on:
                return data
            self._counts["came"] += len(data)
            received = self._fault.feed(data)
            if received is None:
                raise self._serial.SerialException("the port is unplugged (an injected fault)")
            self._counts["received"] += len(received)
            if received or time.monotonic() >= end:
                return received

    def _open(self, port: Any) -> None:
        if self._on and self._word == "serial_unplug":
            raise self._serial.SerialException("the port is unplugged (an injected fault)")
        self._own_open(port)
