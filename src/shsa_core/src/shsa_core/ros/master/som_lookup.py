"""Looks up what a substitute that was started by hand must know of a path.

Such a path is `/odom/twist/twist/linear/x`.
"""
import dataclasses
from typing import Dict, Optional, Sequence, Tuple

import rospy

from shsa_core.errors import ShsaError
from shsa_core.files.document import from_parameters
from shsa_core.files.som_file import PARAMETER, read_tree
from shsa_core.model.field import parse_field
from shsa_core.model.service import Deadlines, Signal
from shsa_core.model.som import Som
from shsa_core.ros.master.node_api import FAILURES, master_api

UNKNOWN_PERIOD_S = 0.1  # of a topic that the SOM does not have
UNKNOWN_DEADLINE_S = 0.5


def look_up(paths: Sequence[str]) -> Tuple[Signal, ...]:
    """The signals at `paths`, by the SOM on the parameter server, else by the master.

    Raises ShsaError if neither has one of them, or the master does not answer. No type is loaded.
    """
    try:
        known = _som_signals()
        types: Dict[str, str] = {}
        if not all(path in known for path in paths):
            types = dict(master_api().getTopicTypes())
    except FAILURES as error:
        raise ShsaError(f"the master does not answer: {error}") from error
    return tuple(known[path] if path in known else _unmapped(path, types) for path in paths)


def _som_signals() -> Dict[str, Signal]:
    """Every value of the SOM by its path; whose message it is does not matter."""
    value: Optional[object] = rospy.get_param(PARAMETER, None)
    if value is None:
        return {}
    try:
        # What is not valid is named by those who watch the SOM; here the valid part will do.
        som, _ = read_tree(from_parameters(value, PARAMETER), rospy.get_namespace())
    except ShsaError:
        som = Som()
    signals = (
        som.signal(source, Deadlines(), written)
        for source in som.sources
        for written in (False, True)
    )
    return {signal.path: dataclasses.replace(signal, node="") for signal in signals}


def _unmapped(path: str, types: Dict[str, str]) -> Signal:
    topics = [topic for topic in types if path.startswith(topic + "/")]
    if not topics:
        raise ShsaError(f"{path}: neither in the SOM nor on a topic that the master knows")
    topic = max(topics, key=len)
    field = str(parse_field(path[len(topic) + 1 :], "/"))
    return Signal(topic, field, types[topic], "", UNKNOWN_PERIOD_S, UNKNOWN_DEADLINE_S)
