"""Commands to one computer and its events, and the conversation about them with an agent.

Each is one line of JSON, and the line to another computer may be cut.
It begins when the agent is heard, and again when that was silent or was started anew, or when
something was lost: both ends number what they say. It counts once both have heard each other. What
is wanted of a computer that cannot be reached is answered at once, with what is known of it:
nothing. A restart whose answer was lost is answered by what runs there once it is reached. Times in
s, on one clock.
"""
from contextlib import suppress
from dataclasses import replace
from typing import Any, Callable, Dict, Mapping, Optional, Set, Tuple, Type, Union

from shsa_core.errors import ModelError
from shsa_core.healing import events
from shsa_core.healing.events import Where
from shsa_core.journal.codec import Codec
from shsa_core.model.names import is_substitute
from shsa_core.watch import Watch

HostCommand = Union[events.NodeCommand, events.WatchNodes]
HostEvent = events.NodeEvent
COMMANDS, EVENTS = Codec(HostCommand), Codec(HostEvent)
Tell = Callable[[HostEvent], None]
"""Is told an event, from any thread; waits for nobody."""
CarryOut = Callable[[HostCommand], object]
"""Begins to carry out a command, and waits for nobody; what fails is answered by an event."""
Message = Any
"""A HostCommand or a HostEvent of shsa_msgs."""
ANSWERS: Mapping[Type[Any], Tuple[Type[Any], ...]] = {
    events.LearnNode: (events.NodeLearned,),
    events.FindNode: (events.NodeFound, events.ProcessUntouchable),
    events.AskToLeave: (events.NodeLeft, events.ProcessUntouchable),
    events.EndProcess: (events.NodeLeft, events.ProcessUntouchable),
    events.StartSubstitute: (events.SubstituteStarted, events.ProcessExited),
    events.RestartNode: (events.NodeRestarted, events.RestartFailed),
}
"""Commands that somebody waits for the answer of."""


def not_done(command: HostCommand, now: float, why: str) -> Optional[HostEvent]:
    """Return the answer to a command that cannot be carried out; None: it needs none."""
    if isinstance(command, events.LearnNode):
        return events.NodeLearned(now, command.node, False)
    if isinstance(command, (events.FindNode, events.AskToLeave, events.EndProcess)):
        return events.ProcessUntouchable(now, command.node, command.uri, why)
    if isinstance(command, events.StartSubstitute):
        return events.ProcessExited(now, command.node, why, False)
    if isinstance(command, events.RestartNode):
        return events.RestartFailed(now, command.node, why)
    return None


