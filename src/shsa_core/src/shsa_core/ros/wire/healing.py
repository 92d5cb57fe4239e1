"""Between the reconfigurator's events and commands and the messages of shsa_msgs."""
from typing import Dict, Optional, Tuple

import rospy
from shsa_msgs import msg, srv
from std_msgs.msg import Header

from shsa_core.codegen.plans import Plan
from shsa_core.errors import ShsaError
from shsa_core.healing import events
from shsa_core.healing.incident import Incident
from shsa_core.model.kinds import Kind
from shsa_core.monitoring.events import PublisherHealth, PublisherState
from shsa_core.ros.graph import clock

MOMENTS = (
    "last_good",
    "detected",
    "killed",
    "found",
    "spawned",
    "first_message",
    "returned",
    "ended",
)
LONGEST_TEXT = 1000


def failure_seen(failure: msg.Failure) -> events.FailureSeen:
    """The event that a message on /shsa/failures tells of. Raises ShsaError if it is none.

    A sender whose clock is ahead must not set ours: what it tells of has happened by now.
    """
    now = clock.now()
    return events.FailureSeen(
        time=min(now, clock.from_stamp(failure.header.stamp) or now),
        service=failure.service,
        topic=failure.topic,
        publisher=failure.publisher,
        kind=_kind(failure.kind) or Kind.OTHER,
        detail=_plain(failure.detail),
        last_good=clock.from_stamp(failure.last_good),
    )


def health_seen(health: msg.Health) -> events.HealthSeen:
    """The event that a message on /shsa/health tells of. Raises ShsaError if it is none."""
    return events.HealthSeen(
        time=clock.now(),
        rows=tuple(_publisher_health(row) for row in health.publishers),
        removed=tuple(_key(key) for key in health.removed),
        whole=health.whole,
    )


def _publisher_health(row: msg.PublisherHealth) -> PublisherHealth:
    try:
        state = PublisherState(row.state)
    except ValueError as error:
        allowed = ", ".join(each.value for each in PublisherState)
        text = f"{row.topic}: the state {row.state!r} is none of {allowed}"
        raise ShsaError(text) from error
    return PublisherHealth(
        topic=row.topic,
        publisher=row.publisher,
        state=state,
        since=clock.from_stamp(row.since) or 0.0,
        first_message=clock.from_stamp(row.first_message),
        last_good=clock.from_stamp(row.last_good),
        kind=_kind(row.kind),
        detail=_plain(row.detail),
    )


def _key(text: str) -> Tuple[str, str]:
    topic, _, publisher = text.partition(" ")
    return topic, publisher


def _kind(text: str) -> Optional[Kind]:
    """The kind of failure; None for none. Raises ShsaError."""
    try:
        return Kind(text) if text else None
    except ValueError as error:
        allowed = ", ".join(each.value for each in Kind)
        raise ShsaError(f"the kind of failure {text!r} is none of {allowed}") from error


def _plain(text: str) -> str:
    """A text from outside as it may reach a terminal or a log: printable, and not endless."""
    return "".join(c if c.isprintable() else " " for c in text[:LONGEST_TEXT])


def service_state(state: events.ServiceState) -> msg.ServiceState:
    """A row of the running SOM."""
    service = state.service
    return msg.ServiceState(
        service=service.name,
        topic=service.topic,
        type=service.type,
        node=state.node,
        period=service.period or 0.0,
        needed=service.needed,
        available=state.available,
        detail=state.detail,
        properties=list(service.properties),
        fields=[provision.field for provision in service.provides],
        qualities=[provision.quality for provision in service.provides],
    )


def incident(record: Incident) -> msg.Incident:
    """One step of an incident."""
    return msg.Incident(
        header=Header(stamp=rospy.Time.now()),
        id=record.id,
        service=record.service,
        topic=record.topic,
        properties=list(record.properties),
        faulty_node=record.faulty_node,
        kind=record.kind.value,
        detail=record.detail,
        state=record.state.value,
        substitute=record.substitute,
        inputs=list(record.inputs),
        code=record.code,
        outputs=list(record.outputs),
        relations=list(record.relations),
        quality=record.quality or 0.0,
        missing=list(record.missing),
        restarts=record.restarts,
        kept_out=record.kept_out,
        **{name: clock.to_stamp(getattr(record, name)) for name in MOMENTS},
    )


def incident_record(record: Incident) -> Dict[str, object]:
    """An incident as plain values for the log; its moments in s of ROS time."""
    plain = record.as_dict()
    for name in MOMENTS:
        moment = getattr(record, name)
        plain[name] = None if moment is None else round(clock.to_stamp(moment).to_sec(), 6)
    return plain


def found(plan: Plan) -> srv.FindSubstituteResponse:
    """The answer that `plan` would be carried out."""
    using = ", ".join(plan.relations) or "the same property elsewhere"
    return srv.FindSubstituteResponse(
        found=True,
        inputs=list(plan.program.inputs),
        code=plan.program.code,
        outputs=list(plan.program.outputs),
        relations=list(plan.relations),
        quality=plan.quality,
        proven_best=plan.proven_best,
        detail=f"quality {plan.quality:.2g}, by {using}",
    )
