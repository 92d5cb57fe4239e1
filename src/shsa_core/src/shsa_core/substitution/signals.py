"""Signals as text: so they travel to a substitute beside its three strings."""
import math
from typing import Sequence, Tuple

from shsa_core.errors import ShsaError
from shsa_core.journal.codec import Codec
from shsa_core.model.error import Error
from shsa_core.model.field import parse_field
from shsa_core.model.service import Signal

VARIABLE = "SHSA_SIGNALS"
"""The environment variable with the signals of a substitute: it starts muted, and asks nobody."""

SHARED = "--shared"
"""The word on the command line of a process that several substitutes share."""

JOURNAL = "SHSA_JOURNAL"
"""The environment variable that names the file for the journal of a substitute, if it keeps one."""

SHORTEST_S, LONGEST_S = 1e-4, 1e12
"""Of a signal's period and deadline: no wait is too short or too long for the clock."""

Signals = Tuple[Signal, ...]
_CODEC = Codec(Tuple[Signals, Signals])


def encode(inputs: Sequence[Signal], outputs: Sequence[Signal]) -> str:
    """Return the signals that a substitute reads and writes, as the text of VARIABLE."""
    return _CODEC.to_text((tuple(inputs), tuple(outputs)))


def decode(text: str) -> Tuple[Signals, Signals]:
    """Return the inputs and outputs in a text of `encode`. Raises ShsaError if it is none."""
    try:
        inputs, outputs = _CODEC.from_text(text, VARIABLE, "the value")
        for signal in (*inputs, *outputs):
            parse_field(checked(signal).field)
    except ShsaError as error:
        raise ShsaError(f"{VARIABLE} holds no signals: {error}") from error
    return inputs, outputs


def checked(signal: Signal) -> Signal:
    """Return the signal if one can wait and weigh by its numbers. Raises ShsaError if not."""
    for number in (signal.period, signal.deadline):
        if not (number is None or SHORTEST_S <= number <= LONGEST_S):
            raise ShsaError(
                f"{signal.path}: period and deadline must be {SHORTEST_S:g} to {LONGEST_S:g} s, "
                f"or none, not {number}"
            )
    error = signal.error or Error(0.0)
    if not all(0.0 <= figure < math.inf for figure in (error.rms, error.p95 or 0.0)):
        text = "an error must be finite and 0 or above, or none"
        raise ShsaError(f"{signal.path}: {text}, not {error}")
    if not 0.0 < signal.gain < math.inf:
        raise ShsaError(f"{signal.path}: gain must be a finite number above 0, not {signal.gain}")
    if not math.isfinite(signal.offset):
        raise ShsaError(f"{signal.path}: offset must be a finite number, not {signal.offset}")
    return signal
