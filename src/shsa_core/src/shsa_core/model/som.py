"""The service-to-ontology mapping (SOM): which services provide which properties."""
import dataclasses
from typing import Any, Collection, Dict, Iterable, Iterator, List, Mapping, Optional, Tuple

from shsa_core.errors import ModelError
from shsa_core.model.cost import Host
from shsa_core.model.names import full_name
from shsa_core.model.service import Deadlines, Service, Signal, Source


class Som:
    """All services and hosts by name, in the order of the file; immutable.

    `act`: healing acts; else it advises. A file says so, or it is not so.
    Names differ, and so do the pairs of topic and node; hosts that services name are there; whoever
    reads a SOM has seen to that.
    """

    def __init__(
        self, services: Iterable[Service] = (), hosts: Iterable[Host] = (), act: bool = True
    ) -> None:
        self.act = act
        self.hosts: Mapping[str, Host] = {host.name: host for host in hosts}
        self.services: Dict[str, Service] = {service.name: service for service in services}
        self._of_topic: Dict[str, List[str]] = {}  # by name, before and beyond a gate
        for service in self:
            for topic in service.topics:
                self._of_topic.setdefault(topic, []).append(service.name)
        self._see_upstream()

    def _see_upstream(self) -> None:
        """Fill in what each service is computed from, by however many steps."""
        for name, service in self.services.items():
            upstream: Dict[str, None] = {}
            open_ = list(service.derived_from)
            for given in open_:  # it grows
                found = [given] if given in self.services else self._of_topic.get(given, [given])
                for each in found:
                    if each not in upstream and each != name:
                        upstream[each] = None
                        open_ += self.services[each].derived_from if each in self.services else ()
            if tuple(upstream) != service.upstream:
                self.services[name] = dataclasses.replace(service, upstream=tuple(upstream))

    def __iter__(self) -> Iterator[Service]:
        return iter(self.services.values())

    def __len__(self) -> int:
        return len(self.services)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Som) and self.parts == other.parts

    def __hash__(self) -> int:
        return hash(tuple(self.services))

    @property
    def parts(self) -> Tuple[Tuple[Service, ...], Tuple[Host, ...], bool]:
        """Its services and hosts, and `act`."""
        return tuple(self), tuple(self.hosts.values()), self.act

    def with_services(self, services: Iterable[Service]) -> "Som":
        """Return other services on the same hosts."""
        return Som(services, self.hosts.values(), self.act)

    @property
    def sources(self) -> Tuple[Source, ...]:
        """Every value of every service."""
        return tuple(source for service in self for source in service.sources)

    def of_property(self, name: str) -> Tuple[Source, ...]:
        """Return the sources of the property `name`."""
        return tuple(source for source in self.sources if source.property == name)

    def of_topic(self, topic: str) -> Tuple[Service, ...]:
        """Return the services that share `topic`, or the one that a gate passes on there."""
        return tuple(self.services[name] for name in self._of_topic.get(topic, ()))

    def topics(self) -> Tuple[str, ...]:
        """Return the topics that nodes publish on, each once, in the order of the SOM."""
        return tuple(dict.fromkeys(service.topic for service in self))

    def service_of(self, topic: str, publisher: str) -> Optional[Service]:
        """Return the service that `publisher` provides on `topic`; None if that cannot be told.

        A publisher that no service names stands for the topic's service if there is only one.
        """
        services = [service for service in self.of_topic(topic) if service.topic == topic]
        named = next((service for service in services if service.node == publisher), None)
        return services[0] if named is None and len(services) == 1 else named

    def known_name(self, name: str, namespace: str) -> str:
        """Return a name in full: of a service, host or cause as it is, else of a topic or node."""
        known = name in self.hosts or any(name in (each.name, *each.shared) for each in self)
        return name if known else full_name(name, namespace)

    def find(self, name: str, namespace: str) -> Service:
        """Return the service of a name, a topic or a property; a needed one first.

        A relative topic is one in the namespace. Raises ModelError if there is none.
        """
        found = [self.services[name]] if name in self.services else []
        found += self.of_topic(full_name(name, namespace))
        found += [source.service for source in self.of_property(name)]
        if not found:
            known = ", ".join(f"{each.name} ({each.topic})" for each in self)
            raise ModelError(name, f"the SOM has no such service or topic; it has {known}")
        return min(found, key=lambda service: not service.needed)

    def at(self, hosts: Collection[str], beside: bool = False) -> "Som":
        """Return the services whose topic is of one of some hosts, or of none of them: `beside`.

        A topic is of the host of its first service, so that one monitor hears all its publishers.
        """
        return self.with_services(
            each for each in self if (self.of_topic(each.topic)[0].host in hosts) is not beside
        )

    def needed(self) -> Tuple[Service, ...]:
        """Return the services that are healed when they fail."""
        return tuple(service for service in self if service.needed)

    def may_be_needed(self) -> Tuple[Service, ...]:
        """Return those, or where none is marked, all that are while somebody subscribes to them."""
        return self.needed() or tuple(service for service in self if service.needed is None)

    def signal(self, source: Source, deadlines: Deadlines, written: bool = False) -> Signal:
        """Return what a substitute must know of a source that it reads or writes."""
        service = source.service
        shared = len(self.of_topic(service.topic)) > 1
        return Signal(
            service.topic if written else service.heard,
            source.provision.field,
            service.type,
            service.node if shared else "",
            service.period,
            deadlines.of(service),
            latched=service.latched,
        )


def differences(new: Service, old: Service, when: str) -> str:
    """Return the numbers that differ, in words; `when` the old ones count."""
    pairs = list(zip(new.provides, old.provides))
    told: List[Tuple[str, Any, Any]]
    told = [("period", new.period, old.period), ("deadline", new.deadline, old.deadline)]
    told += [(f"range of {now.property}", now.range, before.range) for now, before in pairs]
    said = [f"{what}: {n or 'none'} ({when} {b or 'none'})" for what, n, b in told if n != b]
    said += ["checks"] if new.checks != old.checks else []
    said += [f"checks of {now.property}" for now, was in pairs if now.checks != was.checks]
    return ", ".join(said)
