"""Maintenance: nothing is killed or started, and what has failed is healed when it is over."""
from dataclasses import replace
from typing import List, Tuple

from core_robot import A, ONTOLOGY, SOM, Robot, has, last_incident, only, publishing, service
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.healing.machine import Reconfigurator
from shsa_core.healing.settings import ANSWER_S
from shsa_core.model.health import PublisherState
from shsa_core.model.kinds import Kind, Standby
from shsa_core.model.log import Level
from shsa_core.model.som import Som

ACTS = (
    *(events.FindNode, events.AskToLeave, events.EndProcess, events.RestartNode, events.StopNode),
    *(events.StartSubstitute, events.RunCommand),
)


def begin(robot: Robot, time: float) -> List[events.Command]:
    return robot.handle(events.MaintenanceSet(time, True))


def end(robot: Robot, time: float) -> List[events.Command]:
    """The maintenance ends; the monitor tells its table, and the moment passes for that."""
    commands = robot.handle(events.MaintenanceSet(time, False))
    assert only(commands, events.AskMonitor).host == ""
    assert robot.core.deadline == time + ANSWER_S
    return robot.table(time + 0.1) + robot.handle(events.Tick(time + ANSWER_S))


def acting(commands: List[events.Command]) -> Tuple[events.Command, ...]:
    return tuple(each for each in commands if isinstance(each, ACTS))


def fails(robot: Robot, time: float, node: str = A, topic: str = "/a") -> List[events.Command]:
    """The monitor's table tells that a node is gone."""
    robot.row(topic, node, "failed", time)
    return robot.table(time)


def test_a_node_that_dies_in_maintenance_is_healed_when_it_is_over() -> None:
    robot = Robot()
    begin(robot, 10.0)
    assert fails(robot, 11.0) == []
    assert robot.failure("/a", A, 11.1, "node_gone", "it died", 10.9) == []
    for time in (12.0, 100.0, 1000.0):
        assert robot.handle(events.Tick(time)) == []
    assert not robot.core.plans_ahead and robot.core.incident("a") is None
    commands = end(robot, 2000.0)
    assert last_incident(commands).faulty_node == A
    assert has(commands, events.StartSubstitute)


def test_a_node_that_is_back_before_the_end_has_not_failed() -> None:
    robot = Robot()
    begin(robot, 10.0)
    fails(robot, 11.0)
    robot.back(20.0)
    assert not acting(end(robot, 30.0)) and robot.core.incident("a") is None
    assert has(fails(robot, 40.0), events.StartSubstitute)


def test_what_publishes_goes_on_and_is_still_when_people_bring_the_original_back() -> None:
    robot = Robot()
    substitute = robot.heal(10.0)
    assert publishing(robot) == (True,) and not robot.shown[substitute].yields
    begin(robot, 20.0)
    assert publishing(robot) == (True,) and robot.shown[substitute].yields
    assert robot.back(30.0) == []
    commands = end(robot, 40.0)
    assert not acting(commands) and publishing(robot) == (False,)
    incident = robot.core.incident("a")
    assert incident is not None and incident.state is State.RETURNING


def test_a_substitute_that_was_still_beside_the_original_has_not_failed() -> None:
    robot = Robot()
    substitute = robot.heal(10.0)
    begin(robot, 20.0)
    robot.row("/a", A, "healthy", 30.0)
    robot.rows["/a", substitute] = replace(
        robot.rows["/a", substitute], state=PublisherState.FAILED, since=31.0, kind=Kind.SILENT
    )
    commands = end(robot, 40.0)
    assert not acting(commands) and publishing(robot) == (False,)
    assert not any(isinstance(c, events.Log) and c.level is Level.ERROR for c in commands)


def test_a_substitute_that_died_is_replaced_when_it_is_over() -> None:
    robot = Robot()
    substitute = robot.heal(10.0)
    begin(robot, 20.0)
    assert robot.handle(events.ProcessExited(21.0, substitute, "killed")) == []
    robot.rows.pop(("/a", substitute))
    assert only(end(robot, 30.0), events.StartSubstitute).node != substitute


def test_a_kill_that_is_under_way_goes_no_further() -> None:
    robot = Robot()
    robot.fail("/a", A, 10.0, "out_of_range")
    begin(robot, 10.01)
    assert robot.handle(events.NodeFound(10.02, A, events.Where.HERE, rate=0.0)) == []
    assert robot.handle(events.Tick(60.0)) == []
    end(robot, 70.0)
    assert any(has([each], events.AskToLeave) for each in robot.said)


