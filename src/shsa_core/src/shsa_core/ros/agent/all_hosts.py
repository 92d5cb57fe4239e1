"""The robot's computers as one Host: each command goes to the computer that it is about.

With another computer, by way of the agent there, healing talks over a line that may be cut. A
conversation begins when the agent is heard, and again when it was silent or was started anew, or
when something was lost: both ends number what they say. It counts once both have heard each other.
What is wanted of a computer that cannot be reached is answered at once, with what is known of it:
nothing.
"""
import threading
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Any, Callable, Dict, Iterable, List, Mapping, NamedTuple, Optional, Tuple, Type

import rospy
from shsa_msgs import msg

from shsa_core.errors import ModelError
from shsa_core.healing import events
from shsa_core.healing.events import Where
from shsa_core.ros import clock, settings
from shsa_core.ros.agent.load import Load
from shsa_core.ros.master.node_api import FAILURES, address, master_api
from shsa_core.ros.node import publish
from shsa_core.ros.processes import kernel
from shsa_core.ros.processes.host import COMMANDS, EVENTS, Host, HostCommand, HostEvent, NodeCommand
from shsa_core.ros.processes.host import not_done, read, written
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.wire import names
from shsa_core.ros.workers import Workers
from shsa_core.watch import Watch

TellAny = Callable[[events.Event], None]

ANSWERS: Mapping[Type[Any], Tuple[Type[Any], ...]] = {
    events.LearnNode: (events.NodeLearned,),
    events.FindNode: (events.NodeFound, events.ProcessUntouchable),
    events.AskToLeave: (events.NodeLeft, events.ProcessUntouchable),
    events.EndProcess: (events.NodeLeft, events.ProcessUntouchable),
    events.StartSubstitute: (events.SubstituteStarted, events.ProcessExited),
    events.RestartNode: (events.NodeRestarted, events.RestartFailed),
}
"""Commands that somebody waits for the answer of."""


class HostState(NamedTuple):
    """The state of a computer, for people; `silent`: s since it was `seen`; None: it never was."""

    name: str
    reached: bool
    silent: float
    seen: Optional[events.HostSeen]


