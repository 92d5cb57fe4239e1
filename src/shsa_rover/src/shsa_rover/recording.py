"""Reads the demonstration's rosbag and incident log into plain series."""
import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Dict, List, Tuple

import rosbag

from shsa_rover.battery import BatteryParameters

Series = List[Tuple[float, float]]  # (s since the start, value)
CURRENT = "/battery_current"
ESTIMATE = "/battery_state"
TRUTH_CURRENT = "/simulation/battery_current"
TRUTH_SOC = "/simulation/state_of_charge"
LONGEST_HOLD_S = 2.0  # for which the estimator holds the last current over a gap


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


def unhealed(recording: Recording, node: str) -> Series:
    """Return the state of charge that the estimator would have told by one node's currents alone.

    It is the estimator's own until the node falls silent for long.
    """
    currents = recording.current.get(node, [])
    pairs = list(zip(currents, currents[1:]))
    lost = next((a for (a, _), (b, _) in pairs if b - a > LONGEST_HOLD_S), None)
    last = max(
        (point for point in recording.soc if lost is not None and point[0] <= lost), default=None
    )
    if lost is None or last is None:
        return recording.soc
    told, charge = [point for point in recording.soc if point <= last], last[1]
    for (time, current), (next_, _) in pairs:
        if time >= last[0]:
            held = min(next_ - time, LONGEST_HOLD_S)
            used = current * held / 3600.0 / BatteryParameters().capacity
            told += [(time + held, charge - used), (next_, charge - used)]
            charge -= used
    return told


def last_error(series: Series, truth: Series) -> float:
    """Return how far the end of a series is from the truth at that time; nan: nothing is known."""
    if not series or not truth:
        return math.nan
    time, value = series[-1]
    return value - min(truth, key=lambda point: abs(point[0] - time))[1]


def _relative(incident: Dict[str, object], start: float) -> Dict[str, object]:
    moments = ("last_good", "detected", "killed", "found", "spawned")
    for name in moments + ("first_message", "returned", "ended"):
        value = incident.get(name)
        if isinstance(value, float):
            incident[name] = value - start
    return incident
