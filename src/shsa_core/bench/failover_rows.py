"""The rows of failover.py: what fails, how, and what helps against it."""
from typing import Mapping, NamedTuple, Tuple

from faults import FAULTS, SILENT, WRONG
from robot import RAW_TOPIC
from shsa_core.files.keys import SERVICE

HOT, WARM, COLD = "hot", "warm", "cold"
BY_HAND = "rosrun by hand, rospy"
ROSMON = "rosmon, rospy"
RESPAWNED = {
    "respawn, rospy": "faulty_publisher",
    "respawn, roscpp": "bench_talker",
    ROSMON: "faulty_publisher",
}
UNANSWERED = 5
"""Failures that nobody answers are waited for as often at most."""
NO_BRIDGE: Mapping[str, object] = {"bridge": False}
BEHIND_GATE: Mapping[str, object] = {"gate": RAW_TOPIC}
KNOWN = {*SERVICE}
"""Keys of a service in this version: rows that need others are left out."""


class Row(NamedTuple):
    """A row; `period` in s, `som`: what the SOM says of the topic besides."""

    help: str = HOT
    fault: str = "kill -9"
    period: float = 0.02
    applications: int = 0
    som: Mapping[str, object] = {}

    @property
    def contender(self) -> str:
        """The remedy, in words."""
        said = (f"behind a {key}" if to else f"no {key}" for key, to in self.som.items())
        return ", ".join((self.help, *said))

    @property
    def circumstances(self) -> str:
        """The difference to the other rows; empty: none."""
        rate = f"{1.0 / self.period:.0f} Hz" if self.period != Row().period else ""
        others = f"{self.applications} other nodes" if self.applications else ""
        return ", ".join(filter(None, (rate, others)))

    @property
    def name(self) -> str:
        """The name; nothing is said of a `kill -9`."""
        fault = "" if self.fault == Row().fault else self.fault
        return ", ".join(filter(None, (self.contender, fault, self.circumstances)))

    @property
    def title(self) -> str:
        """The name in the documentation."""
        if self.help == BY_HAND:
            return BY_HAND.replace("rosrun", "`rosrun`")
        fault = f"`{self.fault}`" if self.fault in ("kill -9", "rosnode kill") else self.fault
        help = self.contender.replace("respawn", '`respawn="true"`')
        return ", ".join(filter(None, (help, fault, self.circumstances)))

    @property
    def is_healed(self) -> bool:
        """True if healing is the remedy."""
        return self.help in (HOT, WARM, COLD)

    @property
    def is_answered(self) -> bool:
        """True if the remedy can see that the node fails."""
        return self.is_healed or self.help == BY_HAND or FAULTS[self.fault].ends

    @property
    def unknown(self) -> Tuple[str, ...]:
        """The keys of its SOM that this version does not know."""
        return tuple(key for key in self.som if key not in KNOWN)


def of_fault(fault: str) -> Tuple[Row, ...]:
    """A fault that ends in silence: bridged, unbridged, behind a gate, and what ROS alone does."""
    rows = (Row(HOT, fault), *(Row(HOT, fault, som=som) for som in (NO_BRIDGE, BEHIND_GATE)))
    # A roscpp talker takes no commands.
    by_process = fault in ("kill -9", "rosnode kill", "SIGSTOP")
    helps = tuple(RESPAWNED)[: 2 if by_process else 1]
    return (*rows, *(Row(help, fault) for help in helps))


def of_values(fault: str) -> Tuple[Row, ...]:
    """Return a fault of values."""
    return Row(HOT, fault), Row(HOT, fault, som=BEHIND_GATE), Row("respawn, rospy", fault)


CRASHES = (
    Row(HOT, period=0.01),
    *(Row(HOT, applications=count) for count in (100, 500)),
    Row(WARM),
    Row(COLD),
    Row(BY_HAND),
)
"""`kill -9` with everything else that is compared."""
ROWS = (
    *of_fault("kill -9")[:3],
    *CRASHES,
    *of_fault("kill -9")[3:],
    Row(ROSMON),
    *(row for fault in SILENT[1:] for row in of_fault(fault)),
    *(row for fault in WRONG for row in of_values(fault)),
)
"""All rows, in the order of table and picture: sorted by fault."""
BY_NAME: Mapping[str, Row] = {row.name: row for row in ROWS}
SHORT = ("hot", "respawn, rospy, slow", BY_HAND)
"""The rows of the short form."""
