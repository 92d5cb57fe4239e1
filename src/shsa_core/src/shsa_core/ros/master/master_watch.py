"""Watches the master, from threads of its own: nobody else waits for it.

A master that was started anew is told what the former one knew, within a second. Subscribers whom
the master cannot tell of a publisher, as its threads wait for hung ones, are told directly.
"""
import threading
import time
from functools import partial
from typing import Any, Callable, Collection, Dict, FrozenSet, List, Mapping, NamedTuple, Optional
from typing import Set, Tuple

import rospy

from shsa_core.errors import ShsaError
from shsa_core.files.som_file import PARAMETER
from shsa_core.ros import settings
from shsa_core.ros.master.bus import connected
from shsa_core.ros.master.introductions import Introductions, Publisher
from shsa_core.ros.master.master_calls import MasterCalls, State
from shsa_core.ros.master.node_api import FAILURES, node_api
from shsa_core.ros.master.registrations import (
    NOTHING,
    Graph,
    Part,
    Said,
    is_name,
    missing_parameters,
    to_ask,
    to_register,
    together,
)
from shsa_core.ros.workers import Workers

LARGEST_PARAMETERS = 4_000_000
"""Characters; of more than that nothing is kept but the SOM."""


class MasterState(NamedTuple):
    """The state of the master and its subscribers, for people.

    A new master would be told of `kept` registrations, which were looked up `age` s ago.
    """

    answers: bool = True
    hung: Tuple[str, ...] = ()
    kept: int = 0
    age: float = 0.0


