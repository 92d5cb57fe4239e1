"""Measures how busy this computer is."""
from typing import List

import psutil

from shsa_core.ros import settings


class Load:
    """The load at the last look.

    `busy`: busy cores, of `cores`. `sent`, `received`: bytes/s on all networks but the computer's
    own.
    """

    def __init__(self) -> None:
        self.cores = float(psutil.cpu_count() or 1)
        self.busy = self.sent = self.received = 0.0
        psutil.cpu_percent()
        self._looked = float("-inf")
        self._counted = _counters()

    def look(self, now: float) -> None:
        """Look, if it is time to; `now`: s."""
        elapsed = now - self._looked
        if elapsed < settings.LOOK_S:
            return
        counted, before = _counters(), self._counted
        self.busy = psutil.cpu_percent() / 100.0 * self.cores
        self.sent, self.received = ((new - old) / elapsed for new, old in zip(counted, before))
        self._looked, self._counted = now, counted


def _counters() -> List[int]:
    """Bytes sent and received so far."""
    links = [each for name, each in psutil.net_io_counters(pernic=True).items() if name != "lo"]
    return [sum(each.bytes_sent for each in links), sum(each.bytes_recv for each in links)]
