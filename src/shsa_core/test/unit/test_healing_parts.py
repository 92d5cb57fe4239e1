"""A service of which not all values can be computed is healed in part, if its message says so."""
from dataclasses import replace

from core_robot import A, B, C, Robot, function, last_incident, only, service
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Standby
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som

ONTOLOGY = Ontology(
    properties={name: Property(name) for name in "abcd"},
    constants={},
    functions=[function("good", "a", "b + 1", 0.9), function("other", "d", "2 * c", 0.5)],
)
VALUES = (
    Provision("a", "percentage", unknown_with="percentage"),
    Provision("d", "voltage", unknown_with="voltage"),
)
BATTERY = Service("a", "/a", "sensor_msgs/BatteryState", A, 0.02, VALUES, needed=True)
SOM = Som([BATTERY, service("b", B), service("c", C)])
WHOLE = ("/a/percentage", "/a/voltage")


def without_c(battery: Service = BATTERY) -> Robot:
    """Return a robot of which the voltage cannot be computed."""
    robot = Robot(Som([battery, *list(SOM)[1:]]), ONTOLOGY)
    robot.fail("/c", C, 5.0)
    robot.table(5.1)
    robot.idle(5.1)
    return robot


def test_what_can_be_computed_is_published_until_all_can_be() -> None:
    robot = without_c()
    node = robot.heal(10.0)
    incident = last_incident(robot.said)
    assert (incident.state, incident.outputs) == (State.HEALED, ("/a/percentage",))
    assert incident.missing == ("c",)
    assert any("d is left unknown, missing c" in str(each) for each in robot.said)
    robot.row("/c", C, "healthy", 12.0)
    robot.table(12.1)
    (row,) = robot.working()
    assert row.node == node and row.publishing
    assert tuple(each.path for each in row.outputs) == WHOLE
    assert last_incident(robot.said).missing == ()


def test_all_values_are_published_where_they_can_be() -> None:
    robot = Robot(SOM, ONTOLOGY)
    robot.heal(10.0)
    assert last_incident(robot.said).outputs == WHOLE


def test_no_node_is_killed_for_a_substitute_of_a_part() -> None:
    robot = without_c()
    robot.fail("/a", A, 10.0, "out_of_range")
    incident = last_incident(robot.said)
    assert incident.state is State.KEPT and "nothing can replace /a" in incident.decision
    assert "d is left unknown" in incident.detail
    robot = Robot(SOM, ONTOLOGY)
    robot.fail("/a", A, 10.0, "out_of_range")
    assert only(robot.said, events.FindNode).node == A


def test_a_part_fills_in_for_no_late_message() -> None:
    hot = replace(BATTERY, standby=Standby.HOT)
    (row,) = without_c(hot).working()
    assert (row.publishing, row.bridge) == (False, 0.0)
    (row,) = Robot(Som([hot, *list(SOM)[1:]]), ONTOLOGY).working()
    assert row.bridge > 0.0