class RemoteHost:
    """The computer `name`. For one thread at a time.

    `tell(event)` hears its events, HostSeen and HostLost; `publish(**fields)` sends a HostCommand;
    `ended()`: whether the agent has closed its connection, as it does when it ends. One that is
    silent for `patience` is lost, one that has ended after `returns`: it may be started again. What
    is to be stopped while it cannot be reached is stopped once it can be, as is a substitute that
    is not wanted, and no node of the robot; substitutes that have ended meanwhile are told.
    `silence`: s since it was heard, `seen`: what it told then.
    """

    def __init__(
        self,
        name: str,
        tell: Callable[[events.Event], None],
        publish: Callable[..., object],
        patience: float,
        returns: float,
    ) -> None:
        self.name = name
        self._patience, self._returns = patience, returns
        self.ended: Callable[[], bool] = lambda: False
        self._tell, self._publish = tell, publish
        self._session = self._said = self._heard = 0  # commands and events of this session
        self._confirmed = 0  # so many of our commands has the agent heard
        self.is_reached = self._left = self._settled = False
        self._lost = True  # as far as anybody was told
        self._waits: Dict[Tuple[Type[Any], str], events.NodeCommand] = {}
        self._wanted: Set[str] = set()  # the nodes that are to run there
        self._found: Set[str] = set()  # those that were found to
        self._ended: Set[str] = set()  # the robot's own that are to run there no more
        self._watched = events.WatchNodes(())
        self.seen: Optional[events.HostSeen] = None
        self._clock = Watch()
        self._heard_at, self.silence = float("-inf"), 0.0

    @property
    def is_quiet(self) -> bool:
        """True if nothing is under way to the agent, or can be."""
        return not self.is_reached or self._confirmed == self._said

    def take_up(self) -> Tuple[str, ...]:
        """Want what runs there, and return it; what is found later, and not wanted, is stopped."""
        self._settled = True
        self._wanted |= self._found
        return tuple(sorted(self._wanted))

    def carry_out(self, command: HostCommand, now: float) -> None:
        """Begin to carry out a command; see CarryOut."""
        if isinstance(command, events.WatchNodes):
            self._watched = command
        elif isinstance(command, (events.StartSubstitute, events.RestartNode)):
            self._wanted.add(command.node)
            self._ended.discard(command.node)
        elif isinstance(command, events.StopNode):
            self._wanted.discard(command.node)
            if not is_substitute(command.node):
                self._ended.add(command.node)
        if self.is_reached:
            self._send(command)
        else:
            self._answer(command, now, f"{self.name} cannot be reached")

    def heard(self, message: Message, now: float) -> None:
        """Take in a message of the agent."""
        figures = message.load, message.cores, message.transmitted, message.received
        self.seen = events.HostSeen(now, self.name, *figures)
        expected = self._heard + bool(message.event)
        ours = message.session == self._session and message.open
        if message.session < self._session or (ours and message.number < expected):
            return  # it is of a former conversation, or was heard before
        if not ours or message.number > expected:
            why = f"the agent of {self.name} began anew, or was not heard"
            self._begin(now, why, message.session)
            return
        self._heard_at, self._left = now, False
        self._heard, self._confirmed = message.number, message.heard
        if not self.is_reached:
            self._reach(message, now)
        if not message.event:
            self._tell(self.seen)
            return
        with suppress(ModelError):
            event = EVENTS.from_text(message.event, f"the agent of {self.name}", "what it said")
            self._tell(self._ours(event, now))

    def tick(self, now: float, step: float) -> None:
        """Give up an agent that is silent; to be called every `step`."""
        self._clock.look(now, self._clock.now + step)
        self.silence = self._clock.passed(self._heard_at)
        silent = f"answered for {self.silence:.1f} s"
        if self.is_reached and self.silence >= self._patience:
            self._begin(now, f"{self.name} has not {silent}")
        self._left = self._left or (not self.is_reached and self.ended())
        patience = self._returns if self._left else self._patience
        if not self.is_reached and not self._lost and self.silence >= patience:
            self._lost = True
            self._tell(events.HostLost(now, self.name, f"its agent has not {silent}"))

    def beat(self) -> None:
        """Tell the agent that we are there, and how much of it was heard."""
        if self._session:
            self._say("")

    def _begin(self, now: float, why: str, theirs: int = 0) -> None:
        """Begin a conversation after `theirs`, and answer what waits in the former one."""
        self.is_reached = False
        self._session = max(self._session, theirs) + 1
        self._said = self._heard = self._confirmed = 0
        self.beat()
        for command in list(self._waits.values()):
            if not isinstance(command, events.RestartNode):  # it may run, or not: see _reach
                self._answer(command, now, why)

    def _reach(self, message: Message, now: float) -> None:
        """Both ends hear each other: from now on what runs there is what is wanted."""
        self.is_reached, self._lost = True, False
        self._found = set(message.running)
        self._send(self._watched)
        if not self._settled:
            return
        for command in list(self._waits.values()):  # for the answer to a restart
            if command.node not in self._found - self._ended:
                self._answer(command, now, f"the agent of {self.name} was not heard")
        for node in sorted(self._found - self._ended):
            if not is_substitute(node):
                self._wanted.add(node)
                self._tell(self._ours(events.NodeRestarted(now, node), now))
        for node in sorted(self._wanted - self._found):
            self._tell(events.ProcessExited(now, node, f"it has ended on {self.name}"))
        for node in sorted(self._found - self._wanted):
            self._send(events.StopNode(node))

    def _ours(self, event: HostEvent, now: float) -> HostEvent:
        """Return an event by our clock; nothing waits for it any more."""
        for kind, answers in ANSWERS.items():
            if isinstance(event, answers):
                self._waits.pop((kind, event.node), None)
        if isinstance(event, (events.ProcessExited, events.RestartFailed)):
            self._wanted.discard(event.node)
        return replace(event, time=now)

    def _answer(self, command: HostCommand, now: float, why: str) -> None:
        event = not_done(command, now, why)
        if isinstance(command, events.FindNode):
            event = events.NodeFound(now, command.node, Where.UNREACHABLE, why, uri=command.uri)
        if event is not None:
            self._tell(self._ours(event, now))

    def _send(self, command: HostCommand) -> None:
        if not isinstance(command, events.WatchNodes) and type(command) in ANSWERS:
            self._waits[type(command), command.node] = command
        self._said += 1
        self._say(COMMANDS.to_text(command))

    def _say(self, text: str) -> None:
        self._publish(command=text, session=self._session, number=self._said)


class AgentEnd:
    """The agent's end of the conversation with a reconfigurator; of none at first.

    `said`, `heard`: the numbers of the last event and command. A reconfigurator that was silent for
    `patience`, or of which something was lost, must begin anew: what it has said before may come
    late, and is not wanted any more.
    """

    def __init__(self, patience: float) -> None:
        self._patience = patience
        self.session = self.said = self.heard = 0
        self._heard_at = float("-inf")
        self._open = False

    def is_open(self, now: float) -> bool:
        """Return whether the conversation goes on."""
        self._open = self._open and now < self._heard_at + self._patience
        return self._open

    def hear(self, message: Message, now: float) -> bool:
        """Return whether a message holds a command that is to be carried out now."""
        if message.session > self.session:
            self.session, self.said, self.heard, self._open = message.session, 0, 0, True
        elif message.session < self.session or not self.is_open(now):
            return False
        expected = self.heard + bool(message.command)
        if message.number < expected:
            return False  # it was heard before
        self._open = message.number == expected
        if self._open:
            self._heard_at, self.heard = now, message.number
        return self._open and bool(message.command)
