"""Shows rows on /diagnostics, once a second, for display; no decision reads them.

The rows are named after services, since an analyzer misses for ever what has been there once, and
after the full name of the node (`robot1/monitor: battery_current`): all robots share the topic.
"""
import queue
import threading
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, Callable, Dict, Iterable, List, Mapping, Optional, Tuple

import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from std_msgs.msg import Header

from shsa_core.healing.incident import Incident, State
from shsa_core.hosts.conversation import RemoteHost
from shsa_core.model.health import Key, PublisherHealth
from shsa_core.model.service import Service
from shsa_core.monitoring.overview import Condition, ServiceHealth
from shsa_core.monitoring.settings import AGE_LEAST_S
from shsa_core.ros import clock, settings
from shsa_core.ros.master.master_watch import MasterWatch
from shsa_core.ros.node import publish
from shsa_core.ros.processes.watching import Companion
from shsa_core.ros.trust.signing import Signing
from shsa_core.ros.workers import guarded
from shsa_core.text import shown
from shsa_core.trust.boots import Met

BRIDGED, DUTIES, WEAKENED = "times bridged", "its node also", "allows more than the SOM file"
"""Keys of a service's row: late messages filled in for, duties, what live parameters allow."""
MAINTENANCE = "maintenance"
OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
CONDITIONS = {Condition.HEALTHY: OK, Condition.LOST: ERROR}
"""In any other condition a service is to be watched."""
HEALINGS = {State.WELL: OK, State.RETURNING: OK, State.HEALING: WARN, State.HEALED: WARN}
"""In any other state the service is not healed."""


@dataclass
class Diagnostics:
    """Shows what it is given from a thread of its own: whoever gives something never waits.

    `ask` has somebody `show` something, once a second; `rows` makes statuses of it. More rows count
    what `signing` refused, and tell of the other healer and of each other computer.
    """

    _ask: Callable[[], object]
    _rows: Callable[[Any], List[DiagnosticStatus]]
    _signing: Signing
    _companion: Companion

    def __post_init__(self) -> None:
        self._given: "queue.Queue[Any]" = queue.Queue()
        self._publisher = rospy.Publisher("/diagnostics", DiagnosticArray, queue_size=2)
        threading.Thread(target=self._run, name="diagnostics", daemon=True).start()

    def show(self, given: Any) -> None:
        """Publish it soon."""
        self._given.put(given)

    def _run(self) -> None:
        while not rospy.is_shutdown():
            rospy.rostime.wallsleep(settings.LOOK_S)
            self._ask()
            with suppress(queue.Empty):  # who was asked could not show anything
                given = self._given.get(timeout=settings.ANSWER_S)
                while not self._given.empty():  # who was slow has answered more than once
                    given = self._given.get()
                guarded("Diagnostics", self._publish, given)

    def _publish(self, given: Any) -> None:
        rows = self._rows(given)
        rows.append(refused_row(self._signing.refusals.counts()))
        level = ERROR if self._companion.problem else OK
        rows.append(_row(self._companion.role, level, self._companion.told))
        rows += map(computer_row, self._signing.boots.seen())
        for row in rows:
            row.name = f"{rospy.get_name()[1:]}: {row.name}"
        publish(self._publisher, DiagnosticArray(Header(stamp=rospy.Time.now()), rows))


def _row(
    name: str, level: int, text: str, values: Iterable[Tuple[str, str]] = (), of: str = ""
) -> DiagnosticStatus:
    """Return a status without empty values; `of`: the node or the computer that it is about."""
    pairs = [KeyValue(shown(key), shown(value)) for key, value in values if value]
    return DiagnosticStatus(level, name, shown(text), of, pairs)


def computer_row(met: Met) -> DiagnosticStatus:
    """Return the row of another computer: how its wall clock differs from ours."""
    ahead, within = met.ahead / 1e9, met.round_trip / 2e9
    level = WARN if abs(ahead) - within > AGE_LEAST_S / 2 else OK
    text = f"its clock is {abs(ahead):.4f} s {'ahead' if ahead > 0.0 else 'behind'}"
    name = f"computer {met.host} at {met.address}"
    return _row(name, level, f"{text}, known within {within:.4f} s", of=met.host)


def refused_row(counts: List[Tuple[str, int]]) -> DiagnosticStatus:
    """Return the row of the messages that were refused since the start, of whom, and why."""
    total = sum(count for _, count in counts)
    values = [(what, str(count)) for what, count in [("in all", total), *counts]]
    return _row("refused messages", WARN if total else OK, str(total), values)


Rates = Dict[Key, float]
"""The messages/s of each publisher since the last look."""


