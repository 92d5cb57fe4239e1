"""On which computer a substitute runs, and where one stands by."""
from dataclasses import replace
from core_robot import A, C, Robot, assigned, has, last_incident, only, publishing, service
from hosts_robot import BOARD, PI, distributed, lost, seen, som, stopped, takes_over
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.cost import Host, cost
from shsa_core.model.service import Placement
from shsa_core.model.kinds import Standby
from shsa_core.model.som import Som

# Where it runs


def test_a_substitute_starts_beside_its_inputs_and_the_incident_says_so() -> None:
    robot = distributed()
    commands = robot.fail("/a", A, 10.0)
    start = only(commands, events.StartSubstitute)
    assert start.host == BOARD
    assert last_incident(commands).detail.endswith(" from /b/data. It runs on board.")
    assert robot.shown[start.node].host == BOARD


def test_computers_that_are_not_heard_are_not_used() -> None:
    robot = Robot(som())
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == ""


def test_what_the_som_does_not_name_is_no_computer_of_the_robot() -> None:
    robot = distributed(placement=Placement(prefer=("stranger",)))
    assert seen(robot, 3.5, "stranger") == [] == lost(robot, 3.6, "stranger")
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == BOARD


def test_a_full_computer_is_passed_over_with_the_sum_in_the_incident() -> None:
    robot = distributed()
    seen(robot, 9.9, BOARD, load=3.995)
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.StartSubstitute).host == ""
    detail = last_incident(commands).detail
    assert "It runs on the reconfigurator's computer. board has no room: 3.995 busy + " in detail


def test_where_it_fits_nowhere_the_service_is_unhealed_and_tried_again() -> None:
    services = som(placement=Placement(forbid=(PI, "own")))
    hosts = [Host(PI), Host(BOARD, 4.0), Host("own")]
    robot = Robot(Som(list(services), hosts), host="own")
    seen(robot, 9.9, BOARD, load=4.0)
    incident = last_incident(robot.fail("/a", A, 10.0))
    assert incident.state is State.UNHEALED and "board has no room: 4 busy + " in incident.detail
    assert not has(seen(robot, 10.1, BOARD, load=4.0), events.ShowIncident)
    assert only(seen(robot, 12.1, BOARD, load=1.0), events.StartSubstitute).host == BOARD


def test_what_was_just_placed_counts_before_the_load_shows_it() -> None:
    a, b, c = som(placement=Placement(prefer=(BOARD,)))
    hosts = [Host(PI), Host(BOARD, 1.5 * cost([b], a, ()).cores)]
    two = replace(a, name="a2", topic="/a2", node="/a2_node")
    robot = Robot(Som([a, two, b, c], hosts))
    seen(robot, 9.9, BOARD, load=0.0)
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == BOARD
    commands = robot.fail("/a2", "/a2_node", 10.1)
    assert only(commands, events.StartSubstitute).host == ""
    told = [each.incident for each in commands if isinstance(each, events.ShowIncident)]
    assert "placed lately" in [each for each in told if each.service == "a2"][-1].detail


def test_our_own_computer_has_no_name_in_commands() -> None:
    robot = Robot(som(), host=BOARD)
    assert only(robot.fail("/a", A, 10.0), events.StartSubstitute).host == ""


# What stands by


def test_a_hot_substitute_stands_by_where_it_belongs_once_the_computers_are_there() -> None:
    robot = Robot(som(standby=Standby.HOT))
    (row,) = robot.working()
    assert row.host == ""
    seen(robot, 1.0, PI, BOARD)
    assert robot.working() == [row]
    commands = robot.handle(events.Tick(3.0))
    assert stopped(commands) == [row.node]
    assert only(commands, events.StartSubstitute).host == BOARD
    assert [row.host for row in robot.working()] == [BOARD]


