"""Between the monitor's events and commands and the messages of shsa_msgs."""
from typing import Tuple

from shsa_msgs import msg
from std_msgs.msg import Header

from shsa_core.model.service import Signal
from shsa_core.model.substitution import Substitution
from shsa_core.monitoring.events import (
    FailureDetected,
    Key,
    PublisherHealth,
    SubstitutionsChanged,
)
from shsa_core.ros.graph import clock


def failure_message(failure: FailureDetected) -> msg.Failure:
    """The trigger on shsa/failures."""
    return msg.Failure(
        header=Header(stamp=clock.to_stamp(failure.time)),
        service=failure.service,
        topic=failure.topic,
        publisher=failure.publisher,
        kind=failure.kind.value,
        detail=failure.detail,
        last_good=clock.to_stamp(failure.last_good),
    )


def health_row(row: PublisherHealth) -> msg.PublisherHealth:
    """A row of the table of health."""
    return msg.PublisherHealth(
        topic=row.topic,
        publisher=row.publisher,
        state=row.state.value,
        kind=row.kind.value if row.kind else "",
        detail=row.detail,
        since=clock.to_stamp(row.since),
        first_message=clock.to_stamp(row.first_message),
        last_good=clock.to_stamp(row.last_good),
    )


def health_key(key: Key) -> str:
    """The key of a row of the table of health."""
    return f"{key[0]} {key[1]}"


def health_row_key(row: msg.PublisherHealth) -> str:
    """The key of a row of the table of health."""
    return health_key((row.topic, row.publisher))


def substitutions_changed(table: msg.Substitutions) -> SubstitutionsChanged:
    """The event of a message on shsa/substitutions, as far as it concerns the monitor."""
    rows = tuple(_substitution(row) for row in table.substitutions)
    return SubstitutionsChanged(clock.now(), rows, tuple(table.removed), table.whole)


def _substitution(row: msg.Substitution) -> Substitution:
    topics: Tuple[str, ...] = tuple(dict.fromkeys(signal.topic for signal in row.outputs))
    outputs = tuple(Signal(topic, "", "", "", None, None) for topic in topics)
    return Substitution(row.node, row.service, (), "", outputs, publishing=row.publishing)