class MonitorRows:
    """The monitor's rows: how each service is doing, each of its publishers, and its values.

    A value is under the name of its property, in the unit of that, and a publisher under its own.
    """

    def __init__(self) -> None:
        self._counts: Dict[Key, int] = {}
        self._shown = 0.0

    def __call__(self, services: Tuple[ServiceHealth, ...]) -> List[DiagnosticStatus]:
        counts = {row.key: n for each in services for row, n in each.publishers.items()}
        now = clock.now()
        elapsed, known = now - self._shown, counts.keys() & self._counts.keys()
        rates = {key: (counts[key] - self._counts[key]) / elapsed for key in known}
        self._counts, self._shown = counts, now
        return [self._row(each, rates, now) for each in services]

    def _row(self, health: ServiceHealth, rates: Rates, now: float) -> DiagnosticStatus:
        service, bridged = health.service, str(health.bridged or "")
        told = [("topic", service.topic)]
        told += [(p.publisher, self._publisher(p, rates, now)) for p in health.publishers]
        told += [("deadline", health.deadline), (BRIDGED, bridged), (WEAKENED, service.weakened)]
        text, level = health.detail, CONDITIONS.get(health.condition, WARN)
        if health.condition is not Condition.HEALTHY:
            text = f"{health.condition}: {text}"
        if service.weakened:
            text, level = f"{text}; {WEAKENED}: {service.weakened}", max(level, WARN)
        told += [(name, f"{value:.9g}") for name, value in health.values.items()]
        return _row(service.name, level, text, told, service.node)

    def _publisher(self, row: PublisherHealth, rates: Rates, now: float) -> str:
        told = [str(each) for each in (row.state, row.kind, row.detail) if each]
        if row.key in rates:
            told.append(f"{rates[row.key]:.1f} Hz")
        if row.last_good is not None:
            told.append(f"last good message {now - row.last_good:.2f} s ago")
        return ", ".join(told)


Duties = Mapping[str, Tuple[str, ...]]
Healing = Tuple[
    Iterable[Service], Mapping[str, Incident], MasterWatch, Iterable[RemoteHost], Duties, bool
]
"""Needed services, open incidents, how master and computers do, what nodes do beyond the SOM,
and whether the robot is maintained.
"""


def healing_rows(given: Healing) -> List[DiagnosticStatus]:
    """The reconfigurator's rows: needed services and their incidents, the master, the computers."""
    services, incidents, master, hosts, duties, maintained = given
    rows = [_healing_row(each, incidents.get(each.name), duties) for each in services]
    told = (WARN, "on: nothing is killed or started") if maintained else (OK, "off")
    return [*rows, _row(MAINTENANCE, *told), _master_row(master), *map(_host_row, hosts)]


def _host_row(host: RemoteHost) -> DiagnosticStatus:
    name, seen = f"host {host.name}", host.seen
    if seen is None:
        return _row(name, WARN, "its agent was not heard yet")
    if not host.is_reached:
        return _row(name, ERROR, f"it cannot be reached, for {host.silence:.1f} s")
    values = {"sent": f"{seen.sent:.0f} bytes/s", "received": f"{seen.received:.0f} bytes/s"}
    text = f"{seen.load:.1f} of {seen.cores:g} cores are busy"
    return _row(name, OK, text, values.items())


def _master_row(master: MasterWatch) -> DiagnosticStatus:
    level, text = OK, "it answers"
    if not master.answers:
        level, text = ERROR, "it does not answer; healing goes on, but no new node can come"
    elif master.hung:
        level, text = WARN, "subscribers do not answer, and it waits for them"
    values = [("hung", node) for node in master.hung]
    kept, age = sum(map(len, master.known.parts.values())), clock.now() - master.kept_at
    values.append(("kept", f"{kept} registrations, {age:.1f} s ago"))
    return _row("ROS master", level, text, values)


def _healing_row(service: Service, incident: Optional[Incident], also: Duties) -> DiagnosticStatus:
    told = {"topic": service.topic, DUTIES: " and ".join(also.get(service.node, ()))}
    if incident is None:
        return _row(service.name, OK, "well", told.items(), service.node)
    errors = zip(incident.outputs, incident.errors)
    told["faulty node"] = incident.faulty_node
    told["kind"] = str(incident.kind)
    told["substitute"] = incident.substitute
    told["by"] = ", ".join(incident.relations)
    told["missing"] = ", ".join(incident.missing)
    told["stated error"] = ", ".join(f"{path} {error.rms:.3g}" for path, error in errors if error)
    told["kept out"] = "yes" if incident.kept_out else ""
    level, text = HEALINGS.get(incident.state, ERROR), f"{incident.state}: {incident.detail}"
    return _row(service.name, level, text, told.items(), service.node)
