"""Messages of healing, as facts of the view."""
import math
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rospy import Time
from shsa_core.errors import ShsaError
from shsa_core.healing.incident import State
from shsa_core.model.error import Error
from shsa_msgs import msg
from shsa_view import facts
from shsa_view.ros import wire

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR


def diagnostics(sender: str, name: str, level: int = OK, **values: str) -> DiagnosticArray:
    """Return a message with one row, from a node."""
    pairs = [KeyValue(key.replace("__", "/"), value) for key, value in values.items()]
    row = DiagnosticStatus(level=level, name=name, message="text", values=pairs)
    message = DiagnosticArray(status=[row])
    message._connection_header = {"callerid": sender}
    return message


def test_a_table_of_health() -> None:
    row = msg.PublisherHealth(topic="/t", publisher="/n", state="failed", kind="silent")
    row.detail, row.last_good = "a\nb", Time(5)
    message = msg.Health(publishers=[row], removed=["/t /other", "/u "], whole=False)
    told = wire.health(message, "pi")
    assert told.rows == (facts.Publisher("/t", "/n", "failed", "silent", "a\\nb", 5.0),)
    assert told.removed == (("/t", "/other"), ("/u", ""))
    assert (told.monitor, told.whole) == ("pi", False)


def test_a_table_of_substitutions() -> None:
    output = msg.Signal(topic="/t", field="a.b", error_rms=0.5, error_p95=math.nan)
    row = msg.Substitution(node="/s", service="x", outputs=[output], code="t0=x[0]\ny=t0")
    (told,) = wire.substitutes(msg.Substitutions(substitutions=[row])).rows
    assert (told.outputs, told.code) == (("/t/a/b",), "t0=x[0]\ny=t0")
    assert (told.error_rms, told.error_p95) == ((0.5,), (None,))


def test_a_running_som() -> None:
    row = msg.ServiceState(service="x", topic="/t", node="/n", period=0.1, needed=True)
    told = wire.services(msg.SomState(services=[row], removed=["y"]))
    assert told == facts.ServicesTold(
        (facts.Running("x", "/t", "/n", 0.1, True, False),), ("y",), False
    )


def test_an_incident_is_the_one_that_was_told() -> None:
    message = msg.Incident(id=3, service="ammeter", state="healed", kind="silent")
    message.detected, message.error_rms, message.error_p95 = Time(100), [0.5], [math.nan]
    told = wire.incident(message).incident
    assert (told.id, told.service, told.state) == (3, "ammeter", State.HEALED)
    assert (told.detected, told.first_message, told.errors) == (100.0, None, (Error(0.5),))
    with pytest.raises(ShsaError):
        wire.incident(msg.Incident(state="nonsense", detected=Time(1)))


def test_rates_and_values_are_read_from_diagnostics() -> None:
    told: Any = {"topic": "/t", "__n": "healthy, 49.8 Hz, last good message 0.01 s ago"}
    values: Any = {"current": "2.5", "broken": "nan", "text": "a", "times bridged": "3"}
    message = diagnostics("/monitor", "monitor: x", **told, **values)
    reader = wire.Diagnostics("/")
    assert reader.sender(message) == "monitor"
    (figures,) = reader.facts(message)
    row = facts.Figures("x", {"/n": 49.8}, {"current": 2.5}, 3)
    assert figures == facts.FiguresTold((row,))


@pytest.mark.parametrize(
    ("name", "level", "fact"),
    [
        ("ROS master", OK, facts.Healer("master", "alive")),
        ("ROS master", ERROR, facts.Healer("master", "lost", "ROS master: text")),
        ("maintenance", OK, facts.MaintenanceTold(False)),
        ("maintenance", WARN, facts.MaintenanceTold(True)),
        ("host pi", OK, facts.HostTold("pi", "heard", "text")),
        ("host pi", WARN, facts.HostTold("pi", "unknown", "text")),
        ("host pi", ERROR, facts.HostTold("pi", "lost", "text")),
    ],
)
def test_the_reconfigurator_tells_of_master_and_hosts(name: str, level: int, fact: Any) -> None:
    message = diagnostics("/robot1/reconfigurator", f"robot1/reconfigurator: {name}", level)
    reader = wire.Diagnostics("/robot1/")
    assert reader.sender(message) == "reconfigurator"
    assert reader.facts(message) == [fact]


@pytest.mark.parametrize("also, duties", [({"its node also": "takes /x"}, "takes /x"), ({}, "")])
def test_the_reconfigurator_tells_of_duties(also: Any, duties: str) -> None:
    message = diagnostics("/reconfigurator", "reconfigurator: odometry", topic="/odom", **also)
    assert wire.Diagnostics("/").facts(message) == [facts.DutiesTold("odometry", duties)]


def test_other_robots_and_other_nodes_rows_are_not_ours() -> None:
    reader = wire.Diagnostics("/robot1/")
    assert reader.sender(diagnostics("/robot2/monitor", "robot2/monitor: x")) == ""
    foreign = diagnostics("/robot1/monitor", "robot2/monitor: x", __n="1.0 Hz")
    assert reader.facts(foreign) == [facts.FiguresTold(())]
