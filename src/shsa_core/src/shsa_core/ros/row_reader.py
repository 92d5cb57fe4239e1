"""Reads a substitute's rows of the table of substitutions: what its core hears of them."""
from typing import Iterable, Iterator, List, Optional, Set

import rospy
from shsa_msgs import msg

from shsa_core.errors import ShsaError
from shsa_core.message_types import message_class
from shsa_core.model.substitution import Substitution, row_key
from shsa_core.ros import clock
from shsa_core.ros.messages.composing import read_message
from shsa_core.ros.messages.fields import Field, problem
from shsa_core.ros.wire.rows import substitution_row
from shsa_core.substitution import events


class RowReader:
    """The rows of the node `name`; one that is `idle` hears of the plans as well."""

    def __init__(self, name: str, idle: bool) -> None:
        self.idle = idle
        self._name = name
        self._listed: Set[str] = set()

    def read(self, message: msg.Substitutions, now: float) -> List[events.Event]:
        """Return what a table changes, `now` in s."""
        found: List[events.Event] = []
        ours = [row for row in message.substitutions if row.node == self._name]
        for row in _rows(ours):
            self._listed.add(row_key(row))
            self.idle = row.idle
            last = last_message(row)
            found.append(events.RowChanged(now, row, unusable(row), last, clock.ros_ns()))
        told = {row_key(row) for row in ours}
        ended = self._listed.intersection(message.removed) - told
        for key in (self._listed - told) if message.whole else ended:
            self._listed.discard(key)
            found.append(events.RowRemoved(now, key.partition(" ")[2], key in ended))
        if self.idle:
            plans = tuple(_rows(row for row in message.substitutions if not row.node))
            problems = tuple(each for plan in plans for each in unusable(plan))
            told_gone, whole = tuple(message.removed), message.whole
            found.append(events.PlansChanged(now, plans, told_gone, whole, problems))
        return found


def _rows(messages: Iterable[msg.Substitution]) -> Iterator[Substitution]:
    """Yield the rows of a table; one that is none costs no other."""
    for each in messages:
        try:
            yield substitution_row(each)
        except ShsaError as error:
            text = f"A row for {each.service} is refused: {error}"
            rospy.logwarn_throttle_identical(60.0, text)


def unusable(row: Substitution) -> events.Unusable:
    """Return the signals of a row that cannot be read or written here, each with the reason."""
    problems = [(each, problem(each.type, each.field, False)) for each in row.inputs]
    problems += [(each, problem(each.type, each.field, True)) for each in row.outputs]
    return tuple((signal, why) for signal, why in problems if why)


def last_message(row: Substitution) -> Optional[events.LastMessage]:
    """Return what the last good message of a row held; None if there is none to be read."""
    if not row.last_message or not row.outputs:
        return None
    try:
        kind = message_class(row.outputs[0].type)
        message = read_message(kind, row.last_message)
        fields = (signal.field for signal in row.outputs)
        found = ((field, Field(kind, field).get(message)) for field in fields)
        values = tuple((field, value) for field, value in found if value is not None)
    except ShsaError as error:
        text = f"{row.node}: the last message of {row.service} is not used: {error}"
        rospy.logwarn_throttle_identical(60.0, text)
        return None
    stamp = message.header.stamp.to_nsec() if kind._has_header else 0
    return events.LastMessage(values, min(stamp, clock.ros_ns()))
