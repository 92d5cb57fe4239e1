"""The process of each node: learned while it is healthy, verified before it is touched.

Anybody can register a name and an address. A process is taken for a node if it listens there by the
kernel's word, is of our own user, and says itself that it publishes the topic, as the master does.
"""
import threading
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Dict, FrozenSet, Iterable, NamedTuple, Optional, Set, Tuple

import psutil
import rospy

from shsa_core.healing.events import FindNode, Where
from shsa_core.ros import settings
from shsa_core.ros.master.node_api import FAILURES, Address, address, located, master_api
from shsa_core.ros.master.node_api import node_api, pid, resolved, topics, uri_at, uri_of
from shsa_core.ros.processes import kernel
from shsa_core.ros.trust.owners import answers_at, is_local, listener, listening


@dataclass(frozen=True)
class Known:
    """A node's address, and its process; None: that is on another computer, or cannot be told.

    `dead`: nobody listens at its address, which is on this computer. `topics`: what it publishes.
    `learned`: all that was verified. `uri`: empty: we have started it. `at`: its numeric form.
    """

    uri: str
    process: Optional[psutil.Process]
    dead: bool = False
    topics: FrozenSet[str] = frozenset()
    learned: bool = False
    at: str = ""

    @property
    def lives(self) -> bool:
        """True if it may still run."""
        return not self.dead and (self.process is None or not kernel.gone(self.process))


class Found(NamedTuple):
    """The place where a node's process runs; `detail`: why it is not touched."""

    where: Where
    detail: str = ""


class Nodes:
    """Knows which process each node is. Calls take as long as the network does."""

    def __init__(self) -> None:
        self._known: Dict[str, Known] = {}
        self._said: Set[Tuple[str, str]] = set()
        self._lock = threading.Lock()

    def known(self, node: str) -> Optional[Known]:
        """Return what was learned or found of a node last."""
        with self._lock:
            return self._known.get(node)

    def forget(self, node: str) -> Optional[str]:
        """Forget a node; return its address, empty if none is known. None: its process lives."""
        with self._lock:
            known = self._known.get(node)
            if known is not None and known.process is not None and known.lives:
                return None
            self._known.pop(node, None)
            return known.uri if known else ""

    def sharing(self, process: psutil.Process) -> Set[str]:
        """Return the nodes that were found in a process."""
        with self._lock:
            return {node for node, known in self._known.items() if known.process == process}

    def look(self, node: str) -> Optional[Known]:
        """Return a node's process by what master and kernel say now. Raises one of FAILURES."""
        uri = uri_of(node)
        if not uri:
            return None
        try:
            at = located(uri)
        except FAILURES:
            return Known(uri, None)
        if not is_local(at):
            return Known(uri, None, at=at)
        hint, process = 0, None
        for _ in range(2):  # one that has answered may end before it is looked for
            try:
                hint = pid(at)
            except ConnectionRefusedError:
                return Known(uri, None, dead=True)
            except FAILURES:
                hint = 0  # the kernel is asked all the same
            process = listener(resolved(at), hint)
            if process is not None:
                break
        return Known(uri, process, at=at)

    def uri(self, node: str) -> str:
        """Return the address of a known node; empty: it has none now. Raises one of FAILURES."""
        known = self.known(node)
        if known is None:
            return ""
        if known.uri:
            return known.uri
        current = self.look(node)  # it was not up yet when we started it
        return current.uri if current and current.process == known.process else ""

    def learn(self, node: str, topic: str) -> Optional[Known]:
        """Remember the process of a healthy publisher of a topic; None: it cannot be verified."""
        known = self.known(node)
        if known is not None and known.process and known.lives and topic in known.topics:
            return known
        try:
            current = self.look(node)
            if current is None or current.dead:
                return None  # it has died meanwhile
            why = _stranger(current)
            said = frozenset(() if why else topics(current.at))
        except FAILURES as error:
            rospy.logdebug("%s is not learned: %s", node, error)
            return None
        if why and (node, why) not in self._said:
            self._said.add((node, why))
            rospy.logwarn("%s can be neither ended for certain nor started again: %s.", node, why)
        if topic not in said:
            return None
        return self._put(node, replace(current, topics=said, learned=True))

    def adopt(self, node: str, process: psutil.Process) -> None:
        """Remember a process that we have started: it needs no further proof."""
        self._put(node, Known("", process, learned=True))

    def find(self, asked: FindNode) -> Found:
        """Find where the process runs that failed: the learned one, or its successor."""
        node, uri, known = asked.node, asked.uri, self.known(asked.node)
        dead = known is not None and known.process is not None and not known.lives
        if dead and not asked.successor:
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
            doubt = self._doubt(node, asked.topic, known)
        except FAILURES as error:
            return Found(Where.UNKNOWN, f"the master does not answer: {error}")
        if doubt is not None:
            return doubt
        if uri and not _listens(known, uri):
            process = known.process if known.learned else None
            if process and kernel.wait_for(partial(kernel.gone, process), settings.LOOK_S):
                return Found(Where.DEAD)  # it closed its address first, as on `rosnode kill`
            return Found(Where.ANOTHER, f"the one that failed is at {uri}, and it is not")
        if asked.spares and known.process is not None and not known.learned:
            why = protection(node, known.process, self.sharing(known.process) - {node})
            if why:
                return Found(Where.PROTECTED, why)
        self._put(node, known)
        if known.process is None:
            return Found(Where.ELSEWHERE)
        return Found(Where.STOPPED if kernel.stopped(known.process.pid) else Where.HERE)

    def _put(self, node: str, known: Known) -> Known:
        with self._lock:
            self._known[node] = known
        return known

    def _doubt(self, node: str, topic: str, known: Known) -> Optional[Found]:
        """Return why this may not be the node that failed. Raises one of FAILURES: no master."""
        if not known.uri or (known.learned and topic in known.topics):
            return None
        why = kernel.never_to_end(known.process) if known.process is not None else ""
        if why or not topic:
            return Found(Where.ANOTHER, why or "nobody says what it failed on")
        publishers, _, _ = master_api().getSystemState()
        if not any(node in nodes for each, nodes in publishers if each == topic):
            return Found(Where.ANOTHER, f"the master does not list it as a publisher of {topic}")
        try:
            publishes = topic in topics(known.at)
        except FAILURES as error:
            if known.learned:
                return None  # it was seen well, and hangs now
            if known.process and isinstance(error, ConnectionRefusedError):
                return Found(Where.DEAD)  # it ended since it was looked up
            return Found(Where.UNKNOWN, f"it was never seen well, and cannot be verified: {error}")
        why = f"what answers at its address does not publish {topic}"
        return None if publishes else Found(Where.ANOTHER, why)


