"""Which process each node is, and how it is made to leave; whoever calls decides when.

A name proves nothing, and neither does an address that the master gives for it: anybody registers
both. A process is taken for a node if it listens there by the kernel's word, is of our own user,
and says itself that it publishes the topic, as the master does.
"""
import dataclasses
import os
import threading
from dataclasses import dataclass
from typing import Callable, Dict, FrozenSet, NamedTuple, Optional, Set

import psutil
import rosgraph
import rospy

from shsa_core.healing.events import Where
from shsa_core.ros.processes import kernel, sending
from shsa_core.ros.master.listing import Listing, unregister
from shsa_core.ros.master.node_api import FAILURES, ask, master_api, pid, publications

WATCH_S = 5.0
"""So long it is looked whether a process has ended; whoever asked has given up by then."""
LISTING_AGE_S = 0.4
"""What the master has listed may be so old when a node is learned: many are at the same time."""
WHY = "it failed, and is healed"


@dataclass(frozen=True)
class Known:
    """A node's address, and its process; None: that is on another computer, or cannot be told.

    `dead`: nobody listens at its address, which is on this computer. `topics`: what it publishes.
    `learned`: all that was verified. `ours`: we have started it.
    """

    uri: str
    process: Optional[psutil.Process]
    dead: bool = False
    topics: FrozenSet[str] = frozenset()
    learned: bool = False
    ours: bool = False

    @property
    def lives(self) -> bool:
        """Whether it may still run."""
        return not self.dead and (self.process is None or not kernel.gone(self.process))

    @property
    def where(self) -> Where:
        """Where its process runs."""
        if self.process is None:
            return Where.ELSEWHERE
        return Where.STOPPED if kernel.stopped(self.process) else Where.HERE


class Found(NamedTuple):
    """Where the process of a node runs; `detail`: why it is not touched."""

    where: Where
    detail: str = ""


