"""Which hot substitutes share a process, where there are more than are given one each."""
from typing import Dict, NamedTuple, Optional, Set

from shsa_core.codegen.plans import Plan
from shsa_core.model.service import Service


class Shared(NamedTuple):
    """A process that several substitutes share; `new`: it is to be started."""

    node: str
    new: bool


class Sharing:
    """The hot substitutes on the reconfigurator's own computer, by process.

    The first `most` have a process each; those after them share processes of so many at most. None
    share one whose services the same node publishes: so no single fault has two of a process
    publish, and the end of a process takes no more away than where each has its own.
    """

    def __init__(self, most: int) -> None:
        self._most = most
        self._alone: Set[str] = set()  # services
        self._shared: Dict[str, Dict[str, str]] = {}  # by process: services, and whose they are
        self._process: Dict[str, str] = {}  # by service
        self._roomy: Dict[str, None] = {}  # processes that another one may join

    def place(self, service: Service, plan: Plan, fresh: str) -> Optional[Shared]:
        """Which process the substitute of a service shares; None: it is given its own.

        `fresh`: the name of a new one. What is latched, or comes at no period, is told once to a
        process: who joins later would not hear it.
        """
        crowded = 0 < self._most <= len(self._alone - {service.name})
        if not crowded or any(source.service.period is None for source in plan.inputs):
            return None
        for node in self._roomy:
            if service.node not in self._shared[node].values():
                return Shared(node, False)
        return Shared(fresh, True)

    def follow(self, service: Service, node: str, shared: bool) -> None:
        """The hot substitute of a service is in a process now; without one: it has none."""
        name = service.name
        self._alone.discard(name)
        self._leave(name)
        if shared:
            services = self._shared.setdefault(node, {})
            services[name] = service.node
            self._process[name] = node
            self._roomy[node] = None
            if len(services) >= self._most:
                del self._roomy[node]
        elif node:
            self._alone.add(name)

    def others(self, service: str, node: str) -> bool:
        """Whether a process is that of other services as well."""
        return any(each != service for each in self._shared.get(node, ()))

    def _leave(self, service: str) -> None:
        node = self._process.pop(service, None)
        if node is None:
            return
        del self._shared[node][service]
        self._roomy[node] = None
        if not self._shared[node]:
            del self._shared[node], self._roomy[node]
