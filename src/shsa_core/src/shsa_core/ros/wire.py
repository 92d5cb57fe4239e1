"""Between the core's events and commands and the messages of shsa_msgs."""
from typing import Dict, Tuple

import rospy
from shsa_msgs import msg, srv
from std_msgs.msg import Header

from shsa_core.healing import events
from shsa_core.healing.incident import Incident
from shsa_core.healing.plans import TopicPlan
from shsa_core.ros.graph import clock

# Relative to the namespace in which healing runs.
FAILURES = "shsa/failures"
HEALTH = "shsa/health"
INCIDENTS = "shsa/incidents"
SOM_STATE = "shsa/som_state"
SOM_PARAMETER = "shsa/som"
FIND_SUBSTITUTE = "shsa/find_substitute"
RELEASE = "shsa/release"
RELOAD = "shsa/reload"
SUBSTITUTE_ACTION = "shsa/substitute"

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


def failure_seen(failure: msg.Failure) -> events.FailureSeen:
    """The event that a message on /shsa/failures tells of."""
    return events.FailureSeen(
        time=clock.from_stamp(failure.header.stamp) or clock.now(),
        topic=failure.topic,
        publisher=failure.publisher,
        kind=failure.kind,
        detail=failure.detail,
        last_good=clock.from_stamp(failure.last_good),
    )


def health_seen(health: msg.Health) -> events.HealthSeen:
    """The event that a message on /shsa/health tells of."""
    now = clock.now()
    return events.HealthSeen(
        time=now,
        made=clock.from_stamp(health.header.stamp) or now,
        publishers=tuple(
            events.PublisherHealth(
                topic=row.topic,
                publisher=row.publisher,
                state=row.state,
                since=clock.from_stamp(row.since) or 0.0,
                first_message=clock.from_stamp(row.first_message),
                last_good=clock.from_stamp(row.last_good),
                kind=row.kind,
                detail=row.detail,
            )
            for row in health.publishers
        ),
    )


def substitutions(rows: Tuple[events.Substitution, ...]) -> msg.Substitutions:
    """The table of running substitutes."""
    return msg.Substitutions(
        header=Header(stamp=rospy.Time.now()),
        substitutions=[
            msg.Substitution(
                node=row.node,
                topic=row.topic,
                inputs=list(row.program.inputs),
                code=row.program.code,
                outputs=list(row.program.outputs),
                relations=list(row.relations),
                quality=row.quality,
                speaking=row.speaking,
                original=row.original,
            )
            for row in rows
        ],
    )


def som_state(command: events.ShowSom) -> msg.SomState:
    """The running SOM."""
    services = command.som.services
    return msg.SomState(
        header=Header(stamp=rospy.Time.now()),
        services=[
            msg.ServiceState(
                property=services[state.index].property,
                topic=services[state.index].topic,
                field=services[state.index].field,
                type=services[state.index].type,
                node=state.node,
                period=services[state.index].period,
                quality=services[state.index].quality,
                needed=services[state.index].needed,
                available=state.available,
                detail=state.detail,
            )
            for state in command.states
        ],
    )


def incident(record: Incident) -> msg.Incident:
    """One step of an incident."""
    return msg.Incident(
        header=Header(stamp=rospy.Time.now()),
        id=record.id,
        topic=record.topic,
        properties=list(record.properties),
        faulty_node=record.faulty_node,
        kind=record.kind,
        detail=record.detail,
        state=record.state.value,
        substitute=record.substitute,
        inputs=list(record.inputs),
        code=record.code,
        outputs=list(record.outputs),
        relations=list(record.relations),
        quality=record.quality,
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


def found(plan: TopicPlan) -> srv.FindSubstituteResponse:
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


# The rows of /shsa/substitutions.
from shsa_core.ros.graph.rows import (  # noqa: E402,F401
    SUBSTITUTIONS,
    substitution_message,
    substitution_row,
)