class RemoteHost:
    """A Host of the computer `name`. For one thread at a time; times in s, on our clock.

    `tell(event)` hears its events, HostSeen and HostLost; `publish(message)` sends a HostCommand;
    `ended()`: whether the agent has closed its connection, as it does when it ends. What is to be
    stopped while it cannot be reached is stopped once it can be; substitutes that have ended
    meanwhile are told.
    """

    def __init__(
        self, name: str, tell: TellAny, publish: Callable[[msg.HostCommand], None]
    ) -> None:
        self.name = name
        self.ended: Callable[[], bool] = lambda: False
        self.addresses: Tuple[str, ...] = ()
        self._tell, self._publish = tell, publish
        self._agent = self._session = 0
        self._said = self._heard = 0  # commands and events of this session
        self._confirmed = 0  # so many of our commands has the agent heard
        self.is_reached = self._left = self._settled = False
        self._lost = True  # as far as anybody was told
        self._waits: Dict[Tuple[Type[Any], str], HostCommand] = {}
        # What is to run there, what was found to run there, and how each is stopped.
        self._wanted: Dict[str, HostCommand] = {}
        self._found: Dict[str, HostCommand] = {}
        self._watched = events.WatchNodes(())
        self._seen: Optional[events.HostSeen] = None
        self._clock = Watch()
        self._heard_at = float("-inf")

    @property
    def is_quiet(self) -> bool:
        """True if nothing is under way to the agent, or can be."""
        return not self.is_reached or self._confirmed == self._said

    def told(self) -> HostState:
        """Return how the computer does."""
        silent = self._clock.passed(self._heard_at)
        return HostState(self.name, self.is_reached, silent, self._seen)

    def take_up(self) -> Tuple[str, ...]:
        """Want what runs there, and return it; what is found later, and not wanted, is stopped."""
        self._settled = True
        self._wanted.update(self._found)
        return tuple(self._wanted)

    def carry_out(self, command: HostCommand, now: float) -> None:
        """Begin to carry out a command; see Host."""
        if isinstance(command, events.WatchNodes):
            self._watched = command
        elif isinstance(command, events.StartSubstitute):
            self._wanted[command.node] = events.StopSubstitute(command.node)
        elif isinstance(command, events.RestartNode):
            self._wanted[command.node] = events.StopNode(command.node)
        elif isinstance(command, (events.StopSubstitute, events.StopNode)):
            self._wanted.pop(command.node, None)
        if self.is_reached:
            self._send(command)
        else:
            self._answer(command, now, f"{self.name} cannot be reached")

    def heard(self, message: msg.HostEvent, now: float) -> None:
        """Take in a message of the agent."""
        figures = message.load, message.cores, message.transmitted, message.received
        self._seen = events.HostSeen(now, self.name, *figures)
        self.addresses = tuple(message.addresses)
        expected = self._heard + bool(message.event)
        if message.began != self._agent:
            self._give_up(now, f"the agent of {self.name} was started anew")
            self._begin(message)
        elif (message.session, message.number) < (self._session, expected):
            return  # it is of a former conversation, or was heard before
        elif message.open and message.session == self._session and message.number == expected:
            self._heard_at, self._left = now, False
            self._heard, self._confirmed = message.number, message.heard
            if not self.is_reached:
                self._reach(message, now)
            if message.event:
                with suppress(ModelError):
                    event = read(EVENTS, message.event, f"the agent of {self.name}")
                    self._tell(self._ours(event, now))
            else:
                self._tell(self._seen)
        elif self.is_reached or message.session > self._session:
            self._give_up(now, f"something was lost on the way to or from {self.name}")
            self._begin(message)

    def tick(self, now: float) -> None:
        """Give up an agent that is silent; every TICK_S."""
        self._clock.look(now, self._clock.now + settings.TICK_S)
        silence = self._clock.passed(self._heard_at)
        if self.is_reached and silence >= settings.LOST_BEATS * settings.HEARTBEAT_S:
            self._give_up(now, f"{self.name} has not answered for {silence:.1f} s")
        self._left = self._left or (not self.is_reached and self.ended())
        beats = settings.RETURN_BEATS if self._left else settings.LOST_BEATS
        if not self.is_reached and not self._lost and silence >= beats * settings.HEARTBEAT_S:
            self._lost = True
            why = f"its agent has not answered for {silence:.1f} s"
            self._tell(events.HostLost(now, self.name, why))

    def beat(self) -> None:
        """Tell the agent that we are there, and how much of it was heard."""
        if self._agent:
            self._say("")

    def _begin(self, message: msg.HostEvent) -> None:
        """Begin a conversation; all that belongs to former ones counts no more."""
        self._agent = message.began
        self._session = max(message.session, self._session) + 1
        self.beat()

    def _reach(self, message: msg.HostEvent, now: float) -> None:
        """Both ends hear each other from now on."""
        self.is_reached, self._lost = True, False
        self._found = {node: events.StopSubstitute(node) for node in message.running}
        self._found.update({node: events.StopNode(node) for node in message.restarted})
        self._send(self._watched)
        if self._settled:
            self._reconcile(now)

    def _reconcile(self, now: float) -> None:
        """Stop what runs there and is not wanted; tell of wanted substitutes that do not run."""
        for node in [each for each in self._wanted if each not in self._found]:
            if isinstance(self._wanted.pop(node), events.StopSubstitute):
                self._tell(events.ProcessExited(now, node, f"it has ended on {self.name}"))
        for node in [each for each in self._found if each not in self._wanted]:
            self._send(self._found[node])

    def _ours(self, event: HostEvent, now: float) -> HostEvent:
        """Return an event by our clock; nothing waits for it any more."""
        for command in [each for each in self._waits if each[1] == event.node]:
            if isinstance(event, ANSWERS[command[0]]):
                del self._waits[command]
        if isinstance(event, events.SubstituteStarted):
            return replace(event, time=now, found=now)
        if isinstance(event, (events.ProcessExited, events.RestartFailed)):
            self._wanted.pop(event.node, None)
        return replace(event, time=now)

    def _give_up(self, now: float, why: str) -> None:
        """End the conversation, and answer what still waits."""
        self.is_reached = False
        self._agent = self._said = self._heard = self._confirmed = 0
        waits, self._waits = self._waits, {}
        for command in waits.values():
            self._answer(command, now, why)

    def _answer(self, command: HostCommand, now: float, why: str) -> None:
        event = not_done(command, now, why)
        if isinstance(command, events.FindNode):
            event = events.NodeFound(now, command.node, Where.UNREACHABLE, why)
        if isinstance(event, (events.ProcessExited, events.RestartFailed)):
            self._wanted.pop(event.node, None)
        if event is not None:
            self._tell(event)

    def _send(self, command: HostCommand) -> None:
        if not isinstance(command, events.WatchNodes) and type(command) in ANSWERS:
            self._waits[type(command), command.node] = command
        self._said += 1
        self._say(written(COMMANDS, command))

    def _say(self, text: str) -> None:
        numbers = {"session": self._session, "agent": self._agent, "number": self._said}
        self._publish(msg.HostCommand(command=text, **numbers))


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
            self._subscribe(name, host)
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

    def _at_home(self, command: NodeCommand) -> None:
        self._send(self._homes.get(command.node, LOCAL), command)

    def _look(self, command: NodeCommand) -> None:
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
                    host.tick(now)
                    if beats:
                        host.beat()
            if beats:
                beat_at = now + settings.HEARTBEAT_S
                if self._own:  # as agents tell of theirs
                    self._load.look(now)
                    self._tell(self._load.seen(now, self._own))
            rospy.rostime.wallsleep(settings.TICK_S)
