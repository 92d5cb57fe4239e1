"""Watches the master, from a thread of its own: nobody else waits for it.

A master that was started anew is told what the former one knew, within a second: what it had said
itself, and what the nodes that it said it of say still (`registrations`). Subscribers whom the
master cannot tell of a publisher are told directly (`announce`).
"""
import threading
import time
from concurrent.futures import ThreadPoolExecutor, wait
from typing import Any, Callable, Collection, Dict, Iterable, List, Mapping, Optional, Sequence
from typing import Set, Tuple

import rospy

from shsa_core.analysis import registrations
from shsa_core.analysis.registrations import Graph, Pairs, Part, Said
from shsa_core.errors import ShsaError
from shsa_core.model.names import Names
from shsa_core.ros import settings
from shsa_core.ros.master.announce import Introductions, Publisher, register_again, tell
from shsa_core.ros.master.node_api import FAILURES, master_api, topics

ONE_CALL = 500
"""Questions that are put together; with more the master would keep others waiting."""
LARGEST_PARAMETERS = 4_000_000
"""Characters; more than that is not kept. The SOM is put back by those who watch it."""
Parts = Mapping[Part, Pairs]
"""All that is registered."""


def state() -> Tuple[int, Parts]:
    """Return the process of the master, and everything that is registered. Raises as `many`."""
    us = (rospy.get_name(),)
    pid, parts = many([("getPid", us), ("getSystemState", us)])
    if not isinstance(pid, int) or not isinstance(parts, list) or len(parts) != 3:
        raise ShsaError("the master's answer is none")
    order = Part.PUBLISHER, Part.SUBSCRIBER, Part.SERVICE
    return pid, dict(zip(order, map(registrations.read_pairs, parts)))


def look_up(method: str, names: Iterable[str]) -> Mapping[str, str]:
    """Return where nodes or services are, by lookupNode or lookupService. Raises as `many`."""
    names = sorted(names)
    found = many([(method, (rospy.get_name(), name)) for name in names])
    return {name: uri for name, uri in zip(names, found) if isinstance(uri, str) and uri}


def parameters() -> Mapping[str, Any]:
    """Return the whole parameter server. Raises as `many`."""
    (tree,) = many([("getParam", (rospy.get_name(), "/"))])
    return tree if isinstance(tree, dict) else {}


def many(calls: Sequence[Tuple[str, Tuple[Any, ...]]]) -> List[Any]:
    """Return the values that calls of the master return, put together; None for a refusal.

    Raises one of node_api.FAILURES, or ShsaError if its answer is none.
    """
    values: List[Any] = []
    for start in range(0, len(calls), ONE_CALL):
        some = calls[start : start + ONE_CALL]
        asked = [{"methodName": method, "params": list(given)} for method, given in some]
        answers: Any = master_api().handle.system.multicall(asked)
        if not isinstance(answers, list) or len(answers) != len(some):
            raise ShsaError("the master's answer is none")
        values += map(_value, answers)
    return values


def _value(answer: Any) -> Any:
    if not isinstance(answer, list) or len(answer) != 1:
        return None  # a fault
    told = answer[0]
    return told[2] if isinstance(told, list) and len(told) == 3 and told[0] == 1 else None


