"""Which services are available: published by a healthy original now."""
from dataclasses import replace
from typing import Callable, Dict, List, Mapping, Set, Tuple

from shsa_core.healing.events import ServiceState
from shsa_core.healing.nodes import Nodes
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.monitoring.events import PublisherHealth, PublisherState


class Availability:
    """The running SOM, kept up service by service.

    `services` has those that are available, each with the node that publishes it. `states` has a
    row for each, `unavailable` the names of the others. `lost`: why a computer is lost, empty: it
    is not.
    """

    def __init__(
        self, nodes: Nodes, open_: Callable[[str], bool], lost: Callable[[str], str]
    ) -> None:
        self.services: Dict[str, Service] = {}
        self.states: Dict[str, ServiceState] = {}
        self.unavailable: Set[str] = set()
        self._nodes = nodes
        self._open = open_
        self._lost = lost

    def update(self, som: Som, names: Mapping[str, bool]) -> Tuple[List[Service], List[Service]]:
        """Look at some services again: those that are available no more, and those that are now.

        True with a name: it is another one now, though it may look the same.
        """
        gone: List[Service] = []
        come: List[Service] = []
        for name, another in names.items():
            before = self.services.pop(name, None)
            self.unavailable.discard(name)
            service = som.services.get(name)
            if service is None:
                self.states.pop(name, None)
            else:
                state = self._state(som, service)
                self.states[name] = state
                if state.available:
                    self.services[name] = service = replace(service, node=state.node)
                    if service == before and not another:
                        self.services[name] = before
                        continue
                    come.append(service)
                else:
                    self.unavailable.add(name)
            if before is not None:
                gone.append(before)
        return gone, come

    def originals(self, som: Som, service: Service) -> Tuple[PublisherHealth, ...]:
        """How the publishers of a service do that are not substitutes."""
        return tuple(
            row
            for row in self._nodes.health(service.topic).values()
            if row.publisher
            and row.publisher not in self._nodes.substitutes
            and som.service_of(service.topic, row.publisher) is service
        )

    def _state(self, som: Som, service: Service) -> ServiceState:
        rows = [
            row for row in self.originals(som, service) if row.publisher not in self._nodes.excluded
        ]
        well = tuple(row.publisher for row in rows if row.state is PublisherState.HEALTHY)
        if self._open(service.name):
            return ServiceState(service, service.node, False, "failed", well)
        lost = self._lost(service.host) if service.host and service.event_driven else ""
        if lost:  # no silence tells of one whose messages are due at no time
            return ServiceState(
                service, service.node, False, f"{service.host} is lost: {lost}", well
            )
        if well:
            verified = tuple(node for node in well if node in self._nodes.verified)
            return ServiceState(service, well[0], True, "", well, verified)
        detail = next((row.detail for row in rows if row.detail), "not published")
        return ServiceState(service, service.node, False, detail)