class MasterWatch:
    """Looks at the master for as long as ROS is up.

    `is_ours(node)`: whether a node is one of our substitutes. While `acts` is false it only looks,
    as healing that advises.
    """

    def __init__(self, is_ours: Callable[[str], bool]) -> None:
        self._is_ours, self.acts = is_ours, False
        self._me = rospy.get_name()
        self._calls = MasterCalls()
        self._nodes = Workers("nodes", settings.MOST_CALLS)
        self._introductions = Introductions(self._me)
        self._topics: Set[str] = set()
        self._pid = 0
        self._known = NOTHING
        self._parameters: Mapping[str, Any] = {}
        self._look_at = self._keep_at = self._kept_at = 0.0
        self._former: Optional[Graph] = None  # what the former master knew, while some is missing
        self._anew_at = 0.0
        self._settled: Set[str] = set()
        self._hung: FrozenSet[str] = frozenset()  # a new one each time: readers need no lock
        self._answers = True
        threading.Thread(target=self._watch, name="master", daemon=True).start()

    def introduce(self, *topics: str) -> None:
        """See to it that subscribers of these topics hear of each new publisher."""
        self._topics = self._topics | set(topics)

    def told(self) -> MasterState:
        """Return how things are now."""
        kept = sum(map(len, self._known.parts.values()))
        age = time.monotonic() - self._kept_at
        return MasterState(self._answers, tuple(sorted(self._hung)), kept, age)

    def _watch(self) -> None:
        while not rospy.is_shutdown():
            try:
                self._look(time.monotonic())
                self._answers = True
            except (*FAILURES, ShsaError) as error:
                if self._answers and not rospy.is_shutdown():
                    rospy.logwarn("The master does not answer: %s. Healing goes on.", error)
                self._answers = False
            except Exception as error:  # whatever it is, the next look may be better
                rospy.logerr_throttle(60.0, f"Looking at the master: {error!r}")
            rospy.rostime.wallsleep(settings.MASTER_LOOK_S)

    def _look(self, now: float) -> None:
        if self._calls.pid() == self._pid and now < self._look_at:
            if now < self._introductions.deadline:
                return
        state = self._calls.state()
        registered = {node for pairs in state.parts.values() for _, node in pairs}
        anew = self._pid and (state.pid != self._pid or self._me not in registered)
        self._pid = state.pid
        self._hung = self._hung & registered
        if anew:
            self._begin_anew(now)
        waiting: Collection[str] = ()
        if self._former is not None:
            waiting = self._register_again(state, now)
            state = self._calls.state()
        self._introduce_new(state, now)
        if now >= self._keep_at:
            self._known = together(self._graph(state), self._known, waiting)
            self._keep_parameters()
            self._kept_at = now
            pause = max(settings.MASTER_PAUSE_S, _took(now))
            self._keep_at = now + min(pause, settings.LONGEST_MASTER_PAUSE_S)
        self._look_at = now + min(settings.MASTER_PAUSE_S, _took(now))
        if waiting and now < self._anew_at + settings.ANSWER_S:
            self._look_at = now

    # What is known, and what a new master is told of it.

    def _graph(self, state: State) -> Graph:
        nodes = {node for pairs in state.parts.values() for _, node in pairs}
        services = {name for name, _ in state.parts[Part.SERVICE]}
        uris = self._calls.look_up("lookupNode", nodes)
        return Graph(state.parts, uris, self._calls.look_up("lookupService", services))

    def _keep_parameters(self) -> None:
        tree = self._calls.parameters()
        if len(repr(tree)) > LARGEST_PARAMETERS:
            tree = _only(tree, rospy.resolve_name(PARAMETER))
        self._parameters = tree

    def _begin_anew(self, now: float) -> None:
        does = "It is told again what the former one knew."
        does = does if self.acts else "Healing advises, and only looks."
        rospy.logwarn_throttle(10.0, f"The master was started anew. {does}")
        if self.acts:
            values = missing_parameters(self._parameters, self._calls.parameters())
            self._calls.set_parameters(values)
            self._former, self._anew_at = self._known, now
            self._settled = set()

    def _register_again(self, state: State, now: float) -> Collection[str]:
        """Register what is missing; return the nodes that have not answered yet."""
        assert self._former is not None
        present = self._graph(state)
        asked = to_ask(self._former, present)
        waiting = {node: uri for node, uri in asked.items() if node not in self._settled}
        said = self._ask_all(waiting)
        ours = filter(self._is_ours, said)
        registrations = to_register(self._former, present, said, ours)
        if registrations:
            self._calls.register(registrations)
            nodes = len({each.node for each in registrations})
            text = "The master was told again of %d registrations of %d nodes."
            rospy.loginfo(text, len(registrations), nodes)
        left = set(waiting) - self._settled
        if now > self._anew_at + settings.HUNG_NODE_S or not left:
            self._former = None
        return left

    def _ask_all(self, nodes: Mapping[str, str]) -> Dict[str, Said]:
        """Return what nodes that answer soon say of themselves; one that has gone is settled."""
        said: Dict[str, Said] = {}
        lock, done = threading.Lock(), threading.Semaphore(0)

        def ask(node: str, uri: str) -> None:
            try:
                published = _topics(node_api(uri).getPublications(self._me))
                subscribed = _topics(node_api(uri).getSubscriptions(self._me))
                with lock:
                    said[node] = {Part.PUBLISHER: published, Part.SUBSCRIBER: subscribed}
            except ConnectionRefusedError:
                with lock:
                    self._settled.add(node)
            except FAILURES as error:
                rospy.logdebug("%s does not say what it had registered: %s", node, error)
            finally:
                done.release()

        for node, uri in nodes.items():
            self._nodes.put(partial(ask, node, uri))
        end = time.monotonic() + settings.CALL_S
        for _ in nodes:
            if not done.acquire(timeout=max(0.0, end - time.monotonic())):
                break
        with lock:
            self._settled |= set(said)
            return dict(said)

    # Publishers that the master may have told nobody of.

    def _introduce_new(self, state: State, now: float) -> None:
        pairs = [pair for pair in state.parts[Part.PUBLISHER] if pair[0] in self._topics]
        uris = self._calls.look_up("lookupNode", {node for _, node in pairs})
        found = frozenset(Publisher(t, n, uris[n]) for t, n in pairs if n in uris)
        self._introductions.heed(now, found)
        for publisher in self._introductions.due(now):
            # Our substitutes tell by themselves.
            if self.acts and not self._is_ours(publisher.node):
                self._introduce(publisher, state, found)

    def _introduce(self, new: Publisher, state: State, all_: FrozenSet[Publisher]) -> None:
        topic = new.topic
        subscribers = {node for name, node in state.parts[Part.SUBSCRIBER] if name == topic}
        uris = self._calls.look_up("lookupNode", subscribers)
        publishers = sorted(each.uri for each in all_ if each.topic == topic)

        def work() -> None:
            try:
                served = set(connected(topic, new.uri).values())
            except (*FAILURES, TypeError, LookupError):
                return  # a node that does not answer gives no connection either
            for node in subscribers - served - {new.node}:  # nobody connects to itself
                if node in uris:
                    self._nodes.put(partial(self._tell, node, uris[node], new, publishers))

        self._nodes.put(work)

    def _tell(self, node: str, uri: str, new: Publisher, publishers: List[str]) -> None:
        try:
            node_api(uri).publisherUpdate("/master", new.topic, publishers)
        except OSError as error:
            if not isinstance(error, ConnectionError) and node not in self._hung:
                self._hung = self._hung | {node}
                text = "%s does not answer, and the master waits for it. Healing tells the others."
                rospy.logwarn(text, node)
            return
        except FAILURES as error:
            rospy.logdebug("%s was not told of %s: %s", node, new.topic, error)
        self._hung = self._hung - {node}
        rospy.logdebug("%s was told that %s publishes %s.", node, new.node, new.topic)


def _took(began: float) -> float:
    """Return a pause after which what has begun then has taken a small share of the time, in s."""
    return (time.monotonic() - began) / settings.LOOKING_SHARE


def _only(tree: Mapping[str, Any], name: str) -> Mapping[str, Any]:
    """Return a tree of parameters without anything but one of them."""
    key, _, rest = name.strip("/").partition("/")
    if key not in tree:
        return {}
    inner = tree[key]
    return {key: _only(inner, rest) if rest and isinstance(inner, dict) else inner}


def _topics(answer: Any) -> Dict[str, str]:
    """Return topics and their types of a node's answer; what is none is left out."""
    code, _, rows = answer
    if code != 1 or not isinstance(rows, list):
        raise ConnectionRefusedError("no answer")
    pairs = [row for row in rows if isinstance(row, list) and len(row) == 2]
    return {name: kind for name, kind in pairs if is_name(name) and isinstance(kind, str)}
