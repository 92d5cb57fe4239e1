"""The computer that we run on: its processes are learned, found, ended, started, listened to."""
import signal
import socket
import time
from contextlib import suppress
from typing import Any, Callable, List

import psutil
import rospy

from shsa_core import dispatch
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.events import Where
from shsa_core.healing.settings import LEAVE_S
from shsa_core.hosts.conversation import HostCommand, Tell, not_done
from shsa_core.ros import clock, settings
from shsa_core.ros.master.node_api import FAILURES, ask, master_api, rate, resolved, uri_of
from shsa_core.ros.processes import kernel, priority
from shsa_core.ros.processes.heartbeats import Signs
from shsa_core.ros.processes.nodes import Nodes, protection
from shsa_core.ros.processes.restarting import Restarts
from shsa_core.ros.processes.starting import Substitutes, Setup
from shsa_core.ros.processes.watching import Life
from shsa_core.ros.trust.owners import listener
from shsa_core.ros.workers import Workers

Work = Callable[[Any], object]
LEARNING = 2
"""Nodes that are learned at the same time: to look at each is work for several processes."""


class LocalHost:
    """This computer; `signs` has the heartbeats of the substitutes."""

    def __init__(self, tell: Tell, signs: Signs, setup: Setup) -> None:
        self._tell = tell
        self.prefix, self._may_restart = setup.prefix, setup.restarts
        clearing = Workers("clear", settings.MOST_CALLS)
        self.nodes = Nodes()
        self.substitutes = Substitutes(
            lambda node, detail: tell(events.ProcessExited(clock.now(), node, detail)),
            lambda node: clearing.put(lambda: clear(self.nodes, node)),
            setup,
        )
        self.children = self.substitutes.children
        ended = lambda node: tell(events.StarterEnded(clock.now(), node))
        self.restarts = Restarts(self.children, ended, self._came_up, setup.host)
        Life(signs, lambda node: node.startswith(setup.prefix), tell)
        self._stops = Workers("stop", settings.MOST_CALLS)
        stop = self._by(self._stops, lambda c: self.children.stop(c.node))
        by = lambda name, work, most=settings.MOST_CALLS: self._by(Workers(name, most), work)
        self._carry_out: dispatch.Table[object] = dispatch.table(
            HostCommand,
            {
                events.LearnNode: by("learn", self._learn, LEARNING),
                events.WatchNodes: lambda c: self.restarts.watch(c.nodes),
                events.FindNode: by("find", self._find),
                events.AskToLeave: by("ask to leave", self._ask_to_leave),
                events.EndProcess: by("end process", self._end_process),
                events.ClearNode: self._by(clearing, self._clear),
                events.StartSubstitute: self._start,
                events.RestartNode: self._restart,
                events.StopNode: stop,
            },
        )

    def carry_out(self, command: HostCommand) -> None:
        """Begin to carry out a command; see CarryOut."""
        self._guarded(self._carry_out[type(command)], command)

    def hurry(self, node: str) -> None:
        """Have a substitute come before others, also to hear that it is to publish."""
        process = self.children.process(node)
        if process is not None:
            priority.set_all(priority.HURRIES, process.pid)

    def take_up(self) -> List[str]:
        """Make ours what a former reconfigurator or agent has left running; return the nodes."""
        return [*self.substitutes.take_up(), *self.restarts.take_up()]

    def stop_all(self) -> None:
        """Stop the substitutes, and the nodes that would have ended with us; wait for that."""
        ours = [node for node in self.children.running() if node.startswith(self.prefix)]
        for node in (*ours, *self.restarts.abandoned(ending=True)):
            self.carry_out(events.StopNode(node))
        self.await_stops()

    def await_stops(self) -> None:
        """Wait until all has ended that was to be stopped."""
        self._stops.join()

    def _by(self, workers: Workers, work: Work) -> Work:
        """Return what has a command carried out by workers: to wait must not hold the events up."""
        return lambda command: workers.put(lambda: self._guarded(work, command))

    def _guarded(self, work: Work, command: HostCommand) -> None:
        try:
            work(command)
            return
        except ShsaError as refusal:
            why = str(refusal)
        except Exception as error:  # whatever it is, the commands after it are carried out
            why = f"it could not be carried out: {type(error).__name__}: {error}"
            what = f"{type(command).__name__} {getattr(command, 'node', '')}".strip()
            rospy.logerr_throttle(10.0, f"{what}: {why}")
            kill = isinstance(command, (events.FindNode, events.AskToLeave, events.EndProcess))
            if kill and isinstance(error, OSError):
                return  # this computer may lack the means now: a kill without an answer is repeated
        answer = not_done(command, clock.now(), why)
        if answer is not None:
            self._tell(answer)

    def _learn(self, command: events.LearnNode) -> None:
        node = command.node
        time.sleep(settings.PAUSE_S)
        known = self.nodes.learn(node, command.topic)
        process = known.process if known else None
        if process is None:
            self._tell(events.NodeLearned(clock.now(), node, known is not None, starts=False))
            return
        self.restarts.learn(node, process)
        sharing = self.nodes.sharing(process) | {node}
        for each in sharing:
            why = protection(each, process, sharing - {each})
            starts = self._may_restart and self.restarts.knows(each)
            self._tell(events.NodeLearned(clock.now(), each, True, why, starts))

    def _came_up(self, node: str, process: psutil.Process) -> None:
        self.nodes.adopt(node, process)
        self._tell(events.NodeCameUp(clock.now(), node))

    def _find(self, command: events.FindNode) -> None:
        node, life = command.node, command.uri
        found = self.nodes.find(command)
        sent = None
        if command.listen and found.where is Where.HERE:
            with suppress(*FAILURES):
                uri = self.nodes.uri(node)
                sent = rate(uri, command.topic, command.listen) if uri else None
        self._tell(events.NodeFound(clock.now(), node, *found, self._starter(node), sent, life))

    def _starter(self, node: str) -> str:
        known = self.nodes.known(node)
        process = known.process if known else None
        for starter in kernel.ancestors(process.pid)[:1] if process else ():
            for *_, name in kernel.programs(starter):
                if not name.startswith("python"):
                    return f"{name!a}, process {starter.pid}"
        return ""

    def _ask_to_leave(self, command: events.AskToLeave) -> None:
        life = command.node, command.uri
        answered = lambda: self._tell(events.NodeAnswered(clock.now(), *life))
        if ask_to_leave(self.nodes, command.node, answered):
            self._tell(events.NodeLeft(clock.now(), *life))

    def _end_process(self, command: events.EndProcess) -> None:
        if end_process(self.nodes, command.node, command.gently):
            self._tell(events.NodeLeft(clock.now(), command.node, command.uri))

    def _clear(self, command: events.ClearNode) -> None:
        if not clear(self.nodes, command.node):
            self._tell(events.NodeUnregistered(clock.now(), command.node))

    def _start(self, command: events.StartSubstitute) -> None:
        self.substitutes.start(command)
        self._tell(events.SubstituteStarted(clock.now(), command.node))

    def _restart(self, command: events.RestartNode) -> None:
        node = command.node
        if not self._may_restart:
            raise ShsaError("that would be as root there (restart_as_root:=true)")
        self.nodes.adopt(node, self.restarts.start(node))
        self._tell(events.NodeRestarted(clock.now(), node))


