"""Reads the demonstration's rosbag and incident log into plain series."""
import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Tuple

import rosbag

Series = List[Tuple[float, float]]  # (s since the start, value)
CURRENT = "/battery_current"
ESTIMATE = "/battery_state"
TRUTH_CURRENT = "/simulation/battery_current"
TRUTH_SOC = "/simulation/state_of_charge"


@dataclass
class Recording:
    """The files of a run as series; times in s since its first battery current.

    `current` by publishing node (A), `true_current` (A), `soc` and `true_soc` (0 to 1),
    `incidents` as in the incident log, their moments made relative.
    """

    current: Dict[str, Series] = field(default_factory=dict)
    true_current: Series = field(default_factory=list)
    soc: Series = field(default_factory=list)
    true_soc: Series = field(default_factory=list)
    incidents: List[Dict[str, object]] = field(default_factory=list)


def read_recording(bag_file: Path, incident_log: Path) -> Recording:
    """Read one run; times are those at which the messages were recorded."""
    recording = Recording()
    start = None
    with rosbag.Bag(str(bag_file)) as bag:
        for item in bag.read_messages(return_connection_header=True):
            time = item.timestamp.to_sec()
            if start is None:
                if item.topic != CURRENT:
                    continue
                start = time
            moment = time - start
            if item.topic == CURRENT:
                node = item.connection_header["callerid"]
                node = node.decode() if isinstance(node, bytes) else node
                recording.current.setdefault(node, []).append((moment, item.message.data))
            elif item.topic == TRUTH_CURRENT:
                recording.true_current.append((moment, item.message.data))
            elif item.topic == ESTIMATE:
                recording.soc.append((moment, item.message.percentage))
            elif item.topic == TRUTH_SOC:
                recording.true_soc.append((moment, item.message.data))
    if incident_log.exists():
        for line in incident_log.read_text(encoding="utf-8").splitlines():
            recording.incidents.append(_relative(json.loads(line), start or 0.0))
    return recording


def _relative(incident: Dict[str, object], start: float) -> Dict[str, object]:
    moments = ("last_good", "detected", "killed", "found", "spawned")
    for name in moments + ("first_message", "returned", "ended"):
        value = incident.get(name)
        if isinstance(value, float):
            incident[name] = value - start
    return incident