class Fence:
    """Knows which process each node is.

    Calls take as long as the network does: each in a thread of its own.
    """

    def __init__(self) -> None:
        self._known: Dict[str, Known] = {}
        self._listing = Listing()
        self._said: Set[str] = set()
        self._lock = threading.Lock()

    def look(self, node: str) -> Optional[Known]:
        """The process of a node by what the master and the kernel say now; None: there is none.

        Raises one of FAILURES if the master does not answer.
        """
        try:
            uri = master_api().lookupNode(node)
        except rosgraph.MasterException:
            return None
        process = None
        if kernel.is_local(uri):
            try:
                process = psutil.Process(pid(uri))
            except ConnectionRefusedError:
                return Known(uri, None, dead=True)
            except (*FAILURES, psutil.Error):
                pass  # the kernel knows it as well
            if process is None or not kernel.listens(process, uri):
                process = kernel.listener(uri)
        return Known(uri, process)

    def learn(self, node: str, topic: str) -> Optional[Known]:
        """Remember the process of a healthy publisher of a topic; None: it cannot be verified."""
        known = self._get(node)
        if known is not None and known.process is not None and known.uri:
            if known.lives and topic in known.topics:
                return known
        try:
            current = self.look(node)
            if current is None or current.dead:
                return None  # it has died meanwhile
            why = self._stranger(current)
            if why:
                self._warn(f"{node} can be neither ended for certain nor started again: {why}.")
                return None
            listed = self._listing.has(node, topic, LISTING_AGE_S)
            topics = publications(current.uri) if listed else frozenset()
        except FAILURES as error:
            rospy.logdebug("%s is not learned: %s", node, error)
            return None
        if topic not in topics:
            return None
        return self._put(node, dataclasses.replace(current, topics=topics, learned=True))

    def adopt(self, node: str, known: Known) -> None:
        """Remember a process that we have started: it needs no further proof."""
        self._put(node, dataclasses.replace(known, learned=True, ours=True))

    def find(self, node: str, topic: str, successor: bool) -> Found:
        """Where the process of a publisher runs that failed on a topic.

        The learned one, or if that is dead, its successor.
        """
        known = self._get(node)
        if known is not None and known.process is not None and not known.lives and not successor:
            return Found(Where.DEAD)
        try:
            if known is None or not known.lives:
                current = self.look(node)
                if current is None:
                    return Found(Where.NOWHERE if known is None else Where.DEAD)
                if known is not None and current.uri == known.uri:
                    # Not called again: its address may be an innocent one's by now.
                    return Found(Where.DEAD)
                known = current
                if known.dead:
                    self._put(node, known)
                    return Found(Where.DEAD)
            doubt = self._doubt(node, topic, known)
        except FAILURES as error:
            return Found(Where.UNKNOWN, f"the master does not answer: {error}")
        if doubt is not None:
            return doubt
        return Found(self._put(node, known).where)

    def sends(self, node: str, topic: str, seconds: float) -> Optional[float]:
        """How many messages/s a node that was found sends on a topic; see `sending.rate`."""
        known = self._get(node)
        try:
            uri = self._uri(node, known) if known is not None else ""
        except FAILURES:
            return None
        return sending.rate(uri, topic, seconds) if uri else None

    def ask_to_leave(
        self, node: str, left: Callable[[], None], failed: Callable[[str], None]
    ) -> None:
        """`rosnode kill` by its API; calls `left` once the process has ended.

        Elsewhere, once nobody listens any more where the node has answered; else `failed(why)`.
        """
        known = self._get(node)
        if known is None:
            failed("it is not known which process it is")
        elif known.process is None:
            self._ask_elsewhere(node, known.uri, left, failed)
        else:
            threading.Thread(target=self._ask, args=(node, known), daemon=True).start()
            kernel.await_end(known.process, WATCH_S, left)

    def starter(self, node: str) -> str:
        """The process that has started a node that was found, in words; empty: not known."""
        known = self._get(node)
        try:
            parent = known.process.parent() if known and known.process else None
            words = parent.cmdline() if parent is not None else []
        except psutil.Error:
            return ""
        names = [os.path.basename(word) for word in words[:2]]
        if parent is None or not names:
            return ""
        name = names[-1] if names[0].startswith("python") else names[0]
        return f"{name!a}, process {parent.pid}"

    def end_process(
        self, node: str, left: Callable[[], None], failed: Callable[[str], None]
    ) -> None:
        """`kill -9`; calls `left` once the process has ended, `failed(why)` if it is not ours."""
        known = self._get(node)
        if known is None or known.process is None:
            failed("it is not known which process it is")
            return
        try:
            kernel.kill(known.process)
        except ProcessLookupError:
            left()
        except PermissionError as error:
            failed(f"it does not leave, and {error}")
        else:
            kernel.await_end(known.process, WATCH_S, left)

    def clear(self, node: str) -> bool:
        """Clear what a dead node left registered at the master, and nothing of a successor.

        False: it was no publisher any more, and so had unregistered itself.
        """
        with self._lock:
            known = self._known.get(node)
            if known is not None and known.process is not None and known.lives:
                return True
            self._known.pop(node, None)
        uri = known.uri if known else ""
        try:
            if not uri:
                uri = master_api().lookupNode(node)
                if known is not None and kernel.listener(uri) is not None:
                    return True  # it was ended before it registered: this is a successor
            return unregister(node, uri)
        except FAILURES:
            return True  # the master does not know it, or is away: there is nothing to be cleared

    def _get(self, node: str) -> Optional[Known]:
        with self._lock:
            return self._known.get(node)

    def _put(self, node: str, known: Known) -> Known:
        with self._lock:
            self._known[node] = known
        return known

    def _warn(self, text: str) -> None:
        """Say it once."""
        if text not in self._said:
            self._said.add(text)
            rospy.logwarn("%s", text)

    def _stranger(self, known: Known) -> str:
        """Why a process is none that may be ended; empty: it may be."""
        if known.process is None:
            return "its process is somebody else's" if kernel.is_local(known.uri) else ""
        if not kernel.is_ours(known.process):
            return f"its process belongs to {kernel.user(known.process)}"
        return kernel.never_to_end(known.process)

    def _doubt(self, node: str, topic: str, known: Known) -> Optional[Found]:
        """Why this may not be who failed; None: there is no doubt.

        Raises one of FAILURES if the master does not answer.
        """
        if known.ours or (known.learned and topic in known.topics):
            return None
        why = kernel.never_to_end(known.process) if known.process is not None else ""
        if why or not topic:
            return Found(Where.ANOTHER, why or "nobody says what it failed on")
        if not self._listing.has(node, topic, 0.0):
            why = f"the master does not list it as a publisher of {topic}"
            return Found(Where.ANOTHER, why)
        try:
            topics = publications(known.uri)
        except FAILURES as error:
            if known.learned:
                return None  # it was seen well, and hangs now
            return Found(Where.UNKNOWN, f"it was never seen well, and cannot be verified: {error}")
        if topic in topics:
            return None
        return Found(Where.ANOTHER, f"whoever answers at its address does not publish {topic}")

    def _ask(self, node: str, known: Known) -> None:
        """Ask a node here to leave; whether it does, its process tells."""
        try:
            uri = self._uri(node, known)
            if uri:
                ask(uri, "shutdown", WHY)
        except FAILURES as error:
            rospy.logdebug("%s was asked to leave: %s", node, error)

    def _uri(self, node: str, known: Known) -> str:
        """The address of a node; empty: it has none now. Raises one of FAILURES."""
        if known.uri:
            return known.uri
        current = self.look(node)  # it was not up yet when we started it
        return current.uri if current and current.process == known.process else ""

    def _ask_elsewhere(
        self, node: str, uri: str, left: Callable[[], None], failed: Callable[[str], None]
    ) -> None:
        """A node on another computer has ended if it listens no more, and has said so before.

        To the master, when it left by itself, or to us.
        """
        try:
            ask(uri, "shutdown", WHY)
        except ConnectionRefusedError:
            if self._is_registered(node):
                failed("it refuses the connection, and cannot be verified to have ended")
            else:
                left()
            return
        except FAILURES as error:
            failed(f"it cannot be verified to have ended: {error}")
            return
        if kernel.await_refusal(uri, WATCH_S):
            left()

    def _is_registered(self, node: str) -> bool:
        """Whether the master knows a node; True as well if that cannot be told."""
        try:
            master_api().lookupNode(node)
        except rosgraph.MasterException:
            return False
        except FAILURES:
            return True
        return True
