"""Another computer, by way of the agent there: a Host over a line that may be cut.

A conversation begins when the agent is heard, and again when it was silent or was started anew, or
when something was lost: both ends number what they say. It counts once both have heard each other.
What is wanted of a computer that cannot be reached is answered at once, with what is known of it:
nothing.
"""
from dataclasses import replace
from typing import Any, Callable, Dict, Mapping, NamedTuple, Optional, Tuple, Type

from shsa_msgs import msg

from shsa_core.errors import ModelError
from shsa_core.healing import events
from shsa_core.healing.events import Where
from shsa_core.ros import settings
from shsa_core.ros.processes.host import COMMANDS, EVENTS, HostCommand, HostEvent, not_done
from shsa_core.ros.processes.host import read, written
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
    """The state of a computer, for people. `silent`: s since it was heard; None: it never was."""

    name: str
    reached: bool
    silent: Optional[float]
    load: float = 0.0
    cores: float = 0.0
    received: float = 0.0
    transmitted: float = 0.0


class RemoteHost:
    """A Host of the computer `name`. For one thread at a time; times in s, on our clock.

    `tell(event)` hears its events, HostSeen and HostLost; `publish(message)` sends a HostCommand;
    `ended()`: whether the agent has closed its connection, as it does when it ends. What is to be
    stopped while it cannot be reached is stopped once it can be; substitutes that have ended
    meanwhile are told.
    """

    def __init__(
        self,
        name: str,
        tell: TellAny,
        publish: Callable[[msg.HostCommand], None],
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
        self._last: Optional[msg.HostEvent] = None
        self._clock = Watch()
        self._heard_at = float("-inf")

    @property
    def is_quiet(self) -> bool:
        """True if nothing is under way to the agent, or can be."""
        return not self.is_reached or self._confirmed == self._said

    def told(self) -> HostState:
        """Return how the computer does."""
        last = self._last
        if last is None:
            return HostState(self.name, False, None)
        figures = last.load, last.cores, last.received, last.transmitted
        return HostState(self.name, self.is_reached, self._clock.passed(self._heard_at), *figures)

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
        self._last = message
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
                self._happened(message.event, now)
            else:
                figures = message.load, message.cores, message.transmitted, message.received
                self._tell(events.HostSeen(now, self.name, *figures))
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

    def _happened(self, text: str, now: float) -> None:
        try:
            event = read(EVENTS, text, f"the agent of {self.name}")
        except ModelError:
            return
        self._tell(self._ours(event, now))

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
        self._publish(
            msg.HostCommand(
                session=self._session,
                agent=self._agent,
                number=self._said,
                command=text,
            )
        )
