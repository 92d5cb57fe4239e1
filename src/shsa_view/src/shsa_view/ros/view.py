"""The view's ROS shell: hears healing, and serves what it heard."""
import argparse
import os
import socket
import sys
import time
from collections import deque
from typing import Deque, Iterator, Tuple

import rospkg
import rospy

from shsa_learning.incident_log import read_log
from shsa_core.errors import ShsaError
from shsa_core.files.ontology_file import load_ontology
from shsa_core.files.som_file import load_som
from shsa_core.model.names import file_name
from shsa_core.ros.incidents import log_path
from shsa_core.ros.node import run
from shsa_core.ros.trust import secret
from shsa_view.facts import Fact, IncidentTold, ModelsRead
from shsa_view.incidents import MOST
from shsa_view.ros.actions import Actions
from shsa_view.ros.answers import RosAnswers
from shsa_view.ros.commands import Commands
from shsa_view.ros.listener import Listener
from shsa_view.server import Settings, View, serve
from shsa_view.state import State

MOST_SAID = 5
LOOK_S = 2.0
"""Between two looks whether the files have changed."""


class Models:
    """The ontology and the SOM in their files, read again when these change."""

    def __init__(self, ontology: str, som: str) -> None:
        self._paths = ontology, som
        self._seen: Tuple[float, ...] = ()
        self._looked = 0.0
        self._first = self._read()

    @property
    def first(self) -> ModelsRead:
        """Read the files for the first time."""
        return self._first

    def changed(self) -> Iterator[ModelsRead]:
        """Read the models again if their files have changed."""
        if time.monotonic() < self._looked + LOOK_S:
            return
        self._looked = time.monotonic()
        seen = self._times()
        if seen and seen != self._seen:
            yield self._read()

    def _read(self) -> ModelsRead:
        """Read what is valid of them; log the rest. Raises ShsaError if they cannot be read."""
        ontology_path, som_path = self._paths
        self._seen = self._times()
        ontology, errors = load_ontology(ontology_path)
        som, more = load_som(som_path, rospy.get_namespace())
        for error in (*errors, *more):
            rospy.logwarn("Not shown: %s", error)
        return ModelsRead(ontology, som)

    def _times(self) -> Tuple[float, ...]:
        try:
            return tuple(os.stat(path).st_mtime for path in self._paths)
        except OSError:
            return ()


class ViewNode:
    """Serves the view until ROS shuts down. Raises ShsaError."""

    def __init__(self, arguments: argparse.Namespace) -> None:
        self._models = Models(arguments.ontology, arguments.som)
        logged = _logged(log_path(arguments.incident_log))
        self._waiting: Deque[Fact] = deque([self._models.first, *logged])
        token = _token() if arguments.actions else ""
        names = (socket.gethostname(), os.environ.get("ROS_HOSTNAME", ""))
        settings = Settings(arguments.address, arguments.port, token, tuple(filter(None, names)))
        self._listener = Listener(arguments.secret, self._models.first.som.hosts, make=True)
        self._commands = Commands(self._listener.put)
        state = self._state = State(rospy.get_namespace(), bool(token))
        answers = RosAnswers(state, Actions(arguments.som))
        failed = lambda text: rospy.logerr_throttle_identical(10.0, f"View: {text}")
        self._view = View(settings, state, answers, self._take, rospy.get_time, failed)

    def spin(self) -> None:
        """Serve until ROS shuts down."""
        serve(self._view, rospy.is_shutdown, self._ready)

    def _take(self) -> Iterator[Fact]:
        while self._waiting:
            yield self._waiting.popleft()
        try:
            yield from self._models.changed()
        except ShsaError as error:
            rospy.logwarn(
                "The files have changed, and the view goes on with the old ones: %s", error
            )
        self._commands.look(service.node for service in self._state.som)
        yield from self._listener.take()

    def _ready(self, port: int) -> None:
        settings = self._view.settings
        address = f"http://{_in_url(settings.address)}:{port}/"
        # Printed, not logged: whoever is on the ROS master can read the log, and so the token.
        if settings.token and sys.stdout.isatty():
            print(f"The view is at {address}#token={settings.token}", flush=True)
        elif settings.token:
            print(f"The view is at {address}#token=TOKEN; see {_token_file()}", flush=True)
        else:
            print(f"The view is at {address}", flush=True)


def _logged(path: str) -> Iterator[Fact]:
    """Yield the incidents of the log, as far as they are shown."""
    if not os.path.exists(path):
        return
    try:
        log = read_log(path)
    except ShsaError as error:
        rospy.logwarn("The incident log is not shown: %s", error)
        return
    for note in log.notes[:MOST_SAID]:
        rospy.logwarn("Not shown: %s", note)
    for incident in log.incidents[-MOST:]:
        yield IncidentTold(incident, logged=True)


def _in_url(address: str) -> str:
    """Return an address as a browser takes it; that of all networks is none of them."""
    if address in ("", "0.0.0.0", "::"):
        return socket.gethostname()
    return f"[{address}]" if ":" in address else address


def _token() -> str:
    """Return the token, kept in a file that only our user can read. Raises ShsaError."""
    return secret.obtain(_token_file()).hex()


def _token_file() -> str:
    name = file_name("view_token", rospy.get_namespace())
    return os.path.join(rospkg.get_ros_home(), "shsa", name)


def main() -> None:
    """Run the node `view`."""
    parser = argparse.ArgumentParser(prog="view", description=__doc__.splitlines()[0])
    parser.add_argument("--ontology", required=True, help="the ontology file")
    parser.add_argument("--som", required=True, help="the service-to-ontology mapping file")
    parser.add_argument("--address", default="127.0.0.1", help="where the page is served")
    parser.add_argument("--port", type=int, default=8080, help="its TCP port; 0: any free one")
    parser.add_argument("--actions", action="store_true", help="let who has the token act")
    parser.add_argument("--incident-log", default="", help="the incident log of healing")
    parser.add_argument("--secret", default="", help="the file with the secret of healing")
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    run("view", lambda: ViewNode(arguments).spin())
