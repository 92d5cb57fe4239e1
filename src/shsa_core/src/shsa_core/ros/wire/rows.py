"""Rows of the table of substitutions as messages.

A module of its own: a substitute must start soon, and needs nothing else of the wire.
"""
import math
from dataclasses import fields
from enum import Enum
from typing import Any, Callable, List, Mapping, Optional, Sequence, Type, TypeVar

import genpy
from shsa_msgs import msg

from shsa_core.errors import ShsaError
from shsa_core.model.names import NUMBERED
from shsa_core.model.error import Error
from shsa_core.model.kinds import OnPartition, Others, Word
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.ros.messages.tables import Concerns
from shsa_core.substitution import signals

NOT_KNOWN = math.nan

R = TypeVar("R")
W = TypeVar("W", bound=Word)


def own_rows(prefix: str) -> Callable[[str], Optional[Concerns]]:
    """Return which rows concern a subscriber; None: all, as it is not named as a substitute is.

    Substitutes, named with `prefix` by model/names, are told their own row, and an idle one the
    rows of the plans too, which name no node.
    """

    def concerning(name: str) -> Optional[Concerns]:
        if not name.startswith(prefix) or not NUMBERED.fullmatch(name[len(prefix) :]):
            return None
        return lambda row, rows: row.node == name or (not row.node and _may_be_idle(name, rows))

    return concerning


def _may_be_idle(name: str, rows: Mapping[str, msg.Substitution]) -> bool:
    return name not in rows or not rows[name].code


def filled(kind: Type[genpy.Message], record: Any, /, **others: Any) -> Any:
    """Return a message of the fields of its names that a record has, and of `others`.

    None becomes 0.
    """
    same = {name: _plain(value) for name, value in vars(record).items() if name in kind.__slots__}
    return kind(**{**same, **others})


def _plain(value: Any) -> Any:
    if isinstance(value, tuple):
        return list(value)
    return value.value if isinstance(value, Enum) else 0.0 if value is None else value


def read(kind: Type[R], message: genpy.Message, /, **others: Any) -> R:
    """Return the record of the fields of its names that a message has, and of `others`."""
    named = {each.name for each in fields(kind)} & set(message.__slots__) - others.keys()
    same = {name: getattr(message, name) for name in named}
    plain = {name: tuple(v) if isinstance(v, list) else v for name, v in same.items()}
    return kind(**plain, **others)


def substitution_message(row: Substitution) -> msg.Substitution:
    """Return a row as a message."""
    ends = {"inputs": row.inputs, "outputs": row.outputs}
    told = {name: [signal_message(each) for each in signals] for name, signals in ends.items()}
    return filled(msg.Substitution, row, **told)


def substitution_row(message: msg.Substitution) -> Substitution:
    """Return the row that a message holds. Raises ShsaError if it is none."""
    if not 0.0 <= message.bridge < math.inf:
        raise ShsaError(f"bridge must be 0, or s above it, not {message.bridge:g}")
    return read(
        Substitution,
        message,
        inputs=tuple(map(signal_of, message.inputs)),
        outputs=tuple(map(signal_of, message.outputs)),
        others=word_of("others", Others, message.others or Others.UNKNOWN),
        last_message=bytes(message.last_message),
        on_partition=word_of("on_partition", OnPartition, message.on_partition or OnPartition.WAIT),
    )


def word_of(name: str, kind: Type[W], text: str) -> W:
    """Return the word that the text of a field is. Raises ShsaError if it is none."""
    try:
        return kind(text)
    except ValueError as error:
        raise ShsaError(f"{name} must be one of {', '.join(kind)}, not {text!a}") from error


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
    return signals.checked(
        read(
            Signal,
            message,
            period=message.period or None,
            deadline=message.deadline or None,
            error=_error(message),
            gain=message.gain or 1.0,
        )
    )