def _listens(known: Known, uri: str) -> bool:
    if known.process is None or (not known.uri and listening(resolved(uri)) is None):
        return True
    return answers_at(known.process.pid, resolved(uri))


def _stranger(known: Known) -> str:
    if known.process is None:
        return "its process is somebody else's" if is_local(known.uri) else ""
    if not kernel.is_ours(known.process):
        return f"its process belongs to {kernel.user(known.process)}"
    return kernel.never_to_end(known.process)


def protection(node: str, process: psutil.Process, others: Iterable[str]) -> str:
    """Return why a node is protected whose process `others` share; empty: it is not."""
    if [name for *_, name in kernel.programs(process)] == ["nodelet", "manager"]:
        return "its process is a nodelet manager"
    if others:
        return f"its process is that of {', '.join(sorted(others))} too"
    if _is_required(node, process):
        return 'its launch file says required="true"'
    return ""


def _is_required(node: str, process: psutil.Process) -> bool:
    with suppress(*FAILURES, psutil.Error, AttributeError):
        rows = psutil.Process(process.ppid()).connections("tcp")
        places = [Address(*row.laddr) for row in rows if row.status == psutil.CONN_LISTEN]
        # Another program is called only where it says that it launches nodes.
        if places and not kernel.started_by_launch(process.pid):
            uris = master_api().getParam("/roslaunch/uris").values()
            places = [each for each in places if each.port in {address(uri).port for uri in uris}]
        return any(_requires(uri_at(each), node, process.pid) for each in places)
    return False


def _requires(uri: str, node: str, pid: int) -> bool:
    roslaunch: Any = node_api(uri)
    try:
        _, _, (alive, _) = roslaunch.list_processes()
        # roslaunch calls the process of /name `name-3`: the third that it has started.
        mine = [name for name, _ in alive if "/" + name.rsplit("-", 1)[0].strip("/") == node]
        infos = [roslaunch.process_info(name)[2] for name in mine]
        return any(info.get("pid") == pid and info.get("required") for info in infos)
    except (*FAILURES, ValueError, TypeError, AttributeError, LookupError):
        return False  # it has ended, or is none