def test_what_stands_by_fills_in_for_nobody() -> None:
    first, *others = SOM
    robot = Robot(Som([replace(first, standby=Standby.HOT, bridge=2.5), *others]))
    (row,) = robot.working()
    robot.handle(events.SubstituteStarted(2.0, row.node))
    assert robot.shown[row.node].bridge > 0.0
    begin(robot, 10.0)
    assert robot.shown[row.node].bridge == 0.0
    end(robot, 20.0)
    assert robot.shown[row.node].bridge > 0.0


def test_nothing_stands_by_anew_until_it_is_over() -> None:
    first, *others = SOM
    robot = Robot()
    begin(robot, 10.0)
    warm = Som([replace(first, standby=Standby.WARM), *others])
    assert robot.handle(events.SomChanged(11.0, warm, ONTOLOGY)) == []
    assert only(end(robot, 20.0), events.StartSubstitute).program is None


def test_models_that_were_exchanged_count_when_it_is_over() -> None:
    robot = Robot()
    begin(robot, 10.0)
    som = Som([*list(SOM)[1:], service("new", A, needed=True, topic="/a")])
    robot.handle(events.SomChanged(11.0, som, ONTOLOGY))
    assert [each.name for each in robot.core.robot.som.needed()] == ["a"]
    end(robot, 20.0)
    assert [each.name for each in robot.core.robot.som.needed()] == ["new"]


def test_it_begins_and_ends_once() -> None:
    robot = Robot()
    assert robot.handle(events.MaintenanceSet(9.0, False)) == []
    assert only(begin(robot, 10.0), events.Log).text.startswith("Maintenance")
    assert begin(robot, 11.0) == [] and robot.core.robot.maintained
    robot.handle(events.MaintenanceSet(12.0, False))
    assert robot.handle(events.MaintenanceSet(12.1, False)) == []
    fails(robot, 12.2)
    begin(robot, 12.3)
    assert robot.handle(events.Tick(50.0)) == []
    assert has(end(robot, 60.0), events.StartSubstitute)
    assert not robot.core.robot.maintained


def test_the_newest_word_of_a_computer_counts() -> None:
    robot = Robot()
    begin(robot, 10.0)
    for time in range(11, 1000):
        robot.handle(events.HostSeen(float(time), "pi", 0.0, 4.0))
    assert len(robot.core._held) == 1


def test_the_next_reconfigurator_kills_and_starts_nothing_either() -> None:
    first, *others = SOM
    som = Som([first, replace(others[0], needed=True, standby=Standby.HOT), others[1]])
    former = Robot()
    substitute = former.heal(10.0)
    next_ = Reconfigurator(ONTOLOGY, som)
    next_.handle(events.MaintenanceSet(20.0, True))
    records = tuple(former.written.values())
    assert not acting(next_.handle(events.Started(20.1, (), (), records, (substitute,))))
    healed = next_.incident("a")
    assert healed is not None and healed.substitute == substitute
    assert not next_.plans_ahead and next_.handle(events.Tick(30.0)) == []
    asked = next_.handle(events.MaintenanceSet(40.0, False))
    assert only(asked, events.AskMonitor).host == ""  # though it has told of nobody yet


def test_nor_if_the_substitute_has_died() -> None:
    former = Robot()
    substitute = only(former.fail("/a", A, 10.0, "out_of_range"), events.StartSubstitute).node
    next_ = Reconfigurator(ONTOLOGY, SOM)
    next_.handle(events.MaintenanceSet(20.0, True))
    commands = next_.handle(events.Started(20.1, (), (), tuple(former.written.values())))
    assert acting(commands) == (events.StopNode(substitute),)  # to make sure
    next_.handle(events.MaintenanceSet(40.0, False))
    assert has(next_.handle(events.Tick(40.0 + ANSWER_S)), events.StartSubstitute)


def test_nor_does_a_process_stand_by_once_the_first_is_prepared() -> None:
    first, *others = SOM
    next_ = Reconfigurator(ONTOLOGY, Som([replace(first, standby=Standby.WARM), *others]))
    next_.handle(events.MaintenanceSet(20.0, True))
    commands = next_.handle(events.Started(20.1, preparing=True))
    for time in range(21, 60):  # the file is looked at each second
        commands += next_.handle(events.MaintenanceSet(float(time), True))
    assert not acting(commands)


def test_shutting_down_ends_what_is_ours() -> None:
    robot = Robot()
    substitute = robot.heal(10.0)
    begin(robot, 20.0)
    commands = robot.handle(events.ShuttingDown(21.0))
    assert substitute in [c.node for c in commands if isinstance(c, events.StopNode)]


def test_a_node_that_was_started_again_still_ends_with_its_launch() -> None:
    robot = Robot()
    robot.handle(events.NodeRestarted(9.0, A))
    begin(robot, 10.0)
    assert acting(robot.handle(events.StarterEnded(11.0, A))) == (events.StopNode(A),)
