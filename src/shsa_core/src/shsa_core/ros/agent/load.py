"""Measures how busy this computer is, and finds its addresses."""
import socket
from typing import List, Set
from urllib.parse import urlparse

import psutil
import rosgraph.network
import rospy

from shsa_core.ros import settings


class Load:
    """The load and the addresses at the last look.

    `busy`: busy cores, of `cores`. `sent`, `received`: bytes/s on all networks but the computer's
    own. `addresses`: names and numbers, first the one that we are known by.
    """

    def __init__(self) -> None:
        self.cores = float(psutil.cpu_count() or 1)
        self.busy = self.sent = self.received = 0.0
        self.addresses = _addresses()
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
        self.addresses = _addresses()
        self._looked, self._counted = now, counted


def _counters() -> List[int]:
    """Bytes sent and received so far."""
    links = [each for name, each in psutil.net_io_counters(pernic=True).items() if name != "lo"]
    return [sum(each.bytes_sent for each in links), sum(each.bytes_recv for each in links)]


def _addresses() -> List[str]:
    ours = urlparse(rospy.get_node_uri() or "").hostname or rosgraph.network.get_host_name()
    others: Set[str] = {socket.gethostname()}
    for found in psutil.net_if_addrs().values():
        for each in found:
            if each.family in (socket.AF_INET, socket.AF_INET6):
                others.add(each.address.split("%")[0])
    loopback = {each for each in others if each.startswith("127.") or each == "::1"}
    return [ours, *sorted(others - loopback - {ours})]
