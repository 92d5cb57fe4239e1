"""Records as messages and back, by the names of their fields; rows of the table of substitutions.

A module of its own: a substitute must start soon, and needs nothing else of the wire.
"""
import math
from dataclasses import MISSING, fields
from enum import Enum
from functools import lru_cache
from typing import Any, Callable, Dict, List, Optional, Sequence, Type, TypeVar
from typing import get_args, get_type_hints

import genpy
from shsa_msgs import msg

from shsa_core.errors import ShsaError
from shsa_core.model.error import Error
from shsa_core.model.kinds import Word
from shsa_core.model.names import NUMBERED
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.ros import clock
from shsa_core.ros.messages.tables import Concerns
from shsa_core.substitution import signals

NOT_KNOWN = math.nan

R = TypeVar("R")
Read = Callable[[Any, Optional[float]], Any]
"""Makes a record's value of a message's, whose sender's clock is so far ahead."""


def own_rows(prefix: str) -> Callable[[str], Optional[Concerns]]:
    """Return which rows concern a subscriber; None: all, as it is not named as a substitute is.

    Substitutes, named with `prefix` by model/names, are told their own row, and an idle one the
    rows of the plans too, which name no node.
    """

    def concerning(name: str) -> Optional[Concerns]:
        if not name.startswith(prefix) or not NUMBERED.fullmatch(name[len(prefix) :]):
            return None
        may_be_idle = lambda rows: name not in rows or not rows[name].code
        return lambda row, rows: row.node == name or (not row.node and may_be_idle(rows))

    return concerning


def filled(kind: Type[genpy.Message], /, *records: Any, **others: Any) -> Any:
    """Return a message of `others`, else of the last record with a field; None: 0, or no text."""
    types = dict(zip(kind.__slots__, kind._slot_types))
    known = {name: value for each in records for name, value in vars(each).items()}
    same = {name: value for name, value in known.items() if name in types.keys() - others}
    ahead = clock.offset() if any(types[name] == "time" for name in same) else 0.0
    told = {name: _written(value, types[name], ahead) for name, value in same.items()}
    return kind(**told, **others)


def _written(value: Any, slot: str, ahead: float) -> Any:
    if slot == "time":
        return clock.to_stamp(value, ahead)
    if isinstance(value, tuple):
        return list(value)
    if value is None:
        return "" if slot == "string" else 0.0
    return value.value if isinstance(value, Enum) else value


def read(
    kind: Type[R], message: genpy.Message, ahead: Optional[float] = None, /, **others: Any
) -> R:
    """Return the record of the fields of its names that a message has, and of `others`.

    Stamps are moments by a clock that is so far ahead of ours. Raises ShsaError if a word is none.
    """
    kinds: Any = kind, type(message)
    readers = _readers(*kinds)
    wanted = readers.keys() - others
    same = {name: readers[name](getattr(message, name), ahead) for name in wanted}
    return kind(**same, **others)


@lru_cache(maxsize=None)
def _readers(kind: Any, message: Type[genpy.Message]) -> Dict[str, Read]:
    """Return what reads each field that a record of this kind shares with a message."""
    slots, hints = dict(zip(message.__slots__, message._slot_types)), get_type_hints(kind)
    shared = [each for each in fields(kind) if each.name in slots]
    return {
        each.name: _reader(each.name, slots[each.name], hints[each.name], each.default)
        for each in shared
    }


def _reader(name: str, slot: str, hint: Any, default: Any) -> Read:
    of = next(iter(get_args(hint)), hint)  # Optional[float] is of float
    if slot == "time":
        return lambda stamp, ahead: None if ahead is None else clock.to_moment(stamp, ahead)
    if isinstance(of, type) and issubclass(of, Word):
        # No text stands for what a record is made with.
        return lambda text, _: word_of(name, of, text) if text or default is MISSING else default
    if hint is bytes:
        return lambda data, _: bytes(data)
    if hint == Optional[float]:
        return lambda number, _: number or None
    return lambda value, _: tuple(value) if isinstance(value, list) else value


def word_of(name: str, kind: Type[Word], text: str) -> Word:
    """Return the word that the text of a field is. Raises ShsaError if it is none."""
    try:
        return kind(text)
    except ValueError as error:
        raise ShsaError(f"{name} must be one of {', '.join(kind)}, not {text!a}") from error


def substitution_message(row: Substitution) -> msg.Substitution:
    """Return a row as a message."""
    inputs, outputs = (list(map(signal_message, end)) for end in (row.inputs, row.outputs))
    return filled(msg.Substitution, row, inputs=inputs, outputs=outputs)


def substitution_row(message: msg.Substitution) -> Substitution:
    """Return the row that a message holds. Raises ShsaError if it is none."""
    if not 0.0 <= message.bridge < math.inf:
        raise ShsaError(f"bridge must be 0, or s above it, not {message.bridge:g}")
    inputs, outputs = (tuple(map(signal_of, end)) for end in (message.inputs, message.outputs))
    return read(Substitution, message, inputs=inputs, outputs=outputs)


def signal_message(signal: Signal) -> msg.Signal:
    """Return a signal as a message; 0 stands for no period or deadline, NaN for no error."""
    (rms,), (p95,) = rms_of([signal.error]), p95_of([signal.error])
    return filled(msg.Signal, signal, error_rms=rms, error_p95=p95)


def rms_of(errors: Sequence[Optional[Error]]) -> List[float]:
    """Return the expected RMS errors as a message has them."""
    return [NOT_KNOWN if error is None else error.rms for error in errors]


def p95_of(errors: Sequence[Optional[Error]]) -> List[float]:
    """Return what errors are expected to be within in 95 %, as a message has it."""
    return [NOT_KNOWN if error is None or error.p95 is None else error.p95 for error in errors]


def _error(message: msg.Signal) -> Optional[Error]:
    if not message.error_rms or math.isnan(message.error_rms):
        return None  # a message that was never filled in claims no certainty
    p95 = None if math.isnan(message.error_p95) else message.error_p95
    return Error(message.error_rms, p95=p95)


def signal_of(message: msg.Signal) -> Signal:
    """Return the signal that a message holds. Raises ShsaError if it is none."""
    return signals.checked(read(Signal, message, error=_error(message), gain=message.gain or 1.0))
