"""Watches a running robot: the document of the view, without a view that runs."""
import time
from typing import Any, Dict, Optional

import rosgraph
import rospy

from shsa_core.files.document import from_parameters
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import PARAMETER, read_som, read_tree
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.ros.master.node_api import FAILURES, master_api
from shsa_core.ros.master.som_parameter import get_som_parameter
from shsa_view.facts import ModelsRead
from shsa_view.judgement import Condition
from shsa_view.ros.listener import Listener
from shsa_view.state import ALIVE, State
from shsa_view.terminal import AnotherMaster

NAME = "shsa_top"
WAIT_S = 4.0
"""So long one look waits for what healing tells once a second."""
POLL_S = 0.05
SECOND_S = 1.0
MODELS_S = 3.0
"""Between two looks for the SOM on the parameter server, while it is not there."""

Document = Dict[str, Any]


def master_uri() -> str:
    """Return the URI of the ROS master."""
    return str(rosgraph.get_master_uri())


def master_answers() -> bool:
    """Return whether the master answers."""
    return master_pid() is not None


def master_pid() -> Optional[int]:
    """Return the process of the master; None if none answers."""
    try:
        return int(master_api().getPid())
    except (*FAILURES, TypeError, ValueError):
        return None


class Watch:
    """A robot that is watched, and its master.

    `ontology`, `som`, `secret`: files; empty: what lies on the parameter server, and the usual
    secret.
    """

    def __init__(self, ontology: str, som: str, secret: str) -> None:
        # Read at once: what is wrong with a file is said before the screen is taken.
        self._ontology = read_ontology(ontology) if ontology else Ontology({}, {}, ())
        self._som_file, self._secret = som, secret
        if som:
            read_som(som)
        self._state = State(rosgraph.names.get_ros_namespace())
        self._listener: Optional[Listener] = None
        self._master: Optional[int] = None
        self._known = False
        self._next = self._models_due = 0.0

    @property
    def connected(self) -> bool:
        """True once it has had a master."""
        return self._listener is not None

    def look(self) -> str:
        """Look for the master; what is to be said of it, if it is not there. Once a second will do.

        Raises AnotherMaster where another one has taken its place.
        """
        pid = master_pid()
        if pid is None:
            return f"No ROS master answers at {master_uri()}; it is awaited."
        if self._listener is None:
            self._master = pid
            self._connect()
        elif pid != self._master:
            raise AnotherMaster()
        return ""

    def document(self) -> Document:
        """Return the state of the robot as a document."""
        if self._listener is not None:
            self._read_models()
            for fact in self._listener.take():
                self._state.handle(fact)
        now = time.monotonic()
        if now >= self._next:
            self._next = now + SECOND_S
            self._state.second(rospy.get_time() if self.connected else time.time())
        return self._state.document(rospy.get_time() if self.connected else time.time())

    def _connect(self) -> None:
        rospy.init_node(
            NAME,
            anonymous=True,
            disable_signals=True,
            disable_rosout=True,
            log_level=rospy.FATAL,  # the screen is ours
        )
        som = read_som(self._som_file, rospy.get_namespace()) if self._som_file else Som()
        self._listener = Listener(self._secret, som.hosts)
        if self._som_file:
            self._heed(som)

    def _read_models(self) -> None:
        """Read the SOM from the parameter server once it is there."""
        if self._known or time.monotonic() < self._models_due:
            return
        self._models_due = time.monotonic() + MODELS_S
        value = get_som_parameter()
        if value:
            # What is not valid is named by the monitor; here the valid part will do.
            som, _ = read_tree(from_parameters(value, PARAMETER), rospy.get_namespace())
            self._heed(som)

    def _heed(self, som: Som) -> None:
        self._known = True
        self._state.handle(ModelsRead(self._ontology, som))


def once(ontology: str, som: str, secret: str) -> Document:
    """One look: when all that runs has told of itself, or after a while."""
    watch = Watch(ontology, som, secret)
    watch.look()
    deadline = time.monotonic() + WAIT_S
    while True:
        document = watch.document()
        if _is_whole(document) or time.monotonic() > deadline:
            rospy.signal_shutdown("that was all")
            return document
        time.sleep(POLL_S)


def _is_whole(document: Document) -> bool:
    healing = document["healing"]
    rows = document["services"].values()
    alive = all(healing[who] == ALIVE for who in ("monitor", "reconfigurator"))
    told = bool(rows) and all(row["state"] != Condition.UNKNOWN.value for row in rows)
    return alive and told and all(row["rate"] is not None for row in rows if row["publisher"])
