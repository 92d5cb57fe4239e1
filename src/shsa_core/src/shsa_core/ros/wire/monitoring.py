"""Between the monitor's events and commands and the messages of shsa_msgs."""
import json

import rospy
from shsa_msgs import msg
from std_msgs.msg import Header

from shsa_core.model.service import Signal
from shsa_core.model.substitution import Program, Substitution
from shsa_core.monitoring.events import (
    CalibrationRow,
    FormerlyHealthy,
    Key,
    PublisherHealth,
    SubstitutionsChanged,
)
from shsa_core.ros import clock
from shsa_core.ros.wire.rows import filled


def failure_message(row: PublisherHealth) -> msg.Failure:
    """Return what is told on shsa/failures: all that the row says. Either may be heard first."""
    stamps = {"told": rospy.Time.now(), "last_good": clock.to_stamp(row.last_good)}
    header, kind = Header(stamp=clock.to_stamp(row.since)), row.kind or ""
    return filled(msg.Failure, row, header=header, kind=str(kind), **stamps)


def health_row(row: PublisherHealth) -> msg.PublisherHealth:
    """Return a row of the table of health."""
    moments = {"since": row.since, "first_message": row.first_message, "last_good": row.last_good}
    stamps = {name: clock.to_stamp(moment) for name, moment in moments.items()}
    return filled(msg.PublisherHealth, row, kind=str(row.kind or ""), **stamps)


def health_key(key: Key) -> str:
    """Return the key of a row of the table of health."""
    return f"{key[0]} {key[1]}"


def health_row_key(row: msg.PublisherHealth) -> str:
    """Return the key of a row of that table."""
    return health_key((row.topic, row.publisher))


def calibration_row(row: CalibrationRow) -> msg.Calibration:
    """Return a row of the table of calibrations; 0 stands for what is not known of an error."""
    errors = [each.error for each in row.calibrations]
    return filled(
        msg.Calibration,
        row.program,
        service=row.service,
        gains=[each.gain for each in row.calibrations],
        offsets=[each.offset for each in row.calibrations],
        rms=[each.rms if each else 0.0 for each in errors],
        biases=[each.bias if each else 0.0 for each in errors],
        p95=[(each.p95 or 0.0) if each else 0.0 for each in errors],
        samples=[(each.n or 0) if each else 0 for each in errors],
    )


def calibration_key(service: str, program: Program) -> str:
    """Return the key of a row of the table of calibrations."""
    return json.dumps([service, program.inputs, program.code, program.outputs])


def calibration_row_key(row: msg.Calibration) -> str:
    """Return the key of a row of the table of calibrations."""
    program = Program(tuple(row.inputs), row.code, tuple(row.outputs))
    return calibration_key(row.service, program)


def substitutions_changed(table: msg.Substitutions) -> SubstitutionsChanged:
    """Return the event of a message on shsa/substitutions, as far as it concerns the monitor."""
    rows = tuple(_substitution(row) for row in table.substitutions)
    return SubstitutionsChanged(clock.now(), rows, tuple(table.removed), table.whole)


def formerly_healthy(table: msg.SomState) -> FormerlyHealthy:
    """Return who did well, as the reconfigurator's running SOM says."""
    keys = tuple((row.topic, node) for row in table.services for node in row.healthy)
    return FormerlyHealthy(clock.now(), keys)


def _substitution(row: msg.Substitution) -> Substitution:
    outputs = tuple(Signal(each.topic, each.field, "", "", None, None) for each in row.outputs)
    return Substitution(
        row.node,
        row.service,
        (),
        "",
        outputs,
        quality=row.quality,
        publishing=row.publishing,
        bridge=row.bridge,
        gated=row.gated,
        shared=row.shared,
    )
