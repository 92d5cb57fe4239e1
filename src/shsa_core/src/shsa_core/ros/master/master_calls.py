"""Asks the master many questions in one call, with a timeout; nothing is decided here."""
from typing import Any, Iterable, List, Mapping, NamedTuple, Sequence, Tuple

import rosgraph
import rospy

from shsa_core.errors import ShsaError
from shsa_core.ros.master.node_api import MASTER, node_api
from shsa_core.ros.master.registrations import Pairs, Part, Registration, read_pairs

REGISTER = {
    Part.PUBLISHER: "registerPublisher",
    Part.SUBSCRIBER: "registerSubscriber",
    Part.SERVICE: "registerService",
}
ONE_CALL = 500
"""Questions that are put together; with more the master would keep others waiting."""


class State(NamedTuple):
    """All that is registered, and the process of the master that says so."""

    pid: int
    parts: Mapping[Part, Pairs]


class MasterCalls:
    """Asks the master; raises one of node_api.FAILURES, or ShsaError if its answer is none."""

    def __init__(self) -> None:
        self._master = node_api(rosgraph.get_master_uri(), MASTER)
        self._me = rospy.get_name()

    def state(self) -> State:
        """Return everything that is registered."""
        pid, parts = self._many([("getPid", (self._me,)), ("getSystemState", (self._me,))])
        if not isinstance(pid, int) or not isinstance(parts, list) or len(parts) != 3:
            raise ShsaError("the master's answer is none")
        order = Part.PUBLISHER, Part.SUBSCRIBER, Part.SERVICE
        return State(pid, dict(zip(order, map(read_pairs, parts))))

    def pid(self) -> int:
        """Return the process of the master."""
        (pid,) = self._many([("getPid", (self._me,))])
        return pid if isinstance(pid, int) else 0

    def look_up(self, method: str, names: Iterable[str]) -> Mapping[str, str]:
        """Return where nodes or services are, by lookupNode or lookupService."""
        names = sorted(names)
        found = self._many([(method, (self._me, name)) for name in names])
        return {name: uri for name, uri in zip(names, found) if isinstance(uri, str) and uri}

    def parameters(self) -> Mapping[str, Any]:
        """Return the whole parameter server."""
        (tree,) = self._many([("getParam", (self._me, "/"))])
        return tree if isinstance(tree, dict) else {}

    def set_parameters(self, values: Iterable[Tuple[str, Any]]) -> None:
        """Set parameters by their full names."""
        self._many([("setParam", (self._me, name, value)) for name, value in values])

    def register(self, registrations: Iterable[Registration]) -> None:
        """Register these on behalf of their nodes, in this order."""
        calls = [(REGISTER[r.part], (r.node, r.name, r.what, r.uri)) for r in registrations]
        self._many(calls)

    def _many(self, calls: Sequence[Tuple[str, Tuple[Any, ...]]]) -> List[Any]:
        """Return the values that calls return, None for a refusal."""
        values: List[Any] = []
        for start in range(0, len(calls), ONE_CALL):
            some = calls[start : start + ONE_CALL]
            asked = [{"methodName": method, "params": list(given)} for method, given in some]
            answers: Any = self._master.system.multicall(asked)
            if not isinstance(answers, list) or len(answers) != len(some):
                raise ShsaError("the master's answer is none")
            values += map(_value, answers)
        return values


def _value(answer: Any) -> Any:
    if not isinstance(answer, list) or len(answer) != 1:
        return None  # a fault
    told = answer[0]
    return told[2] if isinstance(told, list) and len(told) == 3 and told[0] == 1 else None
