"""Records as messages and back, by the names of their fields; rows of the table of substitutions.

A module of its own: a substitute must start soon, and needs nothing else of the wire.
"""
import math
from dataclasses import MISSING, Field, fields
from enum import Enum
from functools import lru_cache
from typing import Any, Callable, List, Optional, Sequence, Type, TypeVar
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

R = TypeVar("R")
_hints = lru_cache(maxsize=None)(get_type_hints)


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


def filled(kind: Type[genpy.Message], record: Any, /, **others: Any) -> Any:
    """Return a message of a record's fields, and `others`; None becomes 0, or no text."""
    types = dict(zip(kind.__slots__, kind._slot_types))
    same = {name: value for name, value in vars(record).items() if name in types.keys() - others}
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
    record: Any = kind
    wanted, hints = set(message.__slots__).difference(others), _hints(record)
    values = {
        each.name: _read(each, hints[each.name], getattr(message, each.name), ahead)
        for each in fields(record)
        if each.name in wanted
    }
    return kind(**values, **others)


def _read(field: "Field[Any]", hint: Any, value: Any, ahead: Optional[float]) -> Any:
    of = next(iter(get_args(hint)), hint)  # Optional[float] is of float
    if isinstance(value, genpy.Time):
        return None if ahead is None else clock.to_moment(value, ahead)
    if isinstance(of, type) and issubclass(of, Word):
        if not value and field.default is not MISSING:
            return field.default  # no text stands for what a record is made with
        return word_of(field.name, of, value)
    if hint is bytes:
        return bytes(value)
    if hint == Optional[float]:
        return value or None
    return tuple(value) if isinstance(value, list) else value


def word_of(name: str, kind: Type[Word], text: str) -> Word:
    """Return the word that the text of a field is. Raises ShsaError if it is none."""
    try:
        return kind(text)
    except ValueError as error:
        raise ShsaError(f"{name} must be one of {', '.join(kind)}, not {text!a}") from error


def substitution_message(row: Substitution) -> msg.Substitution:
    """Return a row as a message."""
    inputs, outputs = ([*map(signal_message, each)] for each in (row.inputs, row.outputs))
    return filled(msg.Substitution, row, inputs=inputs, outputs=outputs)


def substitution_row(message: msg.Substitution) -> Substitution:
    """Return the row that a message holds. Raises ShsaError if it is none."""
    if not 0.0 <= message.bridge < math.inf:
        raise ShsaError(f"bridge must be 0, or s above it, not {message.bridge:g}")
    inputs, outputs = (tuple(map(signal_of, each)) for each in (message.inputs, message.outputs))
    return read(Substitution, message, inputs=inputs, outputs=outputs)


def signal_message(signal: Signal) -> msg.Signal:
    """Return a signal as a message; 0 stands for no period or deadline, NaN for no error."""
    (rms,), (p95,) = rms_of([signal.error]), p95_of([signal.error])
    return filled(msg.Signal, signal, error_rms=rms, error_p95=p95)


def rms_of(errors: Sequence[Optional[Error]]) -> List[float]:
    """Return the expected RMS errors as a message has them."""
    return [math.nan if error is None else error.rms for error in errors]


def p95_of(errors: Sequence[Optional[Error]]) -> List[float]:
    """Return what errors are expected to be within in 95 %, as a message has it."""
    return [math.nan if error is None or error.p95 is None else error.p95 for error in errors]


def _error(message: msg.Signal) -> Optional[Error]:
    if not message.error_rms or math.isnan(message.error_rms):
        return None  # a message that was never filled in claims no certainty
    p95 = None if math.isnan(message.error_p95) else message.error_p95
    return Error(message.error_rms, p95=p95)


def signal_of(message: msg.Signal) -> Signal:
    """Return the signal that a message holds. Raises ShsaError if it is none."""
    return signals.checked(read(Signal, message, error=_error(message), gain=message.gain or 1.0))