class MasterWatch:
    """Looks at the master for as long as ROS is up.

    `seen` hears at each look all that is registered. `pid` is the process of the master, `known`
    what it knew; `former`: both at first; `keep` is told both. While `acts` is false it only looks.
    `answers`: the master does; `kept_at`: when it was asked for what it knew, in s.
    """

    def __init__(
        self,
        names: Names,
        seen: Callable[[Parts], None],
        former: Tuple[int, Graph],
        keep: Callable[[int, Graph], None],
        acts: bool,
    ) -> None:
        self._names, self._seen, self._keep, self.acts = names, seen, keep, acts
        self.pid, self.known = former
        self._me = rospy.get_name()
        self._nodes = ThreadPoolExecutor(settings.MOST_CALLS, "nodes")
        self._introductions = Introductions(self._me)
        self._topics: Set[str] = set()
        self._parameters: Mapping[str, Any] = {}
        self._restores: Mapping[str, Any] = {}  # once a node of the robot has answered
        self._look_at = self._keep_at = self.kept_at = 0.0
        self._former: Optional[Graph] = None  # what the former master knew, while some is missing
        self._anew_at = 0.0
        self._settled: Set[str] = set()
        self.answers = True
        threading.Thread(target=self._watch, name="master", daemon=True).start()

    def introduce(self, *topics: str) -> None:
        """See to it that subscribers of these topics hear of each new publisher."""
        self._topics = self._topics.union(map(rospy.resolve_name, topics))

    @property
    def hung(self) -> List[str]:
        """Return the subscribers that do not answer."""
        return sorted(self._introductions.hung)

    def _watch(self) -> None:
        while not rospy.is_shutdown():
            try:
                self._look(time.monotonic())
                self.answers = True
            except (*FAILURES, ShsaError) as error:
                if self.answers and not rospy.is_shutdown():
                    rospy.logwarn("The master does not answer: %s. Healing goes on.", error)
                self.answers = False
            except Exception as error:  # whatever it is, the next look may be better
                rospy.logerr_throttle(60.0, f"Looking at the master: {error!r}")
            rospy.rostime.wallsleep(settings.MASTER_LOOK_S)

    def _look(self, now: float) -> None:
        introductions = self._introductions
        (pid,) = many([("getPid", (self._me,))])
        if pid == self.pid and now < min(self._look_at, introductions.deadline):
            return
        pid, parts = state()
        registered = {node for pairs in parts.values() for _, node in pairs}
        anew = self.pid and (pid != self.pid or self._me not in registered)
        if anew:
            register_again()
        self.pid = pid
        introductions.hung &= registered
        if anew:
            self._begin_anew(now)
        waiting: Collection[str] = ()
        if self._former is not None:
            waiting = self._register_again(parts, now)
            _, parts = state()
        self._introduce(parts, now)
        if self._former is None:  # else a new master does not know them all yet
            self._seen(parts)
        if now >= self._keep_at:
            self.known = registrations.together(self._graph(parts), self.known, waiting)
            self._keep(pid, self.known)
            self.kept_at = now
            tree = parameters()
            self._parameters = tree if len(repr(tree)) <= LARGEST_PARAMETERS else {}
            pause = max(settings.PATIENCE_S, _took(now))
            self._keep_at = now + min(pause, 2 * settings.ANSWER_S)
        self._look_at = now + min(settings.PATIENCE_S, _took(now))
        if waiting and now < self._anew_at + settings.ANSWER_S:
            self._look_at = now

    def _introduce(self, parts: Parts, now: float) -> None:
        both = parts[Part.PUBLISHER], parts[Part.SUBSCRIBER]
        offered, heard = ([pair for pair in part if pair[0] in self._topics] for part in both)
        uris = look_up("lookupNode", {node for _, node in (*offered, *heard)})
        found = frozenset(Publisher(t, n, uris[n]) for t, n in offered if n in uris)
        self._introductions.heed(now, found)
        for new in self._introductions.due(now):
            ours = new.node.startswith(self._names.prefix)  # substitutes tell by themselves
            if self.acts and not ours:
                nodes = {n: uris[n] for topic, n in heard if topic == new.topic and n in uris}
                self._introductions.introduce(new, nodes)

    def _graph(self, parts: Parts) -> Graph:
        nodes = {node for pairs in parts.values() for _, node in pairs}
        services = {name for name, _ in parts[Part.SERVICE]}
        uris = look_up("lookupNode", nodes)
        return Graph(parts, uris, look_up("lookupService", services))

    def _begin_anew(self, now: float) -> None:
        does = "It is told again what the former one knew."
        does = does if self.acts else "Healing advises, and only looks."
        rospy.logwarn_throttle(10.0, f"The master was started anew. {does}")
        if self.acts:
            self._restores = self._restores or self._parameters
            self._former, self._anew_at = self.known, now
            self._settled = set()

    def _register_again(self, parts: Parts, now: float) -> Collection[str]:
        """Register what is missing; return the nodes that have not answered yet."""
        assert self._former is not None
        present = self._graph(parts)
        asked = registrations.to_ask(self._former, present)
        waiting = {node: uri for node, uri in asked.items() if node not in self._settled}
        said, gone = self._ask_all(waiting)
        settled = self._settled.union(said, gone)
        robot = [node for node in said if not self._names.of_healing(node, False)]
        if self._restores and robot:  # else it may be another one's
            found = registrations.missing_parameters(self._restores, parameters())
            many([("setParam", (self._me, *each)) for each in found])
            self._restores = {}
        missing = registrations.to_register(self._former, present, said)
        if missing:
            answers = many(
                [(f"register{r.part.title()}", (r.node, r.name, r.what, r.uri)) for r in missing]
            )
            new = zip(missing, answers)
            for told in registrations.to_tell(new, self._former, present, settled):
                tell(*told)
            nodes = len({each.node for each in missing})
            text = "The master was told again of %d registrations of %d nodes."
            rospy.loginfo(text, len(missing), nodes)
        self._settled = settled  # now that all was told
        left = set(waiting) - settled
        if now > self._anew_at + settings.LONGEST_PAUSE_S or not left:
            self._former, self._restores = None, {}
        return left

    def _ask_all(self, nodes: Mapping[str, str]) -> Tuple[Dict[str, Said], Set[str]]:
        """Return what nodes that answer soon say of themselves, and those that have gone."""
        asked = {self._nodes.submit(_said, uri): node for node, uri in nodes.items()}
        told: Dict[str, Said] = {}
        gone: Set[str] = set()
        for answer in wait(asked, settings.CALL_S).done:  # who answers later is asked again
            node, error = asked[answer], answer.exception()
            if error is None:
                told[node] = answer.result()
            elif isinstance(error, ConnectionRefusedError):
                gone.add(node)
            else:
                rospy.logdebug("%s does not say what it had registered: %s", node, error)
        return told, gone


def _said(uri: str) -> Said:
    """Return what a node says of itself. Raises one of FAILURES."""
    return {Part.PUBLISHER: topics(uri), Part.SUBSCRIBER: topics(uri, "getSubscriptions")}


def _took(began: float) -> float:
    """Return a pause after which what has begun then has taken a small share of the time, in s."""
    return (time.monotonic() - began) / settings.LOOKING_SHARE
