"""Kills that wait for a computer: nothing can be asked there, or it may be the network's fault."""
from dataclasses import dataclass
from typing import Dict, List

from shsa_core.healing.hosts import Hosts

CERTAIN_S = 2.0
"""A silent node is to blame once its computer was heard for so long beside its silence.

A node that is only cut off is heard again sooner, when its computer is.
"""


@dataclass
class _Awaited:
    host: str
    since: float
    silent: bool  # else it is heard again as soon as its computer is


class AwaitedKills:
    """The nodes whose kill is to be begun, or begun again, once their computer is heard."""

    def __init__(self, hosts: Hosts) -> None:
        self._hosts = hosts
        self._nodes: Dict[str, _Awaited] = {}

    def __contains__(self, node: object) -> bool:
        return node in self._nodes

    def add(self, time: float, node: str, host: str, silent: bool) -> None:
        """The kill of a node waits."""
        self._nodes[node] = _Awaited(host, time, silent)

    def forget(self, node: str) -> None:
        """The kill of a node waits no more."""
        self._nodes.pop(node, None)

    def due(self, time: float, host: str) -> List[str]:
        """The nodes on a computer that can be killed now; they wait no more."""
        if not self._hosts.reachable(host):
            return []
        steady = self._hosts.steady_since(host)
        found = [
            node
            for node, each in self._nodes.items()
            if each.host == host
            and (not each.silent or time - max(each.since, steady) >= CERTAIN_S)
        ]
        for node in found:
            del self._nodes[node]
        return found