def test_idle_processes_are_where_the_plans_of_warm_services_are_placed() -> None:
    robot = Robot(som(standby=Standby.WARM))
    (first,) = robot.idle_rows()
    assert first.host == ""
    seen(robot, 1.0, PI, BOARD)
    commands = robot.handle(events.Tick(3.0))
    assert stopped(commands) == [first.node]
    (row,) = robot.idle_rows()
    assert row.host == BOARD and robot.shown["a"].host == BOARD
    robot.handle(events.ProcessPulse(3.5, row.node, True))
    assert assigned(robot.fail("/a", A, 10.0)) == row.node and robot.shown[row.node].host == BOARD
    refill = only(robot.handle(events.Tick(11.0)), events.StartSubstitute)
    assert refill.host == BOARD and refill.program is None


def test_each_computer_has_its_own_idle_processes() -> None:
    a, b, c = som(standby=Standby.WARM)
    two = replace(service("c", C, needed=True), name="c2", topic="/c2", node="/c2_node")
    two = replace(two, standby=Standby.WARM, placement=Placement(prefer=(PI,)))
    robot = Robot(Som([a, b, c, two], [Host(PI), Host(BOARD)]), pool=2)
    seen(robot, 1.0, PI, BOARD)
    for time in (3.0, 4.0, 5.0):
        robot.handle(events.Tick(time))
        robot.idle(time)
    assert sorted(row.host for row in robot.idle_rows()) == [BOARD, BOARD, PI, PI]


def with_one_idle_on_each() -> Robot:
    """One idle process stands by on the Pi, one on the board."""
    a, b, c = som(standby=Standby.WARM)
    two = replace(service("c", C, needed=True), name="c2", topic="/c2", node="/c2_node")
    two = replace(two, standby=Standby.WARM, placement=Placement(prefer=(PI,)))
    robot = Robot(Som([a, b, c, two], [Host(PI), Host(BOARD)]))
    seen(robot, 1.0, PI, BOARD)
    robot.handle(events.Tick(3.0))
    robot.idle(3.0)
    return robot


def test_a_process_that_stands_by_elsewhere_takes_over_where_none_is_left() -> None:
    robot = with_one_idle_on_each()
    rows = {row.host: row.node for row in robot.idle_rows()}
    robot.handle(events.ProcessExited(4.0, rows[BOARD], "killed"))
    commands = robot.fail("/a", A, 4.1)
    assert assigned(commands) == rows[PI]
    assert "cold start" not in str(commands) and not has(commands, events.StartSubstitute)


def test_a_computer_on_which_nothing_starts_holds_up_no_other() -> None:
    robot = with_one_idle_on_each()
    on = {row.host: row.node for row in robot.idle_rows()}
    robot.handle(events.ProcessExited(4.0, on[BOARD], "it cannot start"))
    robot.handle(events.ProcessExited(4.1, on[PI], "killed"))
    starts = robot.handle(events.Tick(6.1))
    assert [each.host for each in starts if isinstance(each, events.StartSubstitute)] == [BOARD, PI]


# The SOM changes


def test_a_substitute_on_a_computer_that_is_forbidden_now_moves() -> None:
    robot = distributed(standby=Standby.HOT)
    (row,) = robot.working()
    for each in robot.said:
        if isinstance(each, events.StartSubstitute):
            robot.handle(events.ProcessPulse(4.0, each.node, True))  # there is room for another one
    commands = robot.handle(
        events.SomChanged(5.0, som(standby=Standby.HOT, placement=Placement(forbid=(BOARD,))))
    )
    assert stopped(commands) == [row.node]
    assert only(commands, events.StartSubstitute).host == ""
    robot.fail("/a", A, 10.0)
    node = takes_over(robot, 10.1)
    robot.killed(10.2, A)
    forbidden = som(standby=Standby.HOT, placement=Placement(forbid=(PI, BOARD)))
    assert not stopped(robot.handle(events.SomChanged(11.0, forbidden)))
    moved = som(standby=Standby.HOT, placement=Placement(prefer=(BOARD,)))
    assert not stopped(robot.handle(events.SomChanged(12.0, moved)))
    assert publishing(robot) == (True,) and robot.shown[node].host == ""
