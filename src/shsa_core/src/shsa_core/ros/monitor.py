"""The monitor: watches every topic of the SOM, per publisher, and triggers on /shsa/failures.

How a deadline is kept honest when the monitor itself was not scheduled: one thread reads the sockets and judges, and
it reads everything that has come before it judges anybody. When it woke later than it wanted to, the machine is busy
and the publishers may be late as well: everybody is granted as much time as it was late, twice the deadline at most.
How long a message may have waited in its socket is known, and rates and stamps are judged in the publisher's favour.
"""
import math
import threading
from typing import Any, Callable, Dict, List, Optional

import rospy
from shsa_msgs import msg
from std_msgs.msg import Header

from shsa_core.errors import ShsaError
from shsa_core.monitoring.events import (
    Connected,
    Disconnected,
    FailureDetected,
    HealthChanged,
    HealthEvent,
    Late,
    Message,
    SomChanged,
    SubstitutionsChanged,
    Tick,
)
from shsa_core.monitoring.evidence import TopicChecks
from shsa_core.monitoring.machine import HealthMonitor, Settings
from shsa_core.model.som import Som
from shsa_core.ros import diagnostics
from shsa_core.ros.graph import clock, connections
from shsa_core.ros.graph.connections import Arrived, Closed, Connection, Connections, Happening, Made
from shsa_core.ros.graph.inbox import Inbox
from shsa_core.ros.graph.messages import Decoder, stamp
from shsa_core.ros.node import run
from shsa_core.ros.graph.som_parameter import SOM_PARAMETER, SomWatch

LONGEST_WAIT = 0.1
"""s; how long a message has waited is known to this at worst, as long as the monitor is scheduled."""
TOGETHER = 0.002
"""s; what comes within this time is handled together."""
REPORT = object()


class Reader:
    """Makes events of the messages of one topic; they are decoded only as far as they are checked."""

    def __init__(self, checks: TopicChecks) -> None:
        self.checks = checks
        self._fields = [service.field for service in checks.services]
        self._of_values, self._of_stamps = checks.of_values, checks.of_stamps
        self._decoders: Dict[Connection, Optional[Decoder]] = {}

    def event(self, time: float, waited: float, connection: Connection, data: bytes) -> Message:
        """The event that a message makes."""
        topic, publisher = connection.topic, connection.publisher
        decoder = None
        if self._of_values or self._of_stamps:
            if connection not in self._decoders:
                self._decoders[connection] = self._decoder(connection)
            decoder = self._decoders[connection]
        if decoder is None:
            return Message(time, topic, publisher, waited=waited)
        values, error, age = None, "", None
        if self._of_values:
            try:
                values = decoder.values(data)
            except ShsaError as refusal:
                error = str(refusal)
        if self._of_stamps and decoder.has_stamp:
            stamped = stamp(data)
            age = None if stamped is None else rospy.get_time() - stamped
        return Message(time, topic, publisher, values, error, age, waited)

    def _decoder(self, connection: Connection) -> Optional[Decoder]:
        for gone in [known for known in self._decoders if known.transport.done]:
            del self._decoders[gone]
        try:
            return Decoder(connection.header, self._fields)
        except ShsaError as error:
            text = "%s: the messages of %s are not checked: %s"
            rospy.logwarn(text, connection.topic, connection.publisher, error)
            return None


