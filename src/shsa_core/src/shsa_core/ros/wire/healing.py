"""Between the events and commands of monitor and reconfigurator and the messages of shsa_msgs."""
from math import isfinite
from typing import Any, Dict, Tuple

import rospy
from shsa_msgs import msg, srv
from std_msgs.msg import Header

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.incident import Incident
from shsa_core.journal.codec import Codec
from shsa_core.model.calibration import CalibrationRow
from shsa_core.model.error import Error
from shsa_core.model.health import Key, PublisherHealth
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Signal
from shsa_core.model.substitution import Program, Substitution
from shsa_core.monitoring.events import FormerlyHealthy, SubstitutionsChanged
from shsa_core.monitoring.settings import LAST_MESSAGE_B
from shsa_core.ros import clock
from shsa_core.ros.wire import names
from shsa_core.ros.wire.rows import filled, p95_of, read, rms_of, word_of
from shsa_core.text import shown

_KEY, _ROW = Codec(Tuple[str, Program]), Codec(CalibrationRow)


def failure_seen(failure: msg.Failure) -> events.FailureSeen:
    """Return the event of a message on /shsa/failures. Raises ShsaError if it is none."""
    detected = failure.header.stamp
    ahead = _ahead(failure, detected if failure.told.is_zero() else failure.told)
    return read(
        events.FailureSeen,
        failure,
        ahead,
        time=clock.to_moment(detected, ahead) or clock.now(),
        kind=word_of("kind", Kind, failure.kind or Kind.OTHER),
        detail=shown(failure.detail),
        last_message=last_message(bytes(failure.last_message)),
    )


def last_message(message: bytes) -> bytes:
    """Return a message from outside as it may travel in a table; empty if it is too large."""
    return message if len(message) <= LAST_MESSAGE_B else b""


def health_seen(health: msg.Health, host: str = "") -> events.HealthSeen:
    """Return the event of a message of the monitor of `host` on /shsa/health. Raises ShsaError."""
    ahead = _ahead(health, health.header.stamp)
    keys = (key.partition(" ") for key in health.removed)
    rows = tuple(_publisher_health(row, ahead) for row in health.publishers)
    removed = tuple((topic, publisher) for topic, _, publisher in keys)
    return events.HealthSeen(clock.now(), rows, removed, health.whole, health.began, host)


def calibrations_heard(table: msg.Calibrations) -> events.CalibrationsHeard:
    """Return the event of a message on /shsa/calibrations. Raises ShsaError if it is none."""
    removed = (_KEY.from_text(each, names.CALIBRATIONS, "the key") for each in table.removed)
    rows = tuple(map(_calibration, table.calibrations))
    return events.CalibrationsHeard(clock.now(), rows, tuple(removed))


def _calibration(message: msg.Calibration) -> CalibrationRow:
    row: CalibrationRow = _ROW.from_text(message.row, names.CALIBRATIONS, "the row")
    for each in row.calibrations:
        error = each.error or Error(0.0)
        numbers = each.gain, each.offset, error.rms, error.bias, error.within
        if each.gain <= 0.0 or not all(map(isfinite, numbers)):
            raise ShsaError(f"{row.service}: a gain is not above 0, or a number not finite")
    return row


def _publisher_health(row: msg.PublisherHealth, ahead: float) -> PublisherHealth:
    return read(
        PublisherHealth,
        row,
        ahead,
        since=clock.to_moment(row.since, ahead) or 0.0,
        detail=shown(row.detail),
        last_message=last_message(bytes(row.last_message)),
    )


def _ahead(message: Any, told: rospy.Time) -> float:
    """Return how far the clock is ahead by which a message was sent; signed ones know when."""
    return clock.offset(told, getattr(message, "sent_here", 0))


def service_state(state: events.ServiceState) -> msg.ServiceState:
    """Return a row of the running SOM."""
    service = state.service
    told = {
        "service": service.name,
        "needed": bool(service.needed),
        "properties": list(service.properties),
        "fields": [provision.field for provision in service.provides],
        "qualities": [provision.quality for provision in service.provides],
    }
    return filled(msg.ServiceState, service, state, **told)


def incident(record: Incident) -> msg.Incident:
    """One step of an incident."""
    errors = {"error_rms": rms_of(record.errors), "error_p95": p95_of(record.errors)}
    return filled(msg.Incident, record, header=Header(stamp=rospy.Time.now()), **errors)


def incident_record(record: Incident) -> Dict[str, object]:
    """Return an incident as plain values for the log; its moments in s of ROS time."""
    plain, message = record.as_dict(), incident(record)
    for name, kind in zip(message.__slots__, message._slot_types):
        if kind == "time":
            known = getattr(record, name) is not None
            plain[name] = round(getattr(message, name).to_sec(), 6) if known else None
    return plain


def found(plan: Plan) -> srv.FindSubstituteResponse:
    """Return the answer that `plan` would be carried out."""
    using = ", ".join(plan.relations) or "the same property elsewhere"
    return filled(
        srv.FindSubstituteResponse,
        plan,
        plan.program,
        found=True,
        error_rms=rms_of(plan.errors),
        error_p95=p95_of(plan.errors),
        missing=[],
        detail=f"quality {plan.quality:.2g}, by {using}",
    )


def failure_message(row: PublisherHealth) -> msg.Failure:
    """Return what is told on shsa/failures: all that the row says. Either may be heard first."""
    header = Header(stamp=clock.to_stamp(row.since))
    return filled(msg.Failure, row, header=header, told=rospy.Time.now())


def health_key(key: Key) -> str:
    """Return the key of a row of the table of health."""
    return f"{key[0]} {key[1]}"


def health_row_key(row: msg.PublisherHealth) -> str:
    """Return the key of a row of that table."""
    return health_key((row.topic, row.publisher))


def calibration_row(row: CalibrationRow) -> msg.Calibration:
    """Return a row of the table of calibrations."""
    return msg.Calibration(calibration_key(row.service, row.program), _ROW.to_text(row))


def calibration_key(service: str, program: Program) -> str:
    """Return the key of a row of the table of calibrations."""
    return _KEY.to_text((service, program))


def substitutions_changed(table: msg.Substitutions) -> SubstitutionsChanged:
    """Return the event of a message on shsa/substitutions, with what the monitor heeds of rows."""
    rows = tuple(map(_seen_by_monitor, table.substitutions))
    return SubstitutionsChanged(clock.now(), rows, tuple(table.removed), table.whole)


def _seen_by_monitor(row: msg.Substitution) -> Substitution:
    """Return of a row what the monitor heeds: what else changes in it is no change there."""
    return Substitution(
        row.node,
        row.service,
        (),
        "",
        tuple(Signal(each.topic, each.field, "", "", None, None) for each in row.outputs),
        quality=row.quality,
        publishing=row.publishing,
        bridge=row.bridge,
        gated=row.gated,
        shared=row.shared,
    )


def formerly_healthy(table: msg.SomState) -> FormerlyHealthy:
    """Return who did well, as the reconfigurator's running SOM says."""
    keys = tuple((row.topic, node) for row in table.services for node in row.healthy)
    return FormerlyHealthy(clock.now(), keys)
