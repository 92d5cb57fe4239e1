"""Sizes of the messages that the reconfigurator's commands send, in bytes."""
from io import BytesIO
from typing import Iterable

import rospy
from shsa_msgs import msg
from std_msgs.msg import Header

from shsa_core.healing import events
from shsa_core.ros.wire import healing as wire
from shsa_core.ros.wire.rows import substitution_message

rospy.rostime.set_rostime_initialized(True)  # there is no node here that would wait for /clock


def bytes_of(commands: Iterable[events.Command]) -> int:
    """Return the length of all messages together, each sent to one subscriber."""
    return sum(_length(command) for command in commands)


def _length(command: events.Command) -> int:
    header = Header(stamp=rospy.Time.now())
    if isinstance(command, events.ShowSubstitutions):
        rows = [substitution_message(row) for row in command.rows]
        message = msg.Substitutions(
            header=header, substitutions=rows, removed=list(command.removed)
        )
    elif isinstance(command, events.ShowSom):
        states = [wire.service_state(row) for row in command.rows]
        message = msg.SomState(header=header, services=states, removed=list(command.removed))
    elif isinstance(command, events.ShowIncident):
        message = wire.incident(command.incident)
    else:
        return 0
    buffer = BytesIO()
    message.serialize(buffer)
    return len(buffer.getvalue())