class Monitor:
    """Feeds the core with what happens on the graph, and publishes what it finds."""

    def __init__(self) -> None:
        self._core = HealthMonitor(_settings())
        self._inbox = Inbox()
        self._connections = Connections(self._inbox)
        self._readers: Dict[str, Reader] = {}
        self._looked = clock.now()
        self._table: Optional[HealthChanged] = None
        self._failures = rospy.Publisher(
            "/shsa/failures", msg.Failure, queue_size=1000, tcp_nodelay=True
        )
        self._health = rospy.Publisher(
            "/shsa/health", msg.Health, queue_size=100, latch=True, tcp_nodelay=True
        )
        self._diagnostics = diagnostics.Diagnostics()
        rospy.Subscriber(
            "/shsa/substitutions", msg.Substitutions, self._substitutions, tcp_nodelay=True
        )
        SomWatch(Som(), lambda som: self._inbox.put(SomChanged(clock.now(), som)))
        threading.Thread(target=self._remind, name="remind", daemon=True).start()

    def spin(self) -> None:
        """Handle events until ROS shuts down."""
        while not rospy.is_shutdown():
            self._guarded(self._turn)

    def _turn(self) -> None:
        """Wait until there is something to do, read everything that has come, then judge."""
        wanted = min(self._core.next_deadline, clock.now() + LONGEST_WAIT)
        self._inbox.wait(wanted - clock.now())
        late = clock.now() - wanted
        rest = self._looked + TOGETHER - clock.now()
        if rest > 0.0:
            rospy.rostime.wallsleep(rest)
        before, looked = self._looked, clock.now()
        self._looked = looked
        ready = self._inbox.ready()
        for item in self._inbox.take():
            self._guarded(self._handle, item)
        for happening in self._connections.read(ready):
            self._guarded(self._happened, happening, before)
        if late > 0.0:
            self._feed(Late(looked, late))
        self._feed(Tick(looked))
        if self._table is not None:
            self._health.publish(_health_message(self._table))
            self._table = None

    def _guarded(self, handle: Callable[..., None], *what: Any) -> None:
        """Handle something; whatever goes wrong with it, the rest is still handled."""
        try:
            handle(*what)
        except Exception as error:
            if not rospy.core.is_shutdown_requested():
                rospy.logerr_throttle_identical(10.0, f"Monitor: {type(error).__name__}: {error}")

    def _handle(self, item: Any) -> None:
        if item is REPORT:
            self._report()
        elif isinstance(item, (Made, Closed)):
            for happening in self._connections.heed(item):
                self._happened(happening, self._looked)
        else:
            self._feed(item)
            if isinstance(item, SomChanged):
                self._watch(item.som)

    def _happened(self, happening: Happening, before: float) -> None:
        """Feed what happened at a connection at some time since `before`."""
        now = clock.now()
        if isinstance(happening, Arrived):
            connection, data = happening
            reader = self._readers[connection.topic]
            self._feed(reader.event(now, now - before, connection, data))
        elif isinstance(happening, connections.Connected):
            self._feed(Connected(now, *happening))
        else:
            self._feed(Disconnected(now, *happening))

    def _feed(self, event: HealthEvent) -> None:
        for output in self._core.handle(event):
            if isinstance(output, FailureDetected):
                self._failures.publish(_failure_message(output))
                rospy.logdebug("%s", _in_words(output))  # the reconfigurator tells people
            else:
                self._table = output

    def _watch(self, som: Som) -> None:
        """Subscribe new topics, end the subscriptions of those that left."""
        for name in [name for name in self._readers if name not in som.topics()]:
            del self._readers[name]
            self._connections.unsubscribe(name)
            rospy.loginfo("%s is no longer watched.", name)
        for name in som.topics():
            checks = TopicChecks(som.of_topic(name))
            if name not in self._readers:
                self._connections.subscribe(name)
                rospy.loginfo("%s is watched.", name)
            if name not in self._readers or self._readers[name].checks != checks:
                self._readers[name] = Reader(checks)

    def _substitutions(self, table: msg.Substitutions) -> None:
        rows = tuple(((row.topic, row.node), row.speaking) for row in table.substitutions)
        self._inbox.put(SubstitutionsChanged(clock.now(), rows))

    def _remind(self) -> None:
        while not rospy.is_shutdown():
            rospy.rostime.wallsleep(diagnostics.PERIOD)
            self._inbox.put(REPORT)

    def _report(self) -> None:
        if not self._readers:
            rospy.loginfo_throttle(10.0, f"Monitor: waiting for a SOM at {SOM_PARAMETER}.")
        self._diagnostics.show((self._core.table(), self._core.messages(), self._core.mute()))


def _settings() -> Settings:
    """The settings from the node's parameters; a bad one is named and its default kept."""
    values: Dict[str, Any] = {}
    for name in ("startup_grace", "deadline", "minimum_deadline"):
        value = rospy.get_param("~" + name, getattr(Settings, name))
        if not isinstance(value, (int, float)) or not math.isfinite(value) or value <= 0:
            rospy.logerr(
                "Refused: %s is %r, a number above 0 is needed; %g is used.",
                rospy.resolve_name("~" + name),
                value,
                getattr(Settings, name),
            )
        else:
            values[name] = float(value)
    return Settings(**values)


def _failure_message(failure: FailureDetected) -> msg.Failure:
    return msg.Failure(
        header=Header(stamp=clock.to_stamp(failure.time)),
        topic=failure.topic,
        publisher=failure.publisher,
        kind=failure.kind,
        detail=failure.detail,
        last_good=clock.to_stamp(failure.last_good),
    )


def _health_message(table: HealthChanged) -> msg.Health:
    rows: List[msg.PublisherHealth] = [
        msg.PublisherHealth(
            topic=row.topic,
            publisher=row.publisher,
            state=row.state,
            kind=row.kind,
            detail=row.detail,
            since=clock.to_stamp(row.since),
            first_message=clock.to_stamp(row.first_message),
            last_good=clock.to_stamp(row.last_good),
        )
        for row in table.publishers
    ]
    return msg.Health(header=Header(stamp=clock.to_stamp(table.time)), publishers=rows)


def _in_words(failure: FailureDetected) -> str:
    blamed = f"{failure.publisher} fails" if failure.publisher else "nobody publishes"
    return f"{failure.topic}: {blamed}, {failure.kind}: {failure.detail}."


def main() -> None:
    """Run the node `monitor`."""
    run("monitor", lambda: Monitor().spin())
