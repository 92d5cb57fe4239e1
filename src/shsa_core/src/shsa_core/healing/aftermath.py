"""What follows when a kill is over, however it went."""
from typing import Any, Dict, Iterable, List

from shsa_core.healing.events import Command, Level, Log
from shsa_core.healing.incident import State
from shsa_core.healing.kills import (
    KillNode,
    NodeKilled,
    NodeSends,
    NodeSpared,
    NodeUnreached,
    Over,
)
from shsa_core.healing.succession import Succession

ORPHAN_KILLS = 5
"""Tries to end a substitute that was left behind: a busy machine may not find it in time."""


class Aftermath(Succession):
    """Tells whom a kill concerns, and begins those again that are to be."""

    def __init__(self, *told: Any) -> None:
        super().__init__(*told)
        self._orphans: Dict[str, int] = {}  # what was left behind, and how often to try yet

    def _killed(self, kills: Iterable[Over]) -> List[Command]:
        commands: List[Command] = []
        for kill in kills:
            if isinstance(kill, NodeSpared):
                commands += self._spared(kill)
            elif isinstance(kill, NodeSends):
                commands += self._sends(kill)
            elif isinstance(kill, NodeUnreached) and self._where.host_of(kill.node):
                commands += self._unreached(kill)
            elif isinstance(kill, NodeUnreached):
                commands += self._gone(NodeKilled(kill.time, kill.node, False, kill.detail))
            else:
                commands += self._gone(kill)
        return commands

    def _spared(self, kill: NodeSpared) -> List[Command]:
        commands: List[Command] = []
        if kill.detail:
            text = f"{kill.node} is not touched: {kill.detail}."
            commands.append(Log(Level.ERROR, text))
            self._unsettle_node(kill.node)
        for name in self._concern.blaming(kill.node):
            commands += self._ask(name, lambda healing, now: healing.spared(now, kill.detail))
        return commands

    def _gone(self, kill: NodeKilled) -> List[Command]:
        commands: List[Command] = []
        self._nodes.killed(kill.node, kill.time)
        self._acquaintance.went(kill.node)
        if kill.node not in self._nodes.excluded:  # it is back already, as another process
            for topic in self._nodes.topics(kill.node):
                row = self._nodes.health(topic)[kill.node]
                commands += self._acquaint(kill.node, row)
        self._forget_restarted(kill.node)
        self._unsettle_node(kill.node)
        if kill.certain:
            self._orphans.pop(kill.node, None)
        elif self._orphans.get(kill.node):
            commands += self._kill_orphan(kill.node)
        for name in self._concern.blaming(kill.node):
            commands += self._ask(name, lambda healing, now: healing.killed(now, kill))
            commands += self._ask(name, lambda healing, now: healing.changed(now))
        return commands

    def _unreached(self, over: NodeUnreached) -> List[Command]:
        """The kill of a node is finished when its computer is back."""
        commands: List[Command] = []
        blaming = self._concern.blaming(over.node)
        silent = all(self._healings[name].silent for name in blaming)
        self._awaited.add(over.time, over.node, self._where.host_of(over.node), silent)
        for name in blaming:
            commands += self._ask(name, lambda healing, now: healing.unreached(now, over.detail))
        return commands

    def _sends(self, over: NodeSends) -> List[Command]:
        """A node may do well on its own computer, which is asked again while it is missed here."""
        commands: List[Command] = []
        self._awaited.add(over.time, over.node, self._where.host_of(over.node), True)
        for name in self._concern.blaming(over.node):
            told = over.detail, over.cause
            commands += self._ask(name, lambda healing, now: healing.sends(now, *told))
        return commands

    def _kill_again(self, node: str) -> List[Command]:
        """Kill a node that is still blamed, and has not returned."""
        blaming = [self._healings[name] for name in self._concern.blaming(node)]
        if not any(each.state not in (State.WELL, State.RETURNING, State.KEPT) for each in blaming):
            return []
        commands: List[Command] = []
        for each in blaming:
            commands += self._ask(each.service, lambda healing, now: healing.kill(now))
        return commands

    def _end_orphan(self, node: str) -> List[Command]:
        self._orphans[node] = ORPHAN_KILLS
        return self._kill_orphan(node)

    def _kill_orphan(self, node: str) -> List[Command]:
        self._orphans[node] -= 1
        return self._absorb([KillNode(node, urgent=True)])
