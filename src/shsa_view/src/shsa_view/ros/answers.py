"""Answers that are found in threads: the drawing, what would be, and actions."""
import threading
import time
from typing import Any, Callable, Dict, List, Mapping, Tuple

import rospy
from shsa_msgs import srv

from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_core.ros.wire import names
from shsa_core.text import shown
from shsa_view import graph, what_if
from shsa_view.plain import code, number
from shsa_view.ros.actions import Actions
from shsa_view.state import State

KEPT_S = 2.0
"""An answer of healing counts for so long: it is asked no more often than people can look."""
MOST_KEPT = 100

Document = Dict[str, Any]


class RosAnswers:
    """Answers by the models of the state, and by the reconfigurator. From any thread."""

    def __init__(self, state: State, actions: Actions) -> None:
        self._state, self._actions = state, actions
        self._find = rospy.ServiceProxy(names.FIND_SUBSTITUTE, srv.FindSubstitute)
        self._lock = threading.Lock()  # healing is asked one question after the other
        self._kept: Dict[Tuple[str, str], Tuple[float, Document]] = {}
        self._drawn: Tuple[Tuple[Ontology, Som], Document] = ((state.ontology, state.som), {})

    def graph(self) -> Document:
        """Return the drawing of the ontology; made anew when that was read again."""
        with self._lock:
            models = self._state.ontology, self._state.som
            drawn_of, document = self._drawn
            if not document or any(ours is not was for ours, was in zip(models, drawn_of)):
                document = graph.drawing(*models)
                self._drawn = models, document
            return document

    def what_if(self, service: str, node: str) -> Document:
        """Return what healing would do without a service or a node. Raises ShsaError."""
        with self._lock:
            before, kept = self._kept.get((service, node), (0.0, {}))
            if kept and time.monotonic() < before + KEPT_S:
                return kept
            found = self._answered(service, node)
            if len(self._kept) >= MOST_KEPT:
                self._kept.clear()
            self._kept[service, node] = time.monotonic(), found
            return found

    def act(self, action: str, body: Mapping[str, Any], who: str) -> Document:
        """Do it. Raises ShsaError."""
        return self._actions.act(action, body, who, self._state.som)

    def _answered(self, service: str, node: str) -> Document:
        ontology, som = self._state.ontology, self._state.som
        lost = what_if.concerned(som, service, node)
        answers: List[Document] = [self._asked(each) for each in lost]
        question = f"What if {lost[0].name if service else node} failed?"
        return what_if.answer(question, answers, what_if.cut_sets(ontology, som, lost[0].node))

    def _asked(self, service: Service) -> Document:
        """Ask healing about a service without its node."""
        response = _called(lambda: self._find(topic=service.name, without=[service.node]))
        return {
            "service": service.name,
            "found": bool(response.found),
            "inputs": list(map(shown, response.inputs)),
            "relations": list(map(shown, response.relations)),
            "outputs": list(map(shown, response.outputs)),
            "code": code(response.code),
            "quality": number(response.quality) if response.found else None,
            "error_rms": [number(each) for each in response.error_rms],
            "error_p95": [number(each) for each in response.error_p95],
            "missing": list(map(shown, response.missing)),
            "detail": shown(response.detail),
        }


def _called(call: Callable[[], Any]) -> Any:
    """Return the answer of the reconfigurator. Raises ShsaError if it gives none."""
    try:
        return call()
    except (rospy.ServiceException, rospy.ROSException) as error:
        raise ShsaError(f"the reconfigurator does not answer: {error}") from error
