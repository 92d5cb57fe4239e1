"""Warm and hot: what the reconfigurator has ready before a failure."""
from core_robot import A, B, C, Robot, has, last_incident, only, service, speaking
from shsa_core.codegen.generator import Program
from shsa_core.healing import events
from shsa_core.healing.incident import State
from shsa_core.model.som import Service, Som


def standby(mode: str) -> Som:
    first = Service(**{**vars(service("a", A, needed=True)), "standby": mode})
    return Som([first, service("b", B), service("c", C)])


def test_a_warm_topic_takes_an_idle_process_and_the_pool_is_refilled() -> None:
    robot = Robot(standby("warm"))
    idle = only(robot.said, events.StartSubstitute)
    assert idle.program is None
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.AssignSubstitute).node == idle.node
    (row,) = only(commands, events.ShowSubstitutions).substitutions
    assert (row.node, row.topic, row.speaking) == (idle.node, "/a", True)
    assert robot.core.deadline == 11.0
    commands = robot.handle(events.Tick(11.0))
    refill = only(commands, events.StartSubstitute)
    assert refill.program is None and refill.node != idle.node
    row, listener = only(commands, events.ShowSubstitutions).substitutions
    assert (listener.node, listener.topic, listener.speaking) == (refill.node, "", False)


def test_a_warm_process_that_does_not_speak_soon_makes_room_for_another_with_the_same_plan() -> (
    None
):
    robot = Robot(standby("warm"))
    silent = only(robot.said, events.StartSubstitute).node
    assert only(robot.fail("/a", A, 10.0), events.AssignSubstitute).node == silent
    robot.handle(events.NodeKilled(10.01, A, True))
    assert not has(robot.handle(events.Tick(11.9)), events.StopSubstitute)
    commands = robot.handle(events.Tick(12.0))
    assert events.StopSubstitute(silent) in commands
    assert last_incident(commands).state is State.HEALING
    assert last_incident(commands).relations == ("good",)


def test_an_idle_process_listens_to_what_the_plans_read() -> None:
    robot = Robot(standby("warm"))
    while robot.core.plans_ahead:
        robot.core.prepare()
    (row,) = only(robot.handle(events.Tick(5.0)), events.ShowSubstitutions).substitutions
    assert row.program == Program(("/b/data",), "", ("/a/data",))


def test_an_idle_process_advertises_the_warm_topics() -> None:
    first, *others = standby("warm")
    second = Service(**{**vars(first), "property": "b", "topic": "/b", "node": B})
    hot = Service(**{**vars(others[1]), "needed": True, "standby": "hot"})
    robot = Robot(Som([first, second, hot]))
    table = [c for c in robot.said if isinstance(c, events.ShowSubstitutions)][-1]
    (row,) = [row for row in table.substitutions if row.topic == ""]
    assert (row.program.code, row.program.outputs) == ("", ("/a/data", "/b/data"))


def test_an_idle_process_that_dies_is_replaced_after_a_pause() -> None:
    robot = Robot(standby("warm"))
    idle = only(robot.said, events.StartSubstitute)
    assert not has(
        robot.handle(events.ProcessExited(5.0, idle.node, "status 1")), events.StartSubstitute
    )
    assert robot.core.deadline == 7.0
    assert has(robot.handle(events.Tick(7.0)), events.StartSubstitute)


def test_a_hot_topic_has_a_mute_substitute_that_speaks_at_once() -> None:
    robot = Robot(standby("hot"))
    start = only(robot.said, events.StartSubstitute)
    assert start.program is not None and start.program.inputs == ("/b/data",)
    assert speaking(robot) == (False,)
    commands = robot.fail("/a", A, 10.0)
    assert only(commands, events.AssignSubstitute).node == start.node
    assert not has(commands, events.StartSubstitute)
    assert isinstance(commands[0], events.ShowSubstitutions)
    assert speaking(robot) == (True,)


def test_a_hot_substitute_follows_the_plan_in_the_same_process() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    robot.row("/b", B, "failed", 5.0)
    commands = robot.table(5.0)
    assert only(commands, events.AssignSubstitute).node == node
    row = only(commands, events.ShowSubstitutions).substitutions[0]
    assert row.program.inputs == ("/c/data",) and not row.speaking


def test_a_hot_substitute_whose_input_died_with_the_original_is_not_used_as_it_is() -> None:
    robot = Robot(standby("hot"))
    robot.rows.pop(("/b", B))
    robot.row("/b", B, "failed", 10.0)
    robot.handle(events.HealthSeen(10.0, 10.0, tuple(robot.rows.values())))
    commands = robot.fail("/a", A, 10.001)
    table = [c for c in commands if isinstance(c, events.ShowSubstitutions)][-1]
    assert table.substitutions[0].program.inputs == ("/c/data",)


def test_a_hot_substitute_stays_mute_after_the_original_returned() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    robot.fail("/a", A, 10.0)
    robot.handle(events.NodeKilled(10.01, A, True))
    robot.row("/a", node, "healthy", 10.02, first=10.02)
    robot.table(10.03)
    robot.row("/a", A, "healthy", 20.0)
    robot.table(20.0)
    commands = robot.handle(events.Tick(22.5))
    assert last_incident(commands).state is State.ENDED
    assert not has(commands, events.StopSubstitute)
    assert robot.core.substitutes == (node,) and speaking(robot) == (False,)


def test_a_hot_substitute_that_dies_unused_is_started_again_after_a_pause() -> None:
    robot = Robot(standby("hot"))
    node = only(robot.said, events.StartSubstitute).node
    commands = robot.handle(events.ProcessExited(5.0, node, "status 1"))
    assert not has(commands, events.StartSubstitute)
    assert has(robot.handle(events.Tick(7.0)), events.StartSubstitute)


def test_plans_are_made_ahead_and_a_stale_one_is_never_used() -> None:
    robot = Robot()
    assert robot.core.plans_ahead
    while robot.core.plans_ahead:
        robot.core.prepare()
    assert robot.core.plan("/a", ()).program.inputs == ("/b/data",)
    robot.row("/b", B, "failed", 9.0)
    robot.handle(events.HealthSeen(9.0, 9.0, tuple(robot.rows.values())))
    start = only(robot.fail("/a", A, 9.001), events.StartSubstitute)
    assert start.program.inputs == ("/c/data",)


def test_a_plan_ahead_whose_input_dies_with_the_same_failure_is_not_used() -> None:
    som = Som([service("a", A, needed=True), service("b", B), service("c", C)])
    robot = Robot(som)
    while robot.core.plans_ahead:
        robot.core.prepare()
    # The node of the input fails first; its kill is under way, and the table does not tell of it yet.
    needed = Som([service("a", A, needed=True), service("b", B, needed=True), service("c", C)])
    robot.handle(events.SomChanged(8.0, needed))
    while robot.core.plans_ahead:
        robot.core.prepare()
    robot.fail("/b", B, 9.0, "silent")
    start = only(robot.fail("/a", A, 9.001), events.StartSubstitute)
    assert start.program.inputs == ("/c/data",)
