"""The computer that we run on: its processes are learned, found, ended, started and listened to."""
import threading
import time
from typing import Any, Callable, Collection, Dict, List, Optional, Sequence

import psutil
import rospy

from shsa_core import dispatch
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.events import Where
from shsa_core.ros import clock
from shsa_core.ros.processes.coming_up import ComingUp
from shsa_core.ros.processes.nodes import Fence, Known
from shsa_core.ros.processes.heartbeats import Signs, Watch
from shsa_core.ros.processes.starting import Forks, Processes
from shsa_core.ros.processes.protection import Protection
from shsa_core.ros.processes.restarting import Restarts
from shsa_core.ros.workers import Workers
from shsa_core.ros.processes.host import HostCommand, Tell

MOST_CALLS = 32
"""Of one kind of command, under way at the same time."""
LEARNING = 2
LEARN_PAUSE_S = 0.02
"""So many nodes are learned at the same time, and each is followed by a pause: all of a large robot
become healthy in the same moment, and to look at each is work for several processes."""


class LocalHost:
    """A Host of this computer.

    `signs`: who hears the heartbeats of the substitutes, whose names begin with `prefix`.
    `journals`, `secret_file`, `sandbox`, `name`, `forks`: as in Processes; `name` is its `host`.
    """

    def __init__(
        self,
        tell: Tell,
        signs: Signs,
        prefix: str,
        journals: str,
        secret_file: str,
        sandbox: Sequence[str] = (),
        name: str = "",
        forks: Optional[Forks] = None,
    ) -> None:
        self._tell = tell
        self.prefix = prefix
        self._endings: List[threading.Event] = []
        clearing = Workers("clear", MOST_CALLS)
        self.fence = Fence()
        self._protection = Protection()
        self.processes = Processes(
            lambda node, detail: tell(events.ProcessExited(clock.now(), node, detail)),
            lambda node: clearing.put(lambda: self.fence.clear(node)),
            journals,
            secret_file,
            sandbox,
            name,
            forks,
        )
        self.restarts = Restarts(lambda node: tell(events.StarterEnded(clock.now(), node)))
        self._coming_up = ComingUp(self.restarts.started_again, self._came_up)
        self._life = Watch(
            signs,
            lambda node: tell(events.ProcessSilent(clock.now(), node)),
            lambda node: tell(events.ProcessHung(clock.now(), node)),
            lambda node: tell(events.ProcessHeard(clock.now(), node)),
            prefix,
        )
        stops = Workers("stop", MOST_CALLS)
        self._carry_out: dispatch.Table[object] = dispatch.table(
            HostCommand,
            {
                events.LearnNode: self._by(Workers("learn", LEARNING), self._learn),
                events.WatchNodes: self._by(
                    Workers("watch", MOST_CALLS), lambda c: self._coming_up.watch(c.nodes)
                ),
                events.FindNode: self._by(Workers("find", MOST_CALLS), self._find),
                events.AskToLeave: self._by(
                    Workers("ask to leave", MOST_CALLS), self._ask_to_leave
                ),
                events.EndProcess: self._by(Workers("end process", MOST_CALLS), self._end_process),
                events.ClearNode: self._by(clearing, self._clear),
                events.StartSubstitute: self._start,
                events.StopSubstitute: self._by(stops, self._stop, True),
                events.RestartNode: self._restart,
                events.StopNode: self._by(stops, lambda c: self.restarts.stop(c.node), True),
            },
        )

    def carry_out(self, command: HostCommand) -> None:
        """Begin to carry out a command; see Host."""
        try:
            self._carry_out[type(command)](command)
        except Exception as error:  # whatever it is, the commands after it are carried out
            self._failed(command, error)

    def stop_all(self, restarted: Collection[str] = ()) -> None:
        """Stop the substitutes, and these of the nodes that were started again; wait for that."""
        for node in self.processes.running():
            self.carry_out(events.StopSubstitute(node))
        for node in set(restarted).intersection(self.restarts.running()):
            self.carry_out(events.StopNode(node))
        self.await_stops()

    def await_stops(self) -> None:
        """Wait until all has ended that was to be stopped."""
        for ended in self._endings:
            ended.wait()

    def take_up_left(self) -> Dict[str, psutil.Process]:
        """The substitutes that somebody has left running here; from now on they are ours."""
        left = self.processes.left_behind(self.prefix)
        for node, process in left.items():
            self.processes.take_up(node, process)
        return left

    def _by(
        self, workers: Workers, work: Callable[[Any], object], awaited: bool = False
    ) -> Callable[[Any], None]:
        """Work that waits for others must not hold the events up.

        `awaited`: we do not end before it is done.
        """

        def put(command: Any) -> None:
            done = threading.Event()

            def call() -> None:
                try:
                    work(command)
                except Exception as error:  # whatever it is, the next command is carried out
                    self._failed(command, error)
                finally:
                    done.set()

            if awaited:
                self._endings = [each for each in self._endings if not each.is_set()] + [done]
            workers.put(call)

        return put

    def _failed(self, command: HostCommand, error: Exception) -> None:
        """Say that a command could not be carried out, and answer it, so that nobody waits."""
        what = f"{type(command).__name__} {getattr(command, 'node', '')}".strip()
        why = f"{type(error).__name__}: {error}"
        rospy.logerr_throttle(10.0, f"{what} could not be carried out: {why}")
        now = clock.now()
        if isinstance(command, events.LearnNode):
            self._tell(events.NodeLearned(now, command.node, False))
        elif isinstance(command, events.StartSubstitute):
            self._tell(events.ProcessExited(now, command.node, why))
        elif isinstance(command, events.RestartNode):
            self._tell(events.RestartFailed(now, command.node, why))
        elif isinstance(error, OSError):
            return  # this computer lacks the means now; a kill without an answer is tried again
        elif isinstance(command, (events.FindNode, events.AskToLeave, events.EndProcess)):
            self._untouchable(command.node, f"it could not be looked at: {why}")

    def _learn(self, command: events.LearnNode) -> None:
        time.sleep(LEARN_PAUSE_S)
        known = self.fence.learn(command.node, command.topic)
        protected = ""
        if known is not None and known.process is not None:
            self.restarts.learn(command.node, known.process)
            protected = self._protection.reason(command.node, known.process)
            for other in self._protection.sharing(command.node, known.process):
                why = self._protection.reason(other, known.process)
                self._tell(events.NodeLearned(clock.now(), other, True, why))
        self._tell(events.NodeLearned(clock.now(), command.node, known is not None, protected))

    def _came_up(self, node: str, process: Optional[psutil.Process]) -> None:
        if process is not None:
            self.fence.adopt(node, Known("", process))
        self._tell(events.NodeCameUp(clock.now(), node))

    def _find(self, command: events.FindNode) -> None:
        found = self.fence.find(command.node, command.topic, command.successor)
        starter = self.fence.starter(command.node)
        rate = None
        if command.listen and found.where is Where.HERE:
            rate = self.fence.sends(command.node, command.topic, command.listen)
        self._tell(events.NodeFound(clock.now(), command.node, *found, starter, rate))

    def _ask_to_leave(self, command: events.AskToLeave) -> None:
        node = command.node
        failed = lambda why: self._untouchable(node, why)
        self.fence.ask_to_leave(node, lambda: self._left(node), failed)

    def _end_process(self, command: events.EndProcess) -> None:
        node = command.node
        failed = lambda why: self._untouchable(node, why)
        self.fence.end_process(node, lambda: self._left(node), failed)

    def _clear(self, command: events.ClearNode) -> None:
        if not self.fence.clear(command.node):
            self._tell(events.NodeUnregistered(clock.now(), command.node))

    def _left(self, node: str) -> None:
        self._tell(events.NodeLeft(clock.now(), node))

    def _untouchable(self, node: str, why: str) -> None:
        self._tell(events.ProcessUntouchable(clock.now(), node, why))

    def _start(self, command: events.StartSubstitute) -> None:
        asked = clock.now()
        self.processes.start(command)
        self._tell(events.SubstituteStarted(clock.now(), command.node, asked))

    def _stop(self, command: events.StopSubstitute) -> None:
        self.processes.stop(command.node, answers=not self._life.is_silent(command.node))

    def _restart(self, command: events.RestartNode) -> None:
        try:
            process, with_us = self.restarts.start(command.node)
            self.fence.adopt(command.node, Known("", process))
        except (ShsaError, OSError) as error:
            self._tell(events.RestartFailed(clock.now(), command.node, str(error)))
            return
        identities = self.restarts.identities(command.node)
        self._tell(events.NodeRestarted(clock.now(), command.node, with_us, *identities))
