"""The robot's computers as one: each command goes to its own, by an agent if need be."""
import threading
from contextlib import suppress
from dataclasses import replace
from typing import Callable, Dict, Iterable, List

import psutil
import rospy
from shsa_msgs import msg

from shsa_core.healing import events
from shsa_core.hosts.conversation import CarryOut, HostCommand, RemoteHost
from shsa_core.ros import clock, settings
from shsa_core.ros.master.node_api import FAILURES, master_api
from shsa_core.ros.node import publish
from shsa_core.ros.processes import kernel
from shsa_core.ros.trust.signing import SignedPublisher, Signing
from shsa_core.ros.wire import names
from shsa_core.ros.workers import repeating

LOCAL = ""
"""The name of the computer that we run on."""


class AllHosts:
    """All computers: our own, and those that have an agent.

    A substitute is where it was started, another node where `host_of` says; what is on a computer
    whose agent was never heard is left to `local`. `own`: what the SOM calls our own computer, of
    whose load we tell ourselves; empty: nothing.
    """

    def __init__(
        self,
        local: CarryOut,
        signing: Signing,
        tell: Callable[[events.Event], None],
        host_of: Callable[[str], str],
        own: str = "",
    ) -> None:
        self._local, self._signing, self._tell = local, signing, tell
        self._host_of, self._own = host_of, own
        self._load = Load(own)
        self._remote: Dict[str, RemoteHost] = {}
        self._homes: Dict[str, str] = {}
        self._lock = threading.RLock()
        self._thread = repeating("agents", settings.TURN_S, self._turn)

    @property
    def remote(self) -> List[RemoteHost]:
        """Return the computers whose agents are listened to."""
        return list(self._remote.values())

    def carry_out(self, command: HostCommand) -> None:
        """Begin to carry out a command; see CarryOut."""
        if isinstance(command, events.WatchNodes):  # each sees to those that it knows
            for host in (LOCAL, *self._remote):
                self._send(host, command)
            return
        if isinstance(command, events.StartSubstitute):
            self._homes[command.node] = command.host
        self._send(self._home(command.node), command)
        if isinstance(command, events.StopNode):
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
        if self._remote and not self._thread.is_alive():
            self._thread.start()

    def take_up(self) -> List[str]:
        """Return the nodes of ours that run on other computers, to be kept there.

        Waits for the agents that are registered, and for nobody where there are none.
        """
        hosts: List[RemoteHost] = []
        with suppress(*FAILURES):
            topics = dict(master_api().getSystemState()[0]) if self._remote else {}
            topic_of = lambda host: rospy.resolve_name(names.host_events(host.name))
            hosts = [host for host in self.remote if topic_of(host) in topics]
        kernel.wait_for(lambda: all(host.is_reached for host in hosts), settings.ANSWER_S)
        with self._lock:
            found = {node: name for name, host in self._remote.items() for node in host.take_up()}
        self._homes.update(found)
        return list(found)

    def await_quiet(self) -> None:
        """Wait until the agents that can be reached have heard everything."""
        kernel.wait_for(lambda: all(host.is_quiet for host in self.remote), settings.ANSWER_S)

    def _send(self, name: str, command: HostCommand) -> None:
        if name == LOCAL:
            self._local(command)
        else:
            with self._lock:
                self._remote[name].carry_out(command, clock.now())

    def _home(self, node: str) -> str:
        """Return the computer of a node, if its agent was ever heard."""
        home = self._homes.get(node) or self._host_of(node)
        return home if home in self._remote and self._remote[home].seen else LOCAL

    def _host(self, name: str) -> RemoteHost:
        commands = SignedPublisher(self._signing, names.host_commands(name), msg.HostCommand)
        say = lambda **fields: publish(commands, msg.HostCommand(**fields))
        beats = settings.LOST_BEATS, settings.RETURN_BEATS
        return RemoteHost(name, self._tell, say, *(settings.TURN_S * each for each in beats))

    def _hear(self, host: RemoteHost) -> None:
        def heard(message: msg.HostEvent) -> None:
            with self._lock:
                host.heard(message, clock.now())

        topic = names.host_events(host.name)
        checked = self._signing.checked(topic, msg.HostEvent)
        subscriber = self._signing.subscribe(topic, checked, heard)
        host.ended = lambda: subscriber.get_num_connections() == 0

    def _turn(self) -> None:
        now = clock.now()
        with self._lock:
            for host in self._remote.values():
                host.tick(now, settings.TURN_S)
                host.beat()
        if self._own:  # as agents tell of theirs
            self._load.look(now)
            self._tell(replace(self._load.seen, time=now))


class Load:
    """The load of our computer `host` as it was `seen` last: on all networks but its own."""

    def __init__(self, host: str) -> None:
        cores = float(psutil.cpu_count() or 1)
        self.seen = events.HostSeen(float("-inf"), host, 0.0, cores, 0.0, 0.0)
        psutil.cpu_percent()
        self._counted = _counters()

    def look(self, now: float) -> None:
        """Look, if it is time to; `now`: s."""
        elapsed = now - self.seen.time
        if elapsed < settings.LOOK_S:
            return
        counted, before = _counters(), self._counted
        busy = psutil.cpu_percent() / 100.0 * self.seen.cores
        sent, received = ((new - old) / elapsed for new, old in zip(counted, before))
        self.seen = replace(self.seen, time=now, load=busy, sent=sent, received=received)
        self._counted = counted


def _counters() -> List[int]:
    """Bytes sent and received so far."""
    links = [each for name, each in psutil.net_io_counters(pernic=True).items() if name != "lo"]
    return [sum(each.bytes_sent for each in links), sum(each.bytes_recv for each in links)]
