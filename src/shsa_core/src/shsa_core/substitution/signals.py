"""Signals as text: so they travel to a substitute beside its three strings."""
import dataclasses
import json
from typing import Any, Sequence, Tuple

from shsa_core.errors import ShsaError
from shsa_core.model.service import Signal

VARIABLE = "SHSA_SIGNALS"
"""The environment variable in which a substitute's signals travel.

One that has it starts muted, and asks nobody.
"""

JOURNAL = "SHSA_JOURNAL"
"""The environment variable that names the file for the journal of a substitute, if it keeps one."""

Signals = Tuple[Signal, ...]


def encode(inputs: Sequence[Signal], outputs: Sequence[Signal]) -> str:
    """The signals that a substitute reads and writes, as the text of VARIABLE."""
    return json.dumps([[dataclasses.astuple(s) for s in each] for each in (inputs, outputs)])


def decode(text: str) -> Tuple[Signals, Signals]:
    """The inputs and outputs in a text of `encode`; raises ShsaError if it is none."""
    try:
        inputs, outputs = json.loads(text)
        return tuple(map(_signal, inputs)), tuple(map(_signal, outputs))
    except (TypeError, ValueError) as error:
        raise ShsaError(f"{VARIABLE} holds no signals: {error}") from error


def _signal(values: Any) -> Signal:
    topic, field, kind, node, period, deadline = values
    if not all(isinstance(text, str) for text in (topic, field, kind, node)):
        raise TypeError(f"topic, field, type and node must be texts, not {values}")
    for number in (period, deadline):
        if number is not None and not (isinstance(number, (int, float)) and number > 0):
            raise TypeError(
                f"period and deadline must be numbers of s above 0, or null, not {number}"
            )
    return Signal(topic, field, kind, node, period, deadline)
