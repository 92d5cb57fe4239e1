"""Rows of the table of substitutions as messages.

A module of its own: a substitute must start soon, and needs nothing else of the wire.
"""
import struct
from typing import Callable, Type

from shsa_msgs import msg

from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution

_LENGTH = struct.Struct("<I")
_COUNTERS = struct.Struct("<QB")


def only_rows_of(node: str, all_: Callable[[], bool]) -> Type[msg.Substitutions]:
    """The message type of the table, for a reader whom only the rows of `node` concern.

    While `all_` says so, it is concerned by all.

    It decodes a message that names the node, and of any other only its sequence and whether it is
    the whole: else every substitute would decode the rows of all.
    """
    name = _LENGTH.pack(len(node.encode())) + node.encode()

    class OwnRows(msg.Substitutions):  # type: ignore[misc]
        """The table of substitutions as one of them sees it."""

        def deserialize(self, data: bytes) -> msg.Substitutions:
            """Read a message."""
            if name in data or all_():
                return super().deserialize(data)
            (length,) = _LENGTH.unpack_from(
                data, 12
            )  # of header.frame_id, behind sequence and stamp
            self.header.seq, self.header.stamp.secs, self.header.stamp.nsecs = struct.unpack_from(
                "<3I", data
            )
            self.header.frame_id = data[16 : 16 + length].decode("utf-8", "replace")
            self.sequence, whole = _COUNTERS.unpack_from(data, 16 + length)
            self.whole = bool(whole)
            return self

    return OwnRows


def substitution_message(row: Substitution) -> msg.Substitution:
    """A row as a message."""
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
    )


def substitution_row(message: msg.Substitution) -> Substitution:
    """The row that a message holds."""
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
    )


def signal_message(signal: Signal) -> msg.Signal:
    """A signal as a message; 0 stands for no period and no deadline."""
    return msg.Signal(
        topic=signal.topic,
        field=signal.field,
        type=signal.type,
        node=signal.node,
        period=signal.period or 0.0,
        deadline=signal.deadline or 0.0,
    )


def signal_of(message: msg.Signal) -> Signal:
    """The signal that a message holds."""
    return Signal(
        topic=message.topic,
        field=message.field,
        type=message.type,
        node=message.node,
        period=message.period or None,
        deadline=message.deadline or None,
    )
