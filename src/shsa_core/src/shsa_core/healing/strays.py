"""Substitutes on other computers that were told to end, and may not have heard it."""
from typing import Dict, List

from shsa_core.healing.events import Command, StartSubstitute, StopSubstitute
from shsa_core.healing.hosts import Hosts
from shsa_core.healing.records import Records, Stray, stray_key

HEARD_S = 5.0
"""Who was told to end has heard it if its computer was there for so long after."""


class Strays:
    """Sees to it that one who cannot be told to end now is told so first when it can be."""

    def __init__(self, hosts: Hosts, records: Records) -> None:
        self._hosts = hosts
        self._records = records
        self._runs_on: Dict[str, str] = {}  # only other computers
        self._told: Dict[str, float] = {}

    def runs_on(self, node: str, host: str) -> None:
        """A substitute runs on a computer."""
        if host:
            self._runs_on[node] = host

    def host(self, node: str) -> str:
        """The computer that a substitute runs on; empty: the reconfigurator's own."""
        return self._runs_on.get(node, "")

    def take_up(self, stray: Stray) -> None:
        """A former reconfigurator could not end it."""
        self._runs_on[stray.node] = stray.host
        self._note(stray.node, float("inf"))

    def ended(self, node: str) -> None:
        """A process has ended."""
        self._runs_on.pop(node, None)
        self._told.pop(node, None)
        self._records.set(stray_key(node), None)

    def seen(self, time: float, host: str, back: bool) -> List[Command]:
        """A computer is there; `back`: and was not before. Who must end there."""
        commands: List[Command] = []
        for node, told in list(self._told.items()):
            if self._runs_on[node] != host:
                continue
            if back or told == float("inf"):
                commands.append(StopSubstitute(node))
                self._note(node, time)
            elif time - told > HEARD_S:
                self.ended(node)
        return commands

    def passed(self, time: float, commands: List[Command]) -> List[Command]:
        """The commands that can be carried out; what starts and ends elsewhere is noted."""
        passed: List[Command] = []
        for command in commands:
            if isinstance(command, StartSubstitute):
                self.runs_on(command.node, command.host)
            elif isinstance(command, StopSubstitute) and command.node in self._runs_on:
                reachable = self._hosts.reachable(self._runs_on[command.node])
                self._note(command.node, time if reachable else float("inf"))
                if not reachable:
                    continue
            passed.append(command)
        return passed

    def _note(self, node: str, told: float) -> None:
        self._told[node] = told
        self._records.put(Stray(node, self._runs_on[node]))
