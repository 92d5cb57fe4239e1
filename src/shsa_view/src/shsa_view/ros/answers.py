"""What is asked of the view in threads: the drawing, what would be, and actions."""
from typing import Any, Dict, Mapping

from shsa_view.errors import Refused
from shsa_view.state import State

Document = Dict[str, Any]


class RosAnswers:
    """Answers by the models of the state, and by the reconfigurator."""

    def __init__(self, state: State) -> None:
        self._state = state

    def graph(self) -> Document:
        """The drawing of the ontology."""
        return {"svg": "", "edges": [], "error": "not drawn yet"}

    def what_if(self, service: str, node: str) -> Document:
        """What healing would do without a service or a node."""
        raise Refused("not answered yet", 503)

    def act(self, action: str, body: Mapping[str, Any], who: str) -> Document:
        """Do it."""
        raise Refused("not done yet", 503)
