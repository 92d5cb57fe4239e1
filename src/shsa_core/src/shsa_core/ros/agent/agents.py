"""The agents of the robot's other computers: their topics, and the time that passes."""
import threading
from typing import Dict, Iterable, List

import rospy
from shsa_msgs import msg

from shsa_core.healing import events
from shsa_core.ros import clock, settings
from shsa_core.ros.agent.load import Load
from shsa_core.ros.agent.remote import RemoteHost, TellAny, HostState
from shsa_core.ros.master.node_api import FAILURES, BadAnswer, address, master_api
from shsa_core.ros.node import publish
from shsa_core.ros.processes.host import HostCommand
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.wire import names


class Agents:
    """The computers that have an agent, by name; from any thread.

    `own`: the name of our own computer, of which we tell ourselves; empty: it has none.
    """

    def __init__(self, signing: Signing, tell: TellAny, own: str = "") -> None:
        self._signing, self._tell, self._own = signing, tell, own
        self._load = Load()
        self._hosts: Dict[str, RemoteHost] = {}
        self._lock = threading.RLock()
        self._begun = threading.Event()
        threading.Thread(target=self._work, name="agents", daemon=True).start()

    @property
    def names(self) -> List[str]:
        """Return the computers whose agents are listened to."""
        return list(self._hosts)

    def listen(self, hosts: Iterable[str], taking_up: bool = False) -> None:
        """Listen to the agents of these computers too. `taking_up`: what runs there may be ours."""
        for name in sorted(set(hosts) - set(self._hosts)):
            host = self._host(name)
            if not taking_up:
                host.take_up()
            with self._lock:
                self._hosts = {**self._hosts, name: host}
            self._subscribe(name, host)
            self._begun.set()

    def carry_out(self, name: str, command: HostCommand) -> None:
        """Begin to carry out a command on a computer. Raises KeyError if none has this name."""
        with self._lock:
            self._hosts[name].carry_out(command, clock.now())

    def take_up(self) -> Dict[str, str]:
        """Return the nodes of ours that run on the computers, each with the name of its computer.

        Waits for the agents that are registered, and for nobody where there are none.
        """
        wanted = self._registered()
        deadline = clock.now() + settings.AGENT_ANSWER_S
        while clock.now() < deadline and not all(self._hosts[n].is_reached for n in wanted):
            rospy.rostime.wallsleep(settings.TICK_S / 5)
        with self._lock:
            return {node: name for name, host in self._hosts.items() for node in host.take_up()}

    def home(self, uri: str) -> str:
        """Return the computer that a node's address is of; empty: none that has an agent."""
        try:
            place = address(uri).host
        except (BadAnswer, UnicodeError):
            return ""
        with self._lock:
            first = [name for name, host in self._hosts.items() if host.addresses[:1] == (place,)]
            other = [name for name, host in self._hosts.items() if place in host.addresses]
        return (first + other + [""])[0]

    def told(self) -> List[HostState]:
        """Return how each computer does."""
        with self._lock:
            return [host.told() for host in self._hosts.values()]

    def await_quiet(self) -> None:
        """Wait until the agents that can be reached have heard everything."""
        deadline = clock.now() + settings.AGENT_ANSWER_S
        while clock.now() < deadline and not all(h.is_quiet for h in self._hosts.values()):
            rospy.rostime.wallsleep(settings.TICK_S)

    def _host(self, name: str) -> RemoteHost:
        topic = names.host_commands(name)
        sign = self._signing.signer(topic, msg.HostCommand)
        publisher = rospy.Publisher(
            topic, msg.HostCommand, queue_size=settings.QUEUE, tcp_nodelay=True
        )
        return RemoteHost(name, self._tell, lambda message: publish(publisher, sign(message)))

    def _subscribe(self, name: str, host: RemoteHost) -> None:
        def heard(message: msg.HostEvent) -> None:
            with self._lock:
                host.heard(message, clock.now())

        topic = names.host_events(name)
        checked = self._signing.checked(topic, msg.HostEvent)
        subscriber = self._signing.subscribe(topic, checked, heard)
        host.ended = lambda: subscriber.get_num_connections() == 0

    def _registered(self) -> List[str]:
        """Return the computers whose agents the master knows."""
        if not self._hosts:
            return []
        try:
            publishers, _, _ = master_api().getSystemState()
        except FAILURES:
            return []
        topics = {topic for topic, _ in publishers}
        topic_of = {name: rospy.resolve_name(names.host_events(name)) for name in self._hosts}
        return [name for name, topic in topic_of.items() if topic in topics]

    def _work(self) -> None:
        self._begun.wait()
        beat_at = 0.0
        while not rospy.core.is_shutdown():
            now = clock.now()
            with self._lock:
                for host in self._hosts.values():
                    host.tick(now)
                    if now >= beat_at:
                        host.beat()
            if now >= beat_at:
                beat_at = now + settings.HEARTBEAT_S
                self._look(now)
            rospy.rostime.wallsleep(settings.TICK_S)

    def _look(self, now: float) -> None:
        """Tell of our own computer, as agents do of theirs."""
        if self._own:
            self._load.look(now)
            figures = self._load.busy, self._load.cores, self._load.sent, self._load.received
            self._tell(events.HostSeen(now, self._own, *figures))
