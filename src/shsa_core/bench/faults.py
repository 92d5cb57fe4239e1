"""The faults of failover.py: what each does to a node that obeys `faulty_publisher`'s commands."""
import os
import signal
from functools import partial
from typing import Callable, Dict, NamedTuple, Optional

from graph import shut_down
from shsa_testing.faulty_publisher import FaultHandle

SLOWED = 3
"""A third of the rate is left."""
SILENCES = "3 10"
"""Periods: an intermittent node is silent for so many, again and again."""


class Patient(NamedTuple):
    """A node that is about to fail; `period` in s. Only rospy ones obey `commands`."""

    node: str
    pid: int
    period: float
    commands: FaultHandle


Cause = Callable[[Patient], object]


def kill_hard(patient: Patient) -> None:
    """`kill -9`."""
    os.kill(patient.pid, signal.SIGKILL)


def stop(patient: Patient) -> None:
    """Hang."""
    os.kill(patient.pid, signal.SIGSTOP)


def leave(patient: Patient) -> None:
    """`rosnode kill`."""
    shut_down(patient.node)


def commanded(command: str) -> Cause:
    """Go on, but badly."""
    return lambda patient: patient.commands.fault(command)


def slow(patient: Patient, times: float = SLOWED) -> None:
    """Publish seldom."""
    patient.commands.fault(f"period {times * patient.period}")


class Fault(NamedTuple):
    """A fault of a node.

    `ends`: its process does, and nothing else moves `respawn="true"`. `eased`: ends a fault in
    which good messages come and go, as healing lets such a node live; None: none comes.
    """

    cause: Cause
    ends: bool = False
    eased: Optional[Cause] = None


FAULTS: Dict[str, Fault] = {
    "kill -9": Fault(kill_hard, ends=True),
    "rosnode kill": Fault(leave, ends=True),
    "SIGSTOP": Fault(stop),
    "slow": Fault(slow, eased=partial(slow, times=1)),
    "intermittent": Fault(
        commanded(f"intermittent {SILENCES}"), eased=commanded("intermittent 0 0")
    ),
    "out of range": Fault(commanded("value 1000")),
    "not a number": Fault(commanded("nan 1")),
}
SILENT, WRONG = tuple(FAULTS)[:5], tuple(FAULTS)[5:]
"""Those that end in silence, and those of values."""
