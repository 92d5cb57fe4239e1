"""Looks at a running robot, its master and its computers, for `shsa doctor`. Changes nothing."""
import os
import socket
import time
from contextlib import suppress
from typing import Dict, Iterator, List, Mapping, Sequence, Tuple
from urllib.parse import urlparse

import psutil
import rosgraph
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

from shsa_core.errors import ModelError, ShsaError
from shsa_core.files.document import from_parameters
from shsa_core.files.som_file import PARAMETER, read_som, read_tree
from shsa_core.analysis.duties import duties_of
from shsa_core.healing.incident import Incident
from shsa_core.model.names import HEALERS, Names, full_name
from shsa_core.model.som import Som
from shsa_core.ros.incidents import log_path
from shsa_core.ros.master.node_api import FAILURES, master_api, pid
from shsa_core.analysis.registrations import read_pairs
from shsa_core.ros.master.som_parameter import get_som_parameter
from shsa_core.analysis.check import mark_unusable
from shsa_core.ros.processes import kernel
from shsa_core.ros.trust import owners, secret
from shsa_learning.doctor import Seen
from shsa_learning.incident_log import read_log

LISTENING_S = 2.5
"""Healing tells of itself on /diagnostics once a second."""
HOUR_S = 3600.0

Nodes = Mapping[str, Sequence[str]]


def examine(som_file: str, secret_file: str, log: str) -> Seen:
    """Look at the robot. Raises ShsaError if no master answers, or nobody knows its services."""
    try:
        listed = master_api("/shsa_doctor").getSystemState()
    except FAILURES as error:
        text = f"no ROS master answers at {rosgraph.get_master_uri()}: {error}"
        raise ShsaError(text) from error
    rospy.init_node("shsa_doctor", anonymous=True, disable_signals=True, disable_rostime=True)
    namespace = rospy.get_namespace()
    som = read_som(som_file, namespace) if som_file else _running(namespace)
    healer = full_name(HEALERS[1], namespace)
    warnings = _warnings()
    incidents, why = _recent(log)
    users = dict(_users([healer, *dict.fromkeys(each.node for each in som)]))
    return Seen(
        som,
        namespace,
        dict(listed[0]),
        dict(listed[1]),
        _secret(secret_file),
        _masters(),
        {node: user for node, user in users.items() if node != healer},
        users.get(healer, ""),
        bool(rospy.get_param("/use_sim_time", False)),
        [text for text in warnings if text.startswith("computer ")],
        [text for text in warnings if text.endswith(" are usual")],
        incidents,
        [problem.text for problem in mark_unusable(som)[1]],
        duties_of(som, Names(namespace), *map(read_pairs, listed)),
        why,
    )


def _running(namespace: str) -> Som:
    value = get_som_parameter()
    if not value:
        text = "healing does not run here: start shsa.launch, or name the file with --som"
        raise ShsaError(text)
    som, _ = read_tree(from_parameters(value, PARAMETER), namespace)
    return som


def _secret(path: str) -> str:
    """Return why the secret cannot be used; empty: it can."""
    try:
        secret.read(path or secret.default_path())
    except ShsaError as error:
        return str(error)
    return ""


def _masters() -> Dict[str, List[str]]:
    """Map each spelling of our master to the programs on this computer that use it.

    roslaunch writes the name of this computer where others say localhost: that is one spelling.
    """
    found: Dict[str, Dict[str, None]] = {}
    own = ("localhost", "127.0.0.1", socket.gethostname())
    for each in kernel.robot_processes():
        uri = urlparse(each.variables.get("ROS_MASTER_URI", ""))
        host = "localhost" if uri.hostname in own else uri.hostname
        program = " ".join(word.rsplit("/", 1)[-1] for word in each.words[:2])
        found.setdefault(f"{host}:{uri.port}", {})[program] = None
    return {spelling: list(programs) for spelling, programs in found.items()}


def _users(nodes: Sequence[str]) -> Iterator[Tuple[str, str]]:
    """Yield each node whose process is on this computer, and its user."""
    for node in nodes:
        with suppress(*FAILURES, psutil.Error):
            uri = master_api().lookupNode(node)
            if owners.is_local(uri):
                yield node, kernel.user(psutil.Process(pid(uri)))


def _warnings() -> List[str]:
    """Return what healing warns of on /diagnostics."""
    told: Dict[str, str] = {}

    def heard(message: DiagnosticArray) -> None:
        for status in message.status:
            _, _, name = status.name.partition(": ")
            if status.level != DiagnosticStatus.OK:
                told[name] = f"{name}: {status.message}"

    subscriber = rospy.Subscriber("/diagnostics", DiagnosticArray, heard)
    time.sleep(LISTENING_S)
    subscriber.unregister()
    return sorted(told.values())


def _recent(log: str) -> Tuple[List[Incident], str]:
    """Return the incidents of the last hour, and why their log cannot be read; empty: it can.

    Without a log there is no incident yet, unless it was named.
    """
    path = log or log_path("")
    if not (log or os.path.lexists(path)):
        return [], ""
    try:
        known = read_log(path).incidents
    except ModelError as error:
        return [], str(error)
    return [each for each in known if each.detected > time.time() - HOUR_S], ""
