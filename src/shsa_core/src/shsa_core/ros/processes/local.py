"""The computer that we run on: its processes are learned, found, ended, started and listened to.

A kill asks a node to leave, ends its process, clears its registrations; healing decides when each
step comes, and which process a node is was verified before (`nodes`).
"""
import signal
import socket
import threading
import time
from contextlib import suppress
from typing import Any, Callable, List, Optional

import psutil
import rospy

from shsa_core import dispatch
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.events import Where
from shsa_core.healing.settings import LEAVE_S
from shsa_core.hosts.commands import HostCommand, Tell, not_done
from shsa_core.ros import clock, settings
from shsa_core.ros.master.node_api import FAILURES, ask, master_api, rate, resolved, uri_of
from shsa_core.ros.processes import kernel, priority
from shsa_core.ros.processes.heartbeats import Signs
from shsa_core.ros.processes.nodes import Known, Nodes, protection
from shsa_core.ros.processes.restarting import ComingUp, Restarts
from shsa_core.ros.processes.starting import Substitutes, Setup
from shsa_core.ros.processes.watching import Life
from shsa_core.ros.trust.owners import listener
from shsa_core.ros.workers import Workers

Work = Callable[[Any], object]
"""Carries out a command."""
WHY = "it failed, and is healed"
LEARNING = 2
"""So many nodes are learned at the same time: to look at each is work for several processes."""


class Untouchable(ShsaError):
    """It is not known which process a node is, whether it may be ended, or whether it has left."""


class LocalHost:
    """A Host of this computer; `signs` has the heartbeats of the substitutes."""

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
        ended = lambda node: tell(events.StarterEnded(clock.now(), node))
        self.restarts = Restarts(ended, setup.host)
        self._coming_up = ComingUp(self.restarts.started_again, self._came_up)
        Life(signs, lambda node: node.startswith(setup.prefix), tell)
        self._stops = stops = Workers("stop", settings.MOST_CALLS)
        by = lambda name, work, most=settings.MOST_CALLS: self._by(Workers(name, most), work)
        self._carry_out: dispatch.Table[object] = dispatch.table(
            HostCommand,
            {
                events.LearnNode: by("learn", self._learn, LEARNING),
                events.WatchNodes: by("watch", lambda c: self._coming_up.watch(c.nodes)),
                events.FindNode: by("find", self._find),
                events.AskToLeave: by("ask to leave", self._ask_to_leave),
                events.EndProcess: by("end process", self._end_process),
                events.ClearNode: self._by(clearing, self._clear),
                events.StartSubstitute: self._start,
                events.StopSubstitute: self._by(stops, self._stop),
                events.RestartNode: self._restart,
                events.StopNode: self._by(stops, lambda c: self.restarts.children.stop(c.node)),
            },
        )

    def carry_out(self, command: HostCommand) -> None:
        """Begin to carry out a command; see Host."""
        self._guarded(self._carry_out[type(command)], command)

    def hurry(self, node: str) -> None:
        """Have a substitute come before others, also to hear that it is to publish."""
        process = self.substitutes.children.process(node)
        if process is not None:
            priority.set_all(priority.HURRIES, process.pid)

    def take_up(self) -> List[str]:
        """Make ours what a former reconfigurator or agent has left running; return the nodes."""
        left = self.substitutes.left_behind()
        for node, process in left.items():
            self.substitutes.take_up(node, process)
        return [*left, *self.restarts.take_up()]

    def stop_all(self) -> None:
        """Stop the substitutes, and the nodes that would have ended with us; wait for that."""
        for node in self.substitutes.children.running():
            self.carry_out(events.StopSubstitute(node))
        for node in filter(self.restarts.is_with_us, self.restarts.children.running()):
            self.carry_out(events.StopNode(node))
        self.await_stops()

    def await_stops(self) -> None:
        """Wait until all has ended that was to be stopped."""
        self._stops.join()

    def _by(self, workers: Workers, work: Work) -> Work:
        """Return what has a command carried out by workers: to wait must not hold the events up."""
        return lambda command: workers.put(lambda: self._guarded(work, command))

    def _guarded(self, work: Work, command: HostCommand) -> None:
        """Carry out a command; if that cannot be done, answer it, so that nobody waits."""
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
        why = ""
        if known is not None and known.process is not None:
            self.restarts.learn(node, known.process)
            sharing = self.nodes.sharing(node, known.process)
            why = protection(node, known.process, sharing)
            for other in sharing:
                others = sharing - {other} | {node}
                told = protection(other, known.process, others)
                self._tell(events.NodeLearned(clock.now(), other, True, told))
        self._tell(events.NodeLearned(clock.now(), node, known is not None, why))

    def _came_up(self, node: str, process: Optional[psutil.Process]) -> None:
        if process is not None:
            self.nodes.adopt(node, Known("", process))
        self._tell(events.NodeCameUp(clock.now(), node))

    def _find(self, command: events.FindNode) -> None:
        node = command.node
        found = self.nodes.find(node, command.topic, command.successor, command.uri)
        rate = None
        if command.listen and found.where is Where.HERE:
            rate = self._rate(node, command.topic, command.listen)
        self._tell(events.NodeFound(clock.now(), node, *found, self._starter(node), rate))

    def _rate(self, node: str, topic: str, seconds: float) -> Optional[float]:
        try:
            uri = self.nodes.uri(node)
        except FAILURES:
            return None
        return rate(uri, topic, seconds) if uri else None

    def _starter(self, node: str) -> str:
        """Return the process that has started a node, in words; empty: not known."""
        known = self.nodes.known(node)
        if known is None or known.process is None:
            return ""
        number, programs = kernel.starter(known.process.pid)
        if not programs:
            return ""
        name = programs[-1] if programs[0].startswith("python") else programs[0]
        return f"{name!a}, process {number}"

    def _ask_to_leave(self, command: events.AskToLeave) -> None:
        node = command.node
        answered = lambda: self._tell(events.NodeAnswered(clock.now(), node))
        if ask_to_leave(self.nodes, node, answered):
            self._tell(events.NodeLeft(clock.now(), node))

    def _end_process(self, command: events.EndProcess) -> None:
        if end_process(self.nodes, command.node, command.gently):
            self._tell(events.NodeLeft(clock.now(), command.node))

    def _clear(self, command: events.ClearNode) -> None:
        if not clear(self.nodes, command.node):
            self._tell(events.NodeUnregistered(clock.now(), command.node))

    def _start(self, command: events.StartSubstitute) -> None:
        self.substitutes.start(command)
        self._tell(events.SubstituteStarted(clock.now(), command.node))

    def _stop(self, command: events.StopSubstitute) -> None:
        self.substitutes.children.stop(command.node)

    def _restart(self, command: events.RestartNode) -> None:
        node = command.node
        if not self._may_restart:
            raise ShsaError("that would be as root there (restart_as_root:=true)")
        self.nodes.adopt(node, Known("", self.restarts.start(node)))
        self._tell(events.NodeRestarted(clock.now(), node, self.restarts.is_with_us(node)))


