"""A SOM or an ontology that changes while the reconfigurator runs."""
from dataclasses import replace

from core_robot import (
    assigned,
    A,
    ONTOLOGY,
    SOM,
    WITH_D,
    Robot,
    function,
    has,
    last_incident,
    only,
    program_of,
    publishing,
    reads,
    service,
)
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Standby
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som


def test_a_service_that_appears_in_the_som_is_used() -> None:
    robot = Robot()
    spare = Provision("a", "data")
    extra = Service("spare", "/spare", "std_msgs/Float64", "/spare_node", 0.02, (spare,))
    robot.handle(events.SomChanged(2.0, Som([*SOM, extra])))
    robot.row("/spare", "/spare_node", "healthy", 3.0)
    robot.table(3.0)
    start = only(robot.fail("/a", A, 10.0), events.StartSubstitute)
    assert program_of([start]).inputs == ("/spare/data",)


def test_a_topic_that_leaves_the_som_ends_its_incident() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    commands = robot.handle(events.SomChanged(12.0, Som([*SOM][1:])))
    assert only(commands, events.StopNode).node == node
    assert last_incident(commands).state is State.ENDED
    assert robot.core.services.keys() == robot.core._processes.substitutes.keys()


def test_new_models_leave_what_runs_and_change_the_plans() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    assert reads(robot, node) == ("/b/data",)
    other = replace(ONTOLOGY, functions=[function("only", "a", "3 * c", 0.7)])
    commands = robot.handle(events.SomChanged(20.0, SOM, other))
    assert not has(commands, events.StopNode) and publishing(robot) == (True,)
    robot.idle(20.1)
    assert robot.core.explain("a").relations == ("only",)
    robot.back(30.0)
    robot.handle(events.Tick(33.0))
    start = only(robot.fail("/a", A, 40.0), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)


def test_a_service_that_is_not_needed_any_more_is_left_alone() -> None:
    first, *others = SOM
    hot = replace(first, standby=Standby.HOT)
    robot = Robot(Som([hot, *others]))
    (row,) = robot.working()
    commands = robot.handle(events.SomChanged(2.0, Som([replace(hot, needed=False), *others])))
    assert only(commands, events.StopNode).node == row.node
    assert not has(robot.fail("/a", A, 10.0), events.FindNode)


def test_a_service_that_has_failed_before_it_was_needed_is_healed_then() -> None:
    first, *others = SOM
    robot = Robot(Som([replace(first, needed=False), *others]))
    robot.row("/a", A, "failed", 5.0)
    assert not has(robot.table(5.1), events.StartSubstitute)
    assert has(robot.handle(events.SomChanged(9.0, SOM)), events.StartSubstitute)


def test_a_service_that_becomes_warm_has_processes_ready() -> None:
    first, *others = SOM
    robot = Robot()
    assert not has(robot.said, events.StartSubstitute)
    warm = Som([replace(first, standby=Standby.WARM), *others])
    assert has(robot.handle(events.SomChanged(2.0, warm)), events.StartSubstitute)
    robot.idle(2.0)
    assert assigned(robot.fail("/a", A, 10.0))


def test_another_quality_of_a_source_counts_in_the_next_plan() -> None:
    first, second, third = SOM
    poor = replace(second, provides=(Provision("b", "data", quality=0.1),))
    robot = Robot()
    robot.handle(events.SomChanged(2.0, Som([first, poor, third])))
    robot.idle(2.0)
    start = only(robot.fail("/a", A, 10.0), events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/c/data",)


def test_a_changed_period_reaches_the_substitute_that_runs() -> None:
    robot = Robot()
    node = robot.heal(10.0)
    slower = Som([replace(each, period=0.1) for each in SOM])
    assert not has(robot.handle(events.SomChanged(12.0, slower)), events.StopNode)
    row = robot.shown[node]
    assert {signal.period for signal in (*row.inputs, *row.outputs)} == {0.1}


def test_a_service_that_moves_to_another_topic_is_healed_there() -> None:
    first, *others = SOM
    robot = Robot()
    node = robot.heal(10.0)
    commands = robot.handle(events.SomChanged(12.0, Som([replace(first, topic="/moved"), *others])))
    assert only(commands, events.StopNode).node == node
    assert last_incident(commands).state is State.ENDED
    start = only(robot.fail("/moved", A, 20.0), events.StartSubstitute)
    assert start.program is not None and start.program.outputs == ("/moved/data",)


def test_what_comes_to_be_computed_from_the_lost_service_by_two_steps_is_not_read() -> None:
    a, b, c = SOM
    read, middle = replace(b, derived_from=("d",)), service("d", "/d_node")
    robot = Robot(Som([a, read, c, middle]), WITH_D)
    assert robot.core.explain("a").relations == ("good",)
    robot.handle(events.SomChanged(2.0, Som([a, read, c, replace(middle, derived_from=("a",))])))
    assert robot.core.explain("a").relations == ("poor",)
