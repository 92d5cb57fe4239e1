"""Makes events of messages, which are read and decoded only as far as somebody checks them."""
from contextlib import suppress
from typing import NamedTuple, Optional

from shsa_core.errors import ShsaError
from shsa_core.model.samples import Parts
from shsa_core.model.service import Service
from shsa_core.monitoring.events import Message
from shsa_core.monitoring.evidence import checked_provisions, checks_header
from shsa_core.monitoring.settings import LAST_MESSAGE_B
from shsa_core.ros.messages.fields import HEADER_END, Decoder, foreign, frame, stamp
from shsa_core.ros.sockets.connection import Connection, Wanted
from shsa_core.ros.sockets.subscriptions import Arrived

ALL = Wanted()
HEAD = Wanted(LAST_MESSAGE_B, HEADER_END)
"""Nobody judges values: of a message too large to be kept, the header is all that is looked at."""


class _Needs(NamedTuple):
    """The parts of a connection's messages that the checks of a service need."""

    service: Optional[Service]
    values: Optional[Decoder] = None
    header: bool = False
    foreign: str = ""  # why they are none of the type of the service


def event_of(arrived: Arrived, service: Optional[Service], unjudged: Wanted = HEAD) -> Message:
    """Return the event that a message makes, read as the service needs it that it is judged by.

    `unjudged`: what is wanted of messages of which no value is judged. What was not copied is not
    judged.
    """
    time, connection, data, whole, ros_time, waited = arrived
    needs: Optional[_Needs] = connection.needs
    if needs is None or (needs.service is not service and needs.service != service):
        needs = connection.needs = _needs(connection, service)
        connection.frames.wanted = ALL if needs.values is not None else unjudged
    values, error, age, stamped = None, "", None, 0
    form: Parts = ()
    if needs.values is not None and whole:
        try:
            values, form = needs.values.values(data), needs.values.form()
        except ShsaError as refusal:
            error = str(refusal)
    if needs.header:
        stamped, form = stamp(data), form or frame(data)
        age = (ros_time - stamped) / 1e9 if stamped else None
    whom = (connection.topic, connection.publisher)
    told = needs.foreign
    return Message(time, *whom, values, error, age, waited, stamp=stamped, form=form, foreign=told)


def _needs(connection: Connection, service: Optional[Service]) -> _Needs:
    if service is None:
        return _Needs(service)
    with suppress(ShsaError):  # its type is not known here
        why = foreign(service.type, connection.header)
        if why and connection.header["type"] != "*":
            connection.warn(why)
            return _Needs(service, foreign=f"its messages are not read: {why}")
    fields = tuple(each.field for each in checked_provisions(service))
    unchecked = not fields and not checks_header(service)
    decoder = None if unchecked else connection.decoder(service.type, fields)
    if decoder is None:
        return _Needs(service)
    return _Needs(service, decoder if fields else None, decoder.has_stamp)
