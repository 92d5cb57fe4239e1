"""Between the reconfigurator's events and commands and the messages of shsa_msgs."""
import json
from math import isfinite
from typing import Any, Dict, Optional, Tuple

import rospy
from shsa_msgs import msg, srv
from std_msgs.msg import Header

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.incident import Incident
from shsa_core.model.calibration import Calibration
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind
from shsa_core.model.substitution import Program
from shsa_core.monitoring.calibration import SOURCE
from shsa_core.monitoring.settings import LAST_MESSAGE_B
from shsa_core.monitoring.events import CalibrationRow, PublisherHealth, PublisherState
from shsa_core.ros import clock
from shsa_core.ros.wire.rows import filled, p95_of, read, rms_of, word_of
from shsa_core.text import shown

MOMENTS = "last_good detected killed found spawned first_message returned ended".split()
"""Of an incident."""


def failure_seen(failure: msg.Failure) -> events.FailureSeen:
    """Return the event of a message on /shsa/failures. Raises ShsaError if it is none."""
    detected = failure.header.stamp
    told = detected if failure.told.is_zero() else failure.told
    theirs = _clock_of(failure, told)
    return read(
        events.FailureSeen,
        failure,
        time=theirs.at(detected) or clock.now(),
        kind=_kind(failure.kind) or Kind.OTHER,
        detail=shown(failure.detail),
        last_good=theirs.at(failure.last_good),
        last_message=last_message(bytes(failure.last_message)),
    )


def last_message(message: bytes) -> bytes:
    """Return a message from outside as it may travel in a table; empty if it is too large."""
    return message if len(message) <= LAST_MESSAGE_B else b""


def health_seen(health: msg.Health, anew: bool = False, host: str = "") -> events.HealthSeen:
    """Return the event of a message on /shsa/health. Raises ShsaError if it is none.

    `host`: the computer whose monitor sent it.
    """
    theirs = _clock_of(health, health.header.stamp)
    return events.HealthSeen(
        time=clock.now(),
        rows=tuple(_publisher_health(row, theirs) for row in health.publishers),
        removed=tuple(_key(key) for key in health.removed),
        whole=health.whole,
        anew=anew,
        host=host,
    )


def calibrations_heard(table: msg.Calibrations) -> events.CalibrationsHeard:
    """Return the event of a message on /shsa/calibrations. Raises ShsaError if it is none."""
    rows = tuple(_calibration_row(row) for row in table.calibrations)
    removed = tuple(_calibration_key(key) for key in table.removed)
    return events.CalibrationsHeard(clock.now(), rows, removed)


def _calibration_row(row: msg.Calibration) -> CalibrationRow:
    outputs, numbers = tuple(row.outputs), (row.gains, row.offsets, row.rms, row.biases, row.p95)
    if any(len(each) != len(outputs) for each in (*numbers, row.samples)):
        raise ShsaError(f"{row.service}: a calibration has not one number for each output")
    if not all(isfinite(number) for each in numbers for number in each) or any(
        gain <= 0.0 for gain in row.gains
    ):
        raise ShsaError(f"{row.service}: a gain is not above 0, or a number not finite")
    errors = [
        Error(rms, bias, p95, n=n, source=SOURCE) if n else None
        for rms, bias, p95, n in zip(row.rms, row.biases, row.p95, row.samples)
    ]
    found = tuple(map(Calibration, row.gains, row.offsets, errors))
    return CalibrationRow(row.service, Program(tuple(row.inputs), row.code, outputs), found)


def _calibration_key(text: str) -> Tuple[str, Program]:
    try:
        service, inputs, code, outputs = json.loads(text)
        return service, Program(tuple(inputs), code, tuple(outputs))
    except (TypeError, ValueError) as error:
        raise ShsaError(f"{text!a} names no calibration: {error}") from error


def _publisher_health(row: msg.PublisherHealth, theirs: clock.SenderClock) -> PublisherHealth:
    return read(
        PublisherHealth,
        row,
        state=word_of("state", PublisherState, row.state),
        since=theirs.at(row.since) or 0.0,
        first_message=theirs.at(row.first_message),
        last_good=theirs.at(row.last_good),
        kind=_kind(row.kind),
        detail=shown(row.detail),
        last_message=last_message(bytes(row.last_message)),
    )


def _clock_of(message: Any, told: rospy.Time) -> clock.SenderClock:
    """Return the clock by which a message was sent at `told`; signed ones know when that was."""
    return clock.sender_clock(told, getattr(message, "sent_here", 0))


def _key(text: str) -> Tuple[str, str]:
    topic, _, publisher = text.partition(" ")
    return topic, publisher


def _kind(text: str) -> Optional[Kind]:
    """Return the kind of failure; None for none. Raises ShsaError."""
    return word_of("kind", Kind, text) if text else None


def service_state(state: events.ServiceState) -> msg.ServiceState:
    """Return a row of the running SOM."""
    service = state.service
    told = {
        "service": service.name,
        "topic": service.topic,
        "type": service.type,
        "period": service.period or 0.0,
        "needed": bool(service.needed),
        "properties": list(service.properties),
        "fields": [provision.field for provision in service.provides],
        "qualities": [provision.quality for provision in service.provides],
    }
    return filled(msg.ServiceState, state, **told)


def incident(record: Incident) -> msg.Incident:
    """One step of an incident."""
    errors = {"error_rms": rms_of(record.errors), "error_p95": p95_of(record.errors)}
    header = Header(stamp=rospy.Time.now())
    return filled(msg.Incident, record, header=header, **errors, **_stamps(record))


def incident_record(record: Incident) -> Dict[str, object]:
    """Return an incident as plain values for the log; its moments in s of ROS time."""
    plain = record.as_dict()
    for name, stamp in _stamps(record).items():
        plain[name] = None if vars(record)[name] is None else round(stamp.to_sec(), 6)
    return plain


def _stamps(record: Incident) -> Dict[str, rospy.Time]:
    """Return the moments of an incident: in order as they were."""
    ahead = clock.offset()
    moments = {name: vars(record)[name] for name in MOMENTS}
    return {name: clock.to_stamp(moment, ahead) for name, moment in moments.items()}


def found(plan: Plan) -> srv.FindSubstituteResponse:
    """Return the answer that `plan` would be carried out."""
    using = ", ".join(plan.relations) or "the same property elsewhere"
    return filled(
        srv.FindSubstituteResponse,
        plan.program,
        found=True,
        relations=list(plan.relations),
        quality=plan.quality,
        error_rms=rms_of(plan.errors),
        error_p95=p95_of(plan.errors),
        proven_best=plan.proven_best,
        detail=f"quality {plan.quality:.2g}, by {using}",
    )
