"""What follows where a computer of the robot is lost, and where it is back.

A computer is lost when its agent is not heard. Only then it can be told from a node's own failure,
and a node's silence is found sooner: what was decided in between is looked at again. When the
computer is back, first the substitutes end there that have a successor, then the kills go on that
could not be finished, and its nodes are judged as whoever returns.
"""
from typing import Any, List

from shsa_core.errors import ShsaError
from shsa_core.healing.aftermath import Aftermath
from shsa_core.healing.awaited_kills import CERTAIN_S
from shsa_core.healing.events import Command, FailureSeen, Level, Log
from shsa_core.healing.host_events import HostLost, HostSeen
from shsa_core.healing.kills import NodeUnreached
from shsa_core.model.kinds import QUIET, Kind, OnPartition
from shsa_core.model.service import Service


ROOM_S = 0.5
"""At least between two looks whether there is room now."""


class Reach(Aftermath):
    """Keeps up which computers are there, and what runs where."""

    def __init__(self, *told: Any) -> None:
        super().__init__(*told)
        self._room_at = float("-inf")

    def _host_seen(self, event: HostSeen) -> List[Command]:
        host, time = self._hosts.name(event.host), event.time
        if host and host not in self._som.hosts:
            return []
        before, lost = self._hosts.heard(host), bool(self._hosts.lost(host))
        back = self._hosts.seen(event)
        commands = self._strays.seen(time, host, back)
        if lost:
            commands.append(Log(Level.INFO, f"{host} is back."))
            self._unsettle(service.name for service in self._where.on(host))
            for service in self._where.on(host):
                if self._waits_with(service):
                    self._where.doubted[service.name] = time + CERTAIN_S
        if back:
            commands += self._excuse(host, before)
        for node in self._awaited.due(time, host):
            commands += self._kill_again(node)
        commands += self._look_for_room(time)
        for name in self._cleared(time, host):
            commands += self._ask(name, lambda healing, now: healing.reconsider(now))
            commands += self._ask(name, lambda healing, now: healing.replan(now))
        return commands

    def _look_for_room(self, time: float) -> List[Command]:
        """Try again what no computer had room for: one may have it now."""
        commands: List[Command] = []
        if time >= self._room_at:
            self._room_at = time + ROOM_S
            for name in [each for each in self._concern.stuck if self._healings[each].lacks_room]:
                commands += self._ask(name, lambda healing, now: healing.changed(now, True))
        return commands

    def _host_lost(self, event: HostLost) -> List[Command]:
        host = self._hosts.name(event.host)
        heard = self._hosts.heard(host)
        if host not in self._som.hosts or not self._hosts.lose(event):
            return []
        why = f"{host} is lost: {event.detail.rstrip('.')}"
        commands: List[Command] = [Log(Level.WARN, f"{why}.")]
        self._unsettle(service.name for service in self._where.on(host))
        for service in self._where.on(host):
            if service.needed and service.event_driven:
                text = f"Whether anybody publishes {service.topic} cannot be told by its silence"
                commands.append(Log(Level.WARN, f"{text}: it is not healed while {host} is lost."))
        commands += self._settle() + self._excuse(host, heard)
        for node in sorted(self._kills.nodes):
            if self._where.host_of(node) == host:
                over = self._kills.unreached(event.time, node, why)
                commands += self._unreached(over) if isinstance(over, NodeUnreached) else []
        for node in self._pool.on(host):
            commands += self._absorb(self._pool.drop(node))
            self._substitutions.set(node, None)
        self._place_warm()
        for name in list(self._where.working_on(host)):
            commands += self._ask(name, lambda healing, now: healing.host_lost(now, why))
        for service in self._where.on(host):
            if self._waits_with(service):
                self._where.doubted.pop(service.name, None)
                commands += self._ask(service.name, lambda healing, now: healing.reconsider(now))
        return commands

    def _hosts_settled(self, time: float) -> List[Command]:
        """Some computers count since a moment: what stands by goes where it belongs."""
        return self._rehost() if self._hosts.settled(time) else []

    def _rehost(self) -> List[Command]:
        commands: List[Command] = []
        self._place_warm()
        for name in self._concern.substituted:
            allowed = self._where.allowed(self._som.services[name])
            commands += self._ask(name, lambda healing, now: healing.rehost(now, allowed))
        for name in list(self._concern.stuck):
            commands += self._ask(name, lambda healing, now: healing.changed(now, True))
        return commands

    def _place_warm(self) -> None:
        """The idle processes are wanted where the plans of the warm services are placed now."""
        for name in list(self._pool.plans):
            self._stand_by(self._som.services[name], self._planner.plans.plan(name))

    def _excuse(self, host: str, heard: float) -> List[Command]:
        """Who failed by silence since a computer was heard is not to blame."""
        commands: List[Command] = []
        for service in self._where.on(host):
            commands += self._ask(service.name, lambda healing, now: healing.excuse(now, heard))
        return commands

    def _doubt(self, service: Service, event: FailureSeen) -> None:
        """Somebody is silent: it is not known yet whether the computer is lost."""
        host = self._where.host_of(event.publisher or service.node)
        if not host or event.kind not in QUIET or event.kind is Kind.NODE_GONE:
            return
        self._hosts.doubt(host, event.time)
        unheard = self._hosts.known(host) and self._hosts.heard(host) <= event.time
        if unheard and self._waits_with(service) and host == self._hosts.name(service.host):
            self._where.doubted[service.name] = event.time

    def _cleared(self, time: float, host: str) -> List[str]:
        """The services on a computer that is heard, so that their silence is their own."""
        cleared = [
            name
            for name, since in self._where.doubted.items()
            if since < time and self._hosts.name(self._som.services[name].host) == host
        ]
        for name in cleared:
            del self._where.doubted[name]
        return cleared

    def _waits_with(self, service: Service) -> bool:
        return service.on_partition is OnPartition.WAIT and service.needed

    def validate(self) -> None:
        """Raises ShsaError if an invariant is broken: nothing stands by where it cannot be told."""
        super().validate()
        for node in self._pool.nodes:
            if self._hosts.lost(self._strays.host(node)):
                raise ShsaError(f"{node} stands by on a computer that is lost")
        for name, healing in self._healings.items():
            host = healing.substitute.host
            if healing.node and self._hosts.lost(host) and not healing.publishes:
                raise ShsaError(f"{healing.node} stands by for {name} on {host}, which is lost")
