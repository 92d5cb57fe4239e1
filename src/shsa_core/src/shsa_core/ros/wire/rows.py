"""Rows of the table of substitutions as messages.

A module of its own: a substitute must start soon, and needs nothing else of the wire.
"""
import math
from typing import Callable, List, Mapping, Optional, Sequence

from shsa_msgs import msg

from shsa_core.errors import ShsaError
from shsa_core.healing.naming import NUMBERED
from shsa_core.model.error import Error
from shsa_core.model.kinds import OnPartition, Others
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.ros.messages.tables import Concerns
from shsa_core.substitution import signals

NOT_KNOWN = math.nan


def own_rows(prefix: str) -> Callable[[str], Optional[Concerns]]:
    """Return which rows concern a subscriber; None: all, as it is not named as a substitute is.

    Substitutes, named with `prefix` by healing/naming, are told their own row, and an idle one the
    rows of the plans too, which name no node.
    """

    def concerning(name: str) -> Optional[Concerns]:
        if not name.startswith(prefix) or not NUMBERED.fullmatch(name[len(prefix) :]):
            return None
        return lambda row, rows: row.node == name or (not row.node and _may_be_idle(name, rows))

    return concerning


def _may_be_idle(name: str, rows: Mapping[str, msg.Substitution]) -> bool:
    return name not in rows or not rows[name].code


def substitution_message(row: Substitution) -> msg.Substitution:
    """Return a row as a message."""
    return msg.Substitution(
        node=row.node,
        service=row.service,
        inputs=[signal_message(signal) for signal in row.inputs],
        code=row.code,
        outputs=[signal_message(signal) for signal in row.outputs],
        relations=list(row.relations),
        quality=row.quality,
        publishing=row.publishing,
        original=row.original,
        others=str(row.others),
        last_message=row.last_message,
        host=row.host,
        on_partition=str(row.on_partition),
        yields=row.yields,
        bridge=row.bridge,
        gated=row.gated,
        shared=row.shared,
    )


def substitution_row(message: msg.Substitution) -> Substitution:
    """Return the row that a message holds. Raises ShsaError if it is none."""
    others = message.others or Others.UNKNOWN
    if others not in tuple(Others):
        raise ShsaError(f"others must be one of {', '.join(Others)}, not {others!a}")
    on_partition = message.on_partition or OnPartition.WAIT
    if on_partition not in tuple(OnPartition):
        raise ShsaError(
            f"on_partition must be one of {', '.join(OnPartition)}, not {on_partition!a}"
        )
    if not 0.0 <= message.bridge < math.inf:
        raise ShsaError(f"bridge must be 0, or s above it, not {message.bridge:g}")
    return Substitution(
        node=message.node,
        service=message.service,
        inputs=tuple(signal_of(signal) for signal in message.inputs),
        code=message.code,
        outputs=tuple(signal_of(signal) for signal in message.outputs),
        relations=tuple(message.relations),
        quality=message.quality,
        publishing=message.publishing,
        original=message.original,
        others=Others(others),
        last_message=bytes(message.last_message),
        host=message.host,
        on_partition=OnPartition(on_partition),
        yields=message.yields,
        bridge=message.bridge,
        gated=message.gated,
        shared=message.shared,
    )


def signal_message(signal: Signal) -> msg.Signal:
    """Return a signal as a message; 0 stands for no period or deadline, NaN for no error."""
    return msg.Signal(
        topic=signal.topic,
        field=signal.field,
        type=signal.type,
        node=signal.node,
        period=signal.period or 0.0,
        deadline=signal.deadline or 0.0,
        error_rms=rms_of([signal.error])[0],
        error_p95=p95_of([signal.error])[0],
        gain=signal.gain,
        offset=signal.offset,
        latched=signal.latched,
    )


def rms_of(errors: Sequence[Optional[Error]]) -> List[float]:
    """Return the expected RMS errors as a message has them."""
    return [NOT_KNOWN if error is None else error.rms for error in errors]


def p95_of(errors: Sequence[Optional[Error]]) -> List[float]:
    """Return what errors are expected to be within in 95 %, as a message has it."""
    return [NOT_KNOWN if error is None or error.p95 is None else error.p95 for error in errors]


def _error(message: msg.Signal) -> Optional[Error]:
    if not message.error_rms:  # a message that was never filled in claims no certainty
        return None
    if math.isnan(message.error_rms):
        return None
    p95 = None if math.isnan(message.error_p95) else message.error_p95
    return Error(message.error_rms, p95=p95)


def signal_of(message: msg.Signal) -> Signal:
    """Return the signal that a message holds. Raises ShsaError if it is none."""
    return signals.checked(
        Signal(
            topic=message.topic,
            field=message.field,
            type=message.type,
            node=message.node,
            period=message.period or None,
            deadline=message.deadline or None,
            error=_error(message),
            gain=message.gain or 1.0,
            offset=message.offset,
            latched=message.latched,
        )
    )