def ask_to_leave(nodes: Nodes, node: str, answered: Callable[[], object] = lambda: None) -> bool:
    """`rosnode kill` by its API; return whether the process has ended in time.

    `answered` is called when the node has. Elsewhere, return whether nobody listens any more where
    it has answered. Raises Untouchable.
    """
    known = nodes.known(node)
    if known is None:
        raise Untouchable("it is not known which process it is")
    if known.process is None:
        return _ask_elsewhere(node, known.uri, answered)
    process = known.process
    threading.Thread(target=_ask, args=(nodes, node, answered), daemon=True).start()
    return kernel.wait_for(lambda: kernel.gone(process), LEAVE_S)


def end_process(nodes: Nodes, node: str, gently: bool = False) -> bool:
    """End a node's process by SIGKILL, or SIGTERM; return whether it ended. Raises Untouchable."""
    known = nodes.known(node)
    if known is None or known.process is None:
        raise Untouchable("it is not known which process it is")
    process = known.process
    try:
        kernel.kill(process, signal.SIGTERM if gently else signal.SIGKILL)
    except ProcessLookupError:
        return True
    except PermissionError as error:
        raise Untouchable(f"it does not leave, and {error}") from error
    return kernel.wait_for(lambda: kernel.gone(process))


def clear(nodes: Nodes, node: str) -> bool:
    """Clear what a dead node left registered at the master, and nothing of a successor.

    False: it was no publisher any more, and so had unregistered itself.
    """
    known = nodes.forget(node)
    if known is not None and known.process is not None and known.lives:
        return True
    uri = known.uri if known else ""
    try:
        if not uri:
            uri = uri_of(node)
            if not uri or (known is not None and listener(resolved(uri)) is not None):
                return True  # there is nothing, or a successor: it was ended before it registered
        return _unregister(node, uri)
    except FAILURES:
        return True  # the master is away: there is nothing to be cleared


def _ask(nodes: Nodes, node: str, answered: Callable[[], object]) -> None:
    """Ask a node here to leave; whether it does, its process tells."""
    try:
        uri = nodes.uri(node)
        if uri:
            ask(uri, "shutdown", WHY)
            answered()
    except FAILURES as error:
        rospy.logdebug("%s was asked to leave: %s", node, error)


def _ask_elsewhere(node: str, uri: str, answered: Callable[[], object]) -> bool:
    """Ask a node on another computer to leave.

    It has ended if it listens no more, and has said so before: to the master, when it left by
    itself, or to us.
    """
    try:
        ask(uri, "shutdown", WHY)
    except ConnectionRefusedError as error:
        with suppress(*FAILURES):  # the master does not tell
            if not uri_of(node):
                return True
        why = "it refuses the connection, and cannot be verified to have ended"
        raise Untouchable(why) from error
    except FAILURES as error:
        raise Untouchable(f"it cannot be verified to have ended: {error}") from error
    answered()
    return kernel.wait_for(lambda: _refuses(uri), LEAVE_S)


def _refuses(uri: str) -> bool:
    """Return whether nobody listens any more at an address; no answer is no proof."""
    try:
        socket.create_connection(resolved(uri), settings.CALL_S).close()
    except OSError as error:
        return isinstance(error, ConnectionRefusedError)
    return False


def _unregister(node: str, uri: str) -> bool:
    """Unregister (node, uri) everywhere; a successor with the same name has another uri.

    Return whether the node was a publisher. Raises one of FAILURES if the master does not answer.
    """
    master = master_api(node)
    publishers, subscribers, services = master.getSystemState()
    for topic, nodes in publishers:
        if node in nodes:
            master.unregisterPublisher(topic, uri)
    for topic, nodes in subscribers:
        if node in nodes:
            master.unregisterSubscriber(topic, uri)
    for name, nodes in services:
        if node in nodes and master.lookupNode(node) == uri:
            master.unregisterService(name, master.lookupService(name))
    return any(node in nodes for _, nodes in publishers)