def ask_to_leave(nodes: Nodes, node: str, answered: Callable[[], object] = lambda: None) -> bool:
    """`rosnode kill` by its API; return whether the process has ended in time. Raises ShsaError."""
    known = nodes.known(node)
    if known is None:
        raise ShsaError("it is not known which process it is")
    process, uri = known.process, known.uri
    if process is not None and not known.lives:
        return True  # its address may be another node's by now
    try:
        uri = nodes.uri(node)
        if uri:
            ask(uri, "shutdown", "it failed, and is healed")
            answered()
    except FAILURES as error:
        if process is None:
            return _has_left(node, error)
    gone = lambda: kernel.gone(process) if process else _refuses(uri)
    return kernel.wait_for(gone, LEAVE_S)


def end_process(nodes: Nodes, node: str, gently: bool = False) -> bool:
    """End a node's process by SIGKILL, or SIGTERM; return whether it ended. Raises ShsaError."""
    known = nodes.known(node)
    process = known.process if known else None
    if process is None:
        raise ShsaError("it is not known which process it is")
    try:
        kernel.kill(process, signal.SIGTERM if gently else signal.SIGKILL)
    except ProcessLookupError:
        return True
    except PermissionError as error:
        raise ShsaError(f"it does not leave, and {error}") from error
    return kernel.wait_for(lambda: kernel.gone(process))


def clear(nodes: Nodes, node: str) -> bool:
    """Clear what a dead node left registered; False: it had unregistered itself as a publisher."""
    uri = nodes.forget(node)
    if uri is None:
        return True
    try:
        if not uri:
            uri = uri_of(node)
            if not uri or listener(resolved(uri)) is not None:
                return True  # there is nothing, or a successor: it was ended before it registered
        return _unregister(node, uri)
    except FAILURES:
        return True  # the master is away: there is nothing to be cleared


def _has_left(node: str, error: Exception) -> bool:
    """Return whether a node on another computer, which does not answer, is not registered."""
    with suppress(*FAILURES):  # the master does not tell
        if isinstance(error, ConnectionRefusedError) and not uri_of(node):
            return True
    raise ShsaError(f"it cannot be verified to have ended: {error}") from error


def _refuses(uri: str) -> bool:
    """Return whether nobody listens any more at an address; no answer is no proof."""
    try:
        socket.create_connection(resolved(uri), settings.CALL_S).close()
    except OSError as error:
        return isinstance(error, ConnectionRefusedError)
    return False


def _unregister(node: str, uri: str) -> bool:
    """Unregister (node, uri), not a successor at another uri; return whether it was a publisher."""
    master = master_api(node)
    publishers, subscribers, services = master.getSystemState()
    for topic in (topic for topic, nodes in publishers if node in nodes):
        master.unregisterPublisher(topic, uri)
    for topic in (topic for topic, nodes in subscribers if node in nodes):
        master.unregisterSubscriber(topic, uri)
    for name, nodes in services:
        if node in nodes and master.lookupNode(node) == uri:
            master.unregisterService(name, master.lookupService(name))
    return any(node in nodes for _, nodes in publishers)
