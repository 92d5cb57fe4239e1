"""The words for faults, after the injection vocabulary of PX4, and where each fault is made."""
from dataclasses import dataclass
from typing import Dict, Tuple

from shsa_core.model.kinds import Word


class Place(Word):
    """The place at which a fault is made."""

    PROCESS = "process"
    MESSAGES = "messages"
    LINE = "serial line"
    GRAPH = "graph"
    MASTER = "master"


@dataclass(frozen=True)
class FaultWord:
    """One fault: where it is made, and what it does, in words.

    `stamp`: only where messages have a std_msgs/Header; `innocent`: the topic's node does nothing
    wrong.
    """

    word: str
    place: Place
    tells: str
    stamp: bool = False
    innocent: bool = False


_ALL: Tuple[FaultWord, ...] = (
    FaultWord("off", Place.PROCESS, "the node is asked to shut down, as rosnode kill does"),
    FaultWord("crash", Place.PROCESS, "the node's process is killed (SIGKILL)"),
    FaultWord(
        "hang", Place.PROCESS, "the node's process is stopped (SIGSTOP), and wakes at the end"
    ),
    FaultWord("stuck", Place.MESSAGES, "the values do not change any more; stamps go on"),
    FaultWord("garbage", Place.MESSAGES, "random numbers of any size instead of the values"),
    FaultWord("wrong", Place.MESSAGES, "the values are off by the same amount, within their range"),
    FaultWord("slow", Place.MESSAGES, "one message in 2, 3 or 4 is published"),
    FaultWord("delayed", Place.MESSAGES, "each message comes late, by 0.5 to 2 s"),
    FaultWord(
        "intermittent", Place.MESSAGES, "messages are missing for 0.1 to 1 s, again and again"
    ),
    FaultWord("fast", Place.MESSAGES, "2 to 5 messages instead of one, spread over the period"),
    FaultWord("nan", Place.MESSAGES, "NaN in every message, in every second or in one of ten"),
    FaultWord("inf", Place.MESSAGES, "infinity in every message, in every second or in one of ten"),
    FaultWord("old_stamp", Place.MESSAGES, "the stamps are 1 to 10 s too old", stamp=True),
    FaultWord("future_stamp", Place.MESSAGES, "the stamps are 1 to 10 s ahead", stamp=True),
    FaultWord("wrong_frame", Place.MESSAGES, "the header names another frame, or none", stamp=True),
    FaultWord("short_array", Place.MESSAGES, "arrays lose half of their elements, or all"),
    FaultWord("duplicate", Place.MESSAGES, "each message is published 2 to 4 times"),
    FaultWord("serial_noise", Place.LINE, "bits flip and bytes are lost on the serial line"),
    FaultWord("serial_silence", Place.LINE, "the serial line is open, and nothing comes"),
    FaultWord("serial_unplug", Place.LINE, "the serial port is gone"),
    FaultWord("spoof", Place.GRAPH, "a stranger publishes garbage beside the node", innocent=True),
    FaultWord(
        "spoof_name",
        Place.GRAPH,
        "a stranger publishes garbage beside the node, and claims its name",
        innocent=True,
    ),
    FaultWord(
        "hung_subscriber", Place.GRAPH, "a subscriber of the topic is stopped", innocent=True
    ),
    FaultWord(
        "master_restart", Place.MASTER, "the master is killed, and started again", innocent=True
    ),
)

FAULTS: Dict[str, FaultWord] = {each.word: each for each in _ALL}
"""Every fault by its word, in the order in which they are shown."""

TOPIC_FAULTS: Tuple[str, ...] = tuple(
    word for word, each in FAULTS.items() if each.place is not Place.MASTER
)
"""Those that are made of one topic."""
