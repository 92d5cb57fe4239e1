"""The robot's computers as one Host: each command goes to the computer that it is about."""
from functools import partial
from typing import Dict, List

import rospy

from shsa_core.healing import events
from shsa_core.ros import clock, settings
from shsa_core.ros.agent.agents import Agents
from shsa_core.ros.master.node_api import FAILURES, address, master_api
from shsa_core.ros.processes.host import Host, HostCommand, NodeCommand, Tell
from shsa_core.ros.workers import Workers

LOCAL = ""
"""The name of the computer that we run on."""


class Router:
    """A Host of all computers.

    A substitute is where it was started; another node is on the computer whose agent tells the
    address that the master has for it. What is on none of them is left to `local`. `own`: what the
    SOM calls our own computer; empty: it does not.
    """

    def __init__(self, local: Host, agents: Agents, tell: Tell, own: str = "") -> None:
        self._local, self._agents, self._tell, self._own = local, agents, tell, own
        self._homes: Dict[str, str] = {}
        self._watched: Dict[str, List[str]] = {}
        self._looks = Workers("route", settings.MOST_CALLS)

    def carry_out(self, command: HostCommand) -> None:
        """Begin to carry out a command; see Host."""
        if isinstance(command, events.WatchNodes):
            self._watch(command)
        elif isinstance(command, events.StartSubstitute):
            self._start(command)
        elif isinstance(command, (events.LearnNode, events.FindNode)) and self._agents.names:
            self._looks.put(partial(self._look, command))
        else:
            self._at_home(command)
        if isinstance(command, events.StopSubstitute):
            self._homes.pop(command.node, None)

    def settle(self, homes: Dict[str, str]) -> None:
        """Note that these nodes run on these computers."""
        self._homes.update(homes)

    def _send(self, name: str, command: HostCommand) -> None:
        if name == LOCAL:
            self._local.carry_out(command)
        else:
            self._agents.carry_out(name, command)

    def _at_home(self, command: NodeCommand) -> None:
        self._send(self._homes.get(command.node, LOCAL), command)

    def _look(self, command: NodeCommand) -> None:
        """Look first where a node is: it may be somewhere else than it was."""
        self._homes[command.node] = self._home(command.node)
        self._at_home(command)

    def _home(self, node: str) -> str:
        """Return where a node is by the master's word; where it was, if that does not answer."""
        try:
            uri = str(master_api().lookupNode(node))
            ours = address(rospy.get_node_uri()).host
            return LOCAL if address(uri).host == ours else self._agents.home(uri)
        except FAILURES:
            return self._homes.get(node, LOCAL)

    def _watch(self, command: events.WatchNodes) -> None:
        """Here all are watched, as they may come up anywhere; an agent sees its own sooner."""
        self._local.carry_out(command)
        for name in self._agents.names:
            nodes = sorted(node for node in command.nodes if self._homes.get(node) == name)
            if nodes != self._watched.get(name, []):
                self._watched[name] = nodes
                self._agents.carry_out(name, events.WatchNodes(tuple(nodes)))

    def _start(self, command: events.StartSubstitute) -> None:
        if command.host in (LOCAL, self._own):
            self._local.carry_out(command)
        elif command.host in self._agents.names:
            self._homes[command.node] = command.host
            self._agents.carry_out(command.host, command)
        else:
            why = f"{command.host} is none of the hosts: {', '.join(self._agents.names) or 'none'}"
            self._tell(events.ProcessExited(clock.now(), command.node, why))
