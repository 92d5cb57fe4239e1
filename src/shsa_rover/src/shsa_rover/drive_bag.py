"""Reads a recorded drive from a rosbag."""
from typing import Dict, List, Tuple

import numpy as np
import rosbag

from shsa_core.errors import ShsaError
from shsa_rover.dataset import CURRENT, START_ROWS, TOPICS, Dataset


def read_bag(path: str) -> Dataset:
    """The drive in a rosbag, one row for each battery current once all topics have been heard.

    `truth` is filled as far as `/simulation/...` was recorded too. Raises ShsaError if a topic is
    missing.
    """
    samples: Dict[str, List[Tuple[float, float]]] = {}
    try:
        with rosbag.Bag(path) as bag:
            for topic, message, stamp in bag.read_messages():
                if topic in TOPICS:
                    found = [
                        (name, _field(message, name[len(topic) + 1 :])) for name in TOPICS[topic]
                    ]
                elif topic.startswith("/simulation/"):
                    found = [(topic, message.data)]
                else:
                    continue
                for name, value in found:
                    samples.setdefault(name, []).append((stamp.to_sec(), value))
    except (OSError, rosbag.ROSBagException) as error:
        raise ShsaError(f"{path}: cannot be read as a rosbag: {error}") from error
    missing = [topic for topic, names in TOPICS.items() if names[0] not in samples]
    if missing:
        raise ShsaError(f"{path}: has no messages of {', '.join(missing)}")
    begin = max(times[0][0] for times in samples.values())
    time = np.array([moment for moment, _ in samples[CURRENT] if moment >= begin])
    if len(time) < 2 * START_ROWS:
        raise ShsaError(
            f"{path}: the topics overlap in {len(time)} currents only; drive for longer"
        )
    columns = {name: _held(time, values) for name, values in samples.items()}
    truth = {n.rsplit("/", 1)[1]: c for n, c in columns.items() if n.startswith("/simulation/")}
    measured = {name: c for name, c in columns.items() if not name.startswith("/simulation/")}
    return Dataset(time - begin, measured, truth)


def _field(message: object, path: str) -> float:
    for name in path.split("/"):
        message = getattr(message, name)
    return float(message)  # type: ignore[arg-type]


def _held(time: np.ndarray, samples: List[Tuple[float, float]]) -> np.ndarray:
    """The last sample at each moment of `time`."""
    moments, values = np.array(samples).T
    return values[np.maximum(0, np.searchsorted(moments, time, side="right") - 1)]
