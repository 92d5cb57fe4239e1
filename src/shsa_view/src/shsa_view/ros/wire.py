"""Between messages of healing and the facts that the view heeds."""
import math
import re
from typing import Dict, List, Optional, Sequence, Tuple

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rospy import Time
from shsa_msgs import msg

from shsa_learning.incident_log import of_message
from shsa_core.model.names import full_name
from shsa_core.model.service import signal_path
from shsa_core.ros.diagnostics import MAINTENANCE
from shsa_core.text import shown
from shsa_view import facts
from shsa_view.plain import code

RATE = re.compile(r"(?:^|, )([0-9.]+) Hz(?:,|$)")
MASTER_ROW, HOST_ROW = "ROS master", "host "
BRIDGED, DUTIES = "times bridged", "its node also"
LEVELS = {DiagnosticStatus.OK: "heard", DiagnosticStatus.ERROR: "lost"}


def health(message: msg.Health, monitor: str) -> facts.HealthTold:
    """Return the table of health, or its changes."""
    pairs = [each.partition(" ") for each in message.removed]
    removed = tuple((topic, publisher) for topic, _, publisher in pairs)
    rows = tuple(map(_publisher, message.publishers))
    return facts.HealthTold(monitor, rows, removed, message.whole)


def _publisher(row: msg.PublisherHealth) -> facts.Publisher:
    whom = shown(row.topic), shown(row.publisher)
    return facts.Publisher(
        *whom, shown(row.state), shown(row.kind), shown(row.detail), _moment(row.last_good)
    )


def services(message: msg.SomState) -> facts.ServicesTold:
    """Return the running SOM, or its changes."""
    rows = tuple(map(_running, message.services))
    return facts.ServicesTold(rows, tuple(message.removed), message.whole)


def _running(row: msg.ServiceState) -> facts.Running:
    names = shown(row.service), shown(row.topic), shown(row.node)
    return facts.Running(*names, row.period, row.needed, row.available, shown(row.detail))


def substitutes(message: msg.Substitutions) -> facts.SubstitutesTold:
    """Return the table of substitutions, or its changes."""
    rows = tuple(map(_substitute, message.substitutions))
    return facts.SubstitutesTold(rows, tuple(message.removed), message.whole)


def _substitute(row: msg.Substitution) -> facts.Substitute:
    return facts.Substitute(
        node=shown(row.node),
        service=shown(row.service),
        publishing=row.publishing,
        inputs=_paths(row.inputs),
        outputs=_paths(row.outputs),
        relations=tuple(map(shown, row.relations)),
        code=code(row.code),
        quality=_known(row.quality) or 0.0,
        host=shown(row.host),
        error_rms=tuple(_known(each.error_rms) for each in row.outputs),
        error_p95=tuple(_known(each.error_p95) for each in row.outputs),
        shared=row.shared,
    )


def _paths(signals: Sequence[msg.Signal]) -> Tuple[str, ...]:
    return tuple(shown(signal_path(each.topic, each.field)) for each in signals)


def incident(message: msg.Incident) -> facts.IncidentTold:
    """Return a step of an incident. Raises ShsaError if it is none."""
    return facts.IncidentTold(of_message(message))


def _moment(stamp: Time) -> Optional[float]:
    return None if stamp.is_zero() else float(stamp.to_sec())


def _known(number: float) -> Optional[float]:
    return number if math.isfinite(number) else None


class Diagnostics:
    """Reads /diagnostics: the rows of the healing in our namespace, if their node sent them."""

    def __init__(self, namespace: str) -> None:
        self._prefix = namespace[1:]

    def sender(self, message: DiagnosticArray) -> str:
        """Return the healer that sent a message, as `monitor`; empty: none of ours."""
        name = str(message._connection_header.get("callerid", ""))[1:]
        return name[len(self._prefix) :] if name.startswith(self._prefix) else ""

    def facts(self, message: DiagnosticArray) -> List[facts.Fact]:
        """Return the facts about services, hosts and the master in a message of `sender`."""
        rows = self._rows(message)
        if self.sender(message) != "reconfigurator":
            return [facts.FiguresTold(tuple(_figures(name, row) for name, row in rows.items()))]
        found: List[facts.Fact] = []
        for name, row in rows.items():
            if name == MASTER_ROW:
                state = "lost" if row.level == DiagnosticStatus.ERROR else "alive"
                text = "" if row.level == DiagnosticStatus.OK else f"ROS master: {row.message}"
                found.append(facts.Healer("master", state, shown(text)))
            elif name == MAINTENANCE:
                found.append(facts.MaintenanceTold(row.level != DiagnosticStatus.OK))
            elif name.startswith(HOST_ROW):
                state = LEVELS.get(row.level, "unknown")
                host = shown(name[len(HOST_ROW) :])
                found.append(facts.HostTold(host, state, shown(row.message)))
            elif any(each.key == "topic" for each in row.values):
                duties = next((each.value for each in row.values if each.key == DUTIES), "")
                found.append(facts.DutiesTold(shown(name), shown(duties)))
        return found

    def _rows(self, message: DiagnosticArray) -> Dict[str, DiagnosticStatus]:
        """Return the rows by what they are about, of the node that sent them."""
        prefix = str(message._connection_header.get("callerid", ""))[1:] + ": "
        return {
            row.name[len(prefix) :]: row for row in message.status if row.name.startswith(prefix)
        }


def _figures(name: str, row: DiagnosticStatus) -> facts.Figures:
    """Return the rate of each publisher, whose key is a node's name; the value of each property."""
    rates: Dict[str, float] = {}
    values: Dict[str, float] = {}
    for pair in row.values:
        if pair.key.startswith("/"):
            found = RATE.search(pair.value)
            rate = _float(found.group(1)) if found else None
            if rate is not None:
                rates[full_name(pair.key, "/")] = rate
        elif pair.key != "topic":
            value = _float(pair.value)
            if value is not None:
                values[pair.key] = value
    bridged = int(values.pop(BRIDGED, 0.0))
    return facts.Figures(name, rates, values, bridged)


def _float(text: str) -> Optional[float]:
    try:
        return _known(float(text))
    except ValueError:
        return None
