"""Starts a substitute from its command line: three strings, or none for an idle one."""
import os
import sys
from typing import Optional, Tuple

import rospy

from shsa_core.errors import ShsaError
from shsa_core.model.substitution import Substitution
from shsa_core.ros.node import run
from shsa_core.ros.processes import priority
from shsa_core.ros.substitute import SubstituteNode
from shsa_core.substitution.signals import JOURNAL, SHARED, VARIABLE, decode

USAGE = "usage: rosrun shsa_core substitute INPUTS CODE OUTPUT"
Paths = Tuple[str, ...]


def _paths(text: str) -> Paths:
    return tuple(path.strip() for path in text.split(",") if path.strip())


def _by_hand(inputs: Paths, code: str, outputs: Paths) -> Substitution:
    """Return the row of a substitute that somebody started by hand: ask the SOM and the graph."""
    # Not for those who ask nobody: it takes long.
    from shsa_core.ros.master.som_parameter import look_up

    signals = look_up((*inputs, *outputs))
    muted = bool(rospy.get_param("~muted", False))
    n_inputs = len(inputs)
    return Substitution(
        rospy.get_name(), "", signals[:n_inputs], code, signals[n_inputs:], publishing=not muted
    )


def _by_reconfigurator(inputs: Paths, code: str, outputs: Paths, text: str) -> Substitution:
    """Return the row of a substitute whose signals came with its strings: muted at first."""
    signals = decode(text)
    if tuple(tuple(signal.path for signal in each) for each in signals) != (inputs, outputs):
        raise ShsaError(f"{VARIABLE} does not hold the signals of INPUTS and OUTPUT")
    return Substitution(rospy.get_name(), "", signals[0], code, signals[1])


def _spin(row: Substitution, rests: Optional[int] = None) -> None:
    path, journal = os.environ.get(JOURNAL, ""), None
    if path:
        from shsa_core.journal.writer import JournalWriter  # not for those without: it takes long

        journal = JournalWriter(
            path, "sharing" if row.shared else "substitution", {}, rospy.logwarn
        )
    SubstituteNode(row, journal, rests).spin()


def main() -> None:
    """Run the node: three strings on the command line.

    `~muted` starts it muted; the environment's SHSA_JOURNAL is a file for every event.
    """
    arguments = rospy.myargv(sys.argv)[1:]
    if len(arguments) != 3:
        raise SystemExit(USAGE)
    strings = _paths(arguments[0]), arguments[1], _paths(arguments[2])
    text = os.environ.get(VARIABLE)
    if text is None:
        run("substitute", lambda: _spin(_by_hand(*strings)))
    else:
        row = lambda: _by_reconfigurator(*strings, text)
        run("substitute", lambda: _spin(row(), priority.USUAL))


def standby() -> None:
    """Run an idle substitute, to be given its program by its row.

    With `--shared`, by its rows: it holds several.
    """
    shared = SHARED in rospy.myargv(sys.argv)[1:]
    priority.set_all(priority.STANDS_BY)
    row = lambda: Substitution(rospy.get_name(), "", (), "", (), shared=shared)
    run("standby", lambda: _spin(row(), priority.STANDS_BY))
