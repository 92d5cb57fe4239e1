"""The robot's computers as one Host: each command goes to its own, by an agent if need be."""
import threading
from functools import partial
from typing import Callable, Dict, Iterable, List

import rospy
from shsa_msgs import msg

from shsa_core.healing import events
from shsa_core.hosts.commands import Host, HostCommand
from shsa_core.hosts.conversation import HostState, RemoteHost
from shsa_core.ros import clock, settings
from shsa_core.ros.agent.load import Load
from shsa_core.ros.master.node_api import FAILURES, address, master_api
from shsa_core.ros.node import publish
from shsa_core.ros.processes import kernel
from shsa_core.ros.trust.signing import SignedPublisher, Signing
from shsa_core.ros.wire import names
from shsa_core.ros.workers import Workers

TellAny = Callable[[events.Event], None]

LOCAL = ""
"""The name of the computer that we run on."""


class AllHosts:
    """A Host of all computers: our own, and those that have an agent. From any thread.

    A substitute is where it was started; another node is on the computer whose agent tells the
    address that the master has for it. What is on none of them is left to `local`. `own`: what the
    SOM calls our own computer, of whose load we tell ourselves; empty: nothing.
    """

    def __init__(self, local: Host, signing: Signing, tell: TellAny, own: str = "") -> None:
        self._local, self._signing, self._tell, self._own = local, signing, tell, own
        self._load = Load()
        self._remote: Dict[str, RemoteHost] = {}
        self._homes: Dict[str, str] = {}
        self._watched: Dict[str, List[str]] = {}
        self._looks = Workers("route", settings.MOST_CALLS)
        self._lock = threading.RLock()
        self._begun = threading.Event()
        threading.Thread(target=self._work, name="agents", daemon=True).start()

    @property
    def names(self) -> List[str]:
        """Return the computers whose agents are listened to."""
        return list(self._remote)

    def carry_out(self, command: HostCommand) -> None:
        """Begin to carry out a command; see Host."""
        if isinstance(command, events.WatchNodes):
            self._watch(command)
        elif isinstance(command, events.StartSubstitute):
            self._start(command)
        elif isinstance(command, (events.LearnNode, events.FindNode)) and self._remote:
            self._looks.put(partial(self._look, command))
        else:
            self._at_home(command)
        if isinstance(command, events.StopSubstitute):
            self._homes.pop(command.node, None)

    def listen(self, hosts: Iterable[str], taking_up: bool = False) -> None:
        """Listen to the agents of these computers too. `taking_up`: what runs there may be ours."""
        for name in sorted(set(hosts) - set(self._remote)):
            host = self._host(name)
            if not taking_up:
                host.take_up()
            with self._lock:
                self._remote = {**self._remote, name: host}
            self._hear(host)
            self._begun.set()

    def take_up(self) -> List[str]:
        """Return the nodes of ours that run on other computers, to be kept there.

        Waits for the agents that are registered, and for nobody where there are none.
        """
        wanted = self._registered()
        kernel.wait_for(lambda: all(self._remote[n].is_reached for n in wanted), settings.ANSWER_S)
        with self._lock:
            found = {node: name for name, host in self._remote.items() for node in host.take_up()}
        self._homes.update(found)
        return list(found)

    def told(self) -> List[HostState]:
        """Return how each computer does."""
        with self._lock:
            return [host.told() for host in self._remote.values()]

    def await_quiet(self) -> None:
        """Wait until the agents that can be reached have heard everything."""
        kernel.wait_for(lambda: all(h.is_quiet for h in self._remote.values()), settings.ANSWER_S)

    # Where each command goes.

    def _send(self, name: str, command: HostCommand) -> None:
        if name == LOCAL:
            self._local.carry_out(command)
        else:
            with self._lock:
                self._remote[name].carry_out(command, clock.now())

    def _at_home(self, command: events.NodeCommand) -> None:
        self._send(self._homes.get(command.node, LOCAL), command)

    def _look(self, command: events.NodeCommand) -> None:
        """Look first where a node is: it may be somewhere else than it was."""
        self._homes[command.node] = self._home(command.node)
        self._at_home(command)

    def _home(self, node: str) -> str:
        """Return where a node is by the master's word; where it was, if that does not answer."""
        try:
            place = address(str(master_api().lookupNode(node))).host
            if place == address(rospy.get_node_uri()).host:
                return LOCAL
        except FAILURES:
            return self._homes.get(node, LOCAL)
        with self._lock:
            first = [name for name, host in self._remote.items() if host.addresses[:1] == (place,)]
            other = [name for name, host in self._remote.items() if place in host.addresses]
        return (first + other + [LOCAL])[0]

    def _watch(self, command: events.WatchNodes) -> None:
        """Here all are watched, as they may come up anywhere; an agent sees its own sooner."""
        self._send(LOCAL, command)
        for name in self._remote:
            nodes = sorted(node for node in command.nodes if self._homes.get(node) == name)
            if nodes != self._watched.get(name, []):
                self._watched[name] = nodes
                self._send(name, events.WatchNodes(tuple(nodes)))

    def _start(self, command: events.StartSubstitute) -> None:
        home = LOCAL if command.host == self._own else command.host
        if home == LOCAL or home in self._remote:
            self._homes[command.node] = home
            self._send(home, command)
        else:
            why = f"{command.host} is none of the hosts: {', '.join(self._remote) or 'none'}"
            exited = events.ProcessExited(clock.now(), command.node, why, False)
            self._tell(exited)

    # The conversations with the agents.

    def _host(self, name: str) -> RemoteHost:
        commands = SignedPublisher(self._signing, names.host_commands(name), msg.HostCommand)
        say = lambda **fields: publish(commands, msg.HostCommand(**fields))
        beats = settings.LOST_BEATS, settings.RETURN_BEATS
        return RemoteHost(name, self._tell, say, *(settings.HEARTBEAT_S * each for each in beats))

    def _hear(self, host: RemoteHost) -> None:
        def heard(message: msg.HostEvent) -> None:
            with self._lock:
                host.heard(message, clock.now())

        topic = names.host_events(host.name)
        checked = self._signing.checked(topic, msg.HostEvent)
        subscriber = self._signing.subscribe(topic, checked, heard)
        host.ended = lambda: subscriber.get_num_connections() == 0

    def _registered(self) -> List[str]:
        """Return the computers whose agents the master knows."""
        if not self._remote:
            return []
        try:
            publishers, _, _ = master_api().getSystemState()
        except FAILURES:
            return []
        topics = {topic for topic, _ in publishers}
        topic_of = {name: rospy.resolve_name(names.host_events(name)) for name in self._remote}
        return [name for name, topic in topic_of.items() if topic in topics]

    def _work(self) -> None:
        self._begun.wait()
        beat_at = 0.0
        while not rospy.core.is_shutdown():
            now = clock.now()
            beats = now >= beat_at
            with self._lock:
                for host in self._remote.values():
                    host.tick(now, settings.TICK_S)
                    if beats:
                        host.beat()
            if beats:
                beat_at = now + settings.HEARTBEAT_S
                if self._own:  # as agents tell of theirs
                    self._load.look(now)
                    load = self._load.busy, self._load.cores, self._load.sent, self._load.received
                    self._tell(events.HostSeen(now, self._own, *load))
            rospy.rostime.wallsleep(settings.TICK_S)
