"""Signals as text: so they travel to a substitute beside its three strings."""
import dataclasses
import json
import math
from typing import Any, Sequence, Tuple

from shsa_core.errors import ShsaError
from shsa_core.model.error import Error
from shsa_core.model.field import parse_field
from shsa_core.model.service import Signal

VARIABLE = "SHSA_SIGNALS"
"""The environment variable in which a substitute's signals travel.

One that has it starts muted, and asks nobody.
"""

SHARED = "--shared"
"""The word on the command line of a process that several substitutes share."""

JOURNAL = "SHSA_JOURNAL"
"""The environment variable that names the file for the journal of a substitute, if it keeps one."""

SHORTEST_S, LONGEST_S = 1e-4, 1e12
"""Of a signal's period and deadline: no wait is too short or too long for the clock."""

Signals = Tuple[Signal, ...]


def encode(inputs: Sequence[Signal], outputs: Sequence[Signal]) -> str:
    """The signals that a substitute reads and writes, as the text of VARIABLE."""
    return json.dumps([[dataclasses.astuple(s) for s in each] for each in (inputs, outputs)])


def decode(text: str) -> Tuple[Signals, Signals]:
    """The inputs and outputs in a text of `encode`; raises ShsaError if it is none."""
    try:
        inputs, outputs = json.loads(text)
        return tuple(map(_signal, inputs)), tuple(map(_signal, outputs))
    except (TypeError, ValueError, ShsaError) as error:
        raise ShsaError(f"{VARIABLE} holds no signals: {error}") from error


def _signal(values: Any) -> Signal:
    topic, field, kind, node, period, deadline, figures, latched, gain, offset = values
    error = None if figures is None else Error(*figures)
    if not all(isinstance(text, str) for text in (topic, field, kind, node)):
        raise TypeError(f"topic, field, type and node must be texts, not {values}")
    parse_field(field)
    if not isinstance(latched, bool):
        raise TypeError(f"latched must be true or false, not {latched}")
    return checked(Signal(topic, field, kind, node, period, deadline, error, latched, gain, offset))


def checked(signal: Signal) -> Signal:
    """The signal, if its numbers are such that one can wait and weigh by them.

    Raises ShsaError if they are not.
    """
    for number in (signal.period, signal.deadline):
        if not (number is None or _is_number(number) and SHORTEST_S <= number <= LONGEST_S):
            raise ShsaError(
                f"{signal.path}: period and deadline must be {SHORTEST_S:g} to {LONGEST_S:g} s, "
                f"or none, not {number}"
            )
    if signal.error is not None:
        _check_error(signal.path, signal.error)
    if not (_is_number(signal.gain) and 0.0 < signal.gain < math.inf):
        raise ShsaError(f"{signal.path}: gain must be a finite number above 0, not {signal.gain}")
    if not (_is_number(signal.offset) and math.isfinite(signal.offset)):
        raise ShsaError(f"{signal.path}: offset must be a finite number, not {signal.offset}")
    return signal


def _check_error(path: str, error: Error) -> None:
    for figure in (error.rms, 0.0 if error.p95 is None else error.p95):
        if not (_is_number(figure) and 0.0 <= figure < math.inf):
            raise ShsaError(f"{path}: an error must be finite and 0 or above, or none, not {error}")


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)
