"""Plans for services: all values by one substitute, nothing of what failed."""
import dataclasses
from typing import Collection, Iterable, List, Sequence

import pytest
from shsa_testing.models import law, ontology, service, som_of, source

from shsa_core.errors import GenerationError, ModelError, NoSubstitute
from shsa_core.codegen.plans import Plan, plan_service, safe_values
from shsa_core.codegen.program import compile_program
from shsa_core.model.kinds import Others
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import LastResort, Provision, Service, Source
from shsa_core.search.derivation import SourceTable

ROBOT = ontology(
    law("wheels", "speed", "left", "right", quality=0.9),
    law("turning", "turn", "left", "right", quality=0.8),
    law("gyro", "turn", "gyration", quality=0.5),
)
SOM = som_of(
    [
        source("speed", "/odom", "/drive", needed=True),
        source("turn", "/odom", "/drive", needed=True),
        source("left", node="/wheels"),
        source("right", node="/wheels"),
        source("gyration", node="/imu"),
    ]
)
(ODOM,) = SOM.of_topic("/odom")
LEFT, RIGHT, GYRATION = SOM.sources[2:]


def plan_odometry(
    robot: Ontology = ROBOT,
    available: Iterable[Source] = SOM.sources,
    excluded: Iterable[str] = (),
    method: str = "best",
    tried: Collection[Plan] = (),
    service: Service = ODOM,
) -> Plan:
    table = SourceTable(robot.network, available)
    return plan_service(robot, service, table, excluded, method, tried)


def all_plans(method: str = "best") -> List[Plan]:
    plans: List[Plan] = []
    try:
        while True:
            plans.append(plan_odometry(method=method, tried=plans))
    except NoSubstitute:
        return plans


def test_what_cannot_be_written_is_planned_by_nothing_and_says_why() -> None:
    values = LastResort((("speed", 0.0),))
    strange = dataclasses.replace(ODOM, unwritable="no/Type is not built", last_resort=values)
    with pytest.raises(GenerationError, match="no/Type is not built"):
        plan_odometry(service=strange)
    assert safe_values(strange) is None


def test_a_field_that_can_be_read_alone_is_an_input_and_never_an_output() -> None:
    nearest = Provision("speed", "min(ranges)")
    scan = Service("scan", "/scan", "x/Y", "/lidar", 0.1, (nearest,))
    with pytest.raises(GenerationError, match=r"min\(ranges\) is read-only"):
        plan_odometry(service=scan)
    robot = ontology(law("same", "turn", "speed"))
    turn = Service("turn", "/turn", "x/Y", "/n", 0.1, (Provision("turn", "data"),))
    plan = plan_odometry(robot, scan.sources, service=turn)
    assert plan.program.inputs == ("/scan/min(ranges)",)


def test_one_plan_fills_all_fields_of_the_topic() -> None:
    plan = plan_odometry()
    assert plan.service == ODOM.name
    assert plan.outputs == ODOM.sources
    assert plan.program.outputs == ("/odom/speed", "/odom/turn")
    assert plan.program.inputs == ("/left/left", "/right/right")
    assert plan.relations == ("wheels", "turning")
    assert plan.inputs == (LEFT, RIGHT)
    assert plan.quality == pytest.approx(0.72)
    assert plan.proven_best
    assert [d.property for d in plan.derivations] == ["speed", "turn"]


def test_the_failed_service_is_not_used_even_if_it_counts_as_available() -> None:
    robot = ontology(law("f", "speed", "turn"), law("g", "turn", "gyration"))
    plan = plan_odometry(robot)
    assert plan.inputs == (GYRATION,)


def test_excluded_nodes_topics_and_services_are_not_used() -> None:
    for excluded in ["/wheels", "/left", LEFT.service.name]:
        with pytest.raises(NoSubstitute) as none:
            plan_odometry(excluded=[excluded])
        assert "left" in none.value.missing
        assert none.value.properties == ("speed", "turn")


def test_what_is_not_available_is_not_used_and_is_missing() -> None:
    available = [s for s in SOM.sources if s != RIGHT]
    with pytest.raises(NoSubstitute) as none:
        plan_odometry(available=available)
    assert none.value.missing == ("right",)
    assert str(none.value).endswith("speed, turn: speed cannot be derived, missing right")


def can_say_unknown(service: Service, *marks: str) -> Service:
    """Return the service with a mark at each of its values."""
    pairs = zip(service.provides, marks)
    provides = tuple(dataclasses.replace(each, unknown_with=mark) for each, mark in pairs)
    return dataclasses.replace(service, provides=provides)


def test_a_value_that_nothing_derives_is_left_unknown_where_its_message_says_so() -> None:
    wheels = [s for s in SOM.sources if s != RIGHT]
    imu = can_say_unknown(ODOM, "velocity", "turn")
    plan = plan_odometry(available=wheels, service=imu)
    assert (plan.program.outputs, plan.relations) == (("/odom/turn",), ("gyro",))
    assert (plan.left_out, plan.missing) == (("speed",), ("right",))
    assert plan.lacks == "speed is left unknown, missing right"
    whole = plan_odometry(service=imu)
    assert (whole.left_out, whole.missing, whole.lacks) == ((), (), "")
    assert plan_odometry(available=wheels, service=imu, tried=[whole]) == plan


@pytest.mark.parametrize("marks", [("", ""), ("", "turn"), ("all", "all")])
def test_a_message_that_cannot_say_unknown_is_published_with_all_values(
    marks: Sequence[str],
) -> None:
    available = [s for s in SOM.sources if s != RIGHT]
    with pytest.raises(NoSubstitute, match="speed cannot be derived, missing right"):
        plan_odometry(available=available, service=can_say_unknown(ODOM, *marks))


def test_what_the_som_has_held_is_never_said_to_be_unknown() -> None:
    held = dataclasses.replace(can_say_unknown(ODOM, "speed", "turn"), others=Others.LAST)
    with pytest.raises(NoSubstitute):
        plan_odometry(available=[s for s in SOM.sources if s != RIGHT], service=held)


def test_all_values_come_before_a_part_that_shares_no_cause() -> None:
    board = dataclasses.replace(can_say_unknown(ODOM, "speed", "turn"), fails_with=("board",))
    wheels = dataclasses.replace(RIGHT.service, fails_with=("board",))
    available = [LEFT, GYRATION, *wheels.sources]
    plan = plan_odometry(available=available, service=board)
    assert plan.outputs == board.sources and not plan.left_out


def test_a_service_of_the_same_property_is_passed_on() -> None:
    spare = source("speed", "/speed2", quality=0.95)
    plan = plan_odometry(available=[*SOM.sources, spare])
    assert plan.inputs == (spare, LEFT, RIGHT)
    assert plan.relations == ("turning",)


def test_tried_plans_are_passed_over_in_order_of_quality() -> None:
    plans = all_plans()
    assert [plan.relations for plan in plans] == [("wheels", "turning"), ("wheels", "gyro")]
    assert [plan.quality for plan in plans] == pytest.approx([0.72, 0.45])
    assert all(plan.proven_best for plan in plans)
    with pytest.raises(NoSubstitute, match="none is left after the 2 that failed"):
        plan_odometry(tried=plans)


def test_tried_plans_that_are_no_longer_possible_do_not_hide_what_is_missing() -> None:
    with pytest.raises(NoSubstitute, match="missing gyration, right"):
        plan_odometry(available=[LEFT], tried=all_plans())


def test_plans_are_equal_if_they_do_the_same() -> None:
    one, other = plan_odometry(), plan_odometry()
    assert one == other and hash(one) == hash(other)
    assert one.derivations != other.derivations
    assert one != all_plans()[1]


@pytest.mark.parametrize("method", ["depth_first", "orr"])
def test_depth_first_takes_the_first_found_and_then_the_best(method: str) -> None:
    plans = all_plans(method)
    assert [plan.relations for plan in plans] == [("wheels", "gyro"), ("wheels", "turning")]
    assert [plan.proven_best for plan in plans] == [False, True]


def test_a_relation_that_cannot_be_executed_is_passed_over() -> None:
    best = dataclasses.replace(law("best", "speed", "left"), law=None, text="learned")
    plan = plan_odometry(ontology(*ROBOT.functions, best))
    assert plan.relations == ("wheels", "turning")


def test_a_relation_that_cannot_be_executed_is_named_if_there_is_no_other() -> None:
    only = dataclasses.replace(law("only", "speed", "left"), law=None, text="learned")
    robot = ontology(*ROBOT.functions[1:], only)
    with pytest.raises(GenerationError, match="only"):
        plan_odometry(robot)


def test_a_plan_that_is_too_large_for_code_is_refused_by_name() -> None:
    chain = [law(f"r{i}", f"p{i}", f"p{i + 1}") for i in range(3000)]
    lost = source("p0").service
    with pytest.raises(GenerationError, match="r2999.* more"):
        plan_odometry(ontology(*chain), [source("p3000")], service=lost)


def test_the_next_smaller_plan_is_taken_if_the_best_is_too_large_for_code() -> None:
    chain = [law(f"r{i}", f"p{i}", f"p{i + 1}") for i in range(3000)]
    short = law("short", "p0", "q", quality=0.5)
    available = [source("p3000"), source("q")]
    plan = plan_odometry(ontology(*chain, short), available, service=source("p0").service)
    assert plan.relations == ("short",)


def test_a_small_plan_is_found_behind_some_that_are_too_large() -> None:
    oversized = 3
    chain = [law(f"r{i}", f"p{i}", f"p{i + 1}") for i in range(1, 1200)]
    ways = [law(f"way{i}", "p0", "p1", f"q{i}", quality=0.9) for i in range(oversized)]
    small = [law("short", "p0", "s", quality=0.5), law("worse", "p0", "s", quality=0.4)]
    robot = ontology(*chain, *ways, *small)
    available = [source("p1200"), source("s"), *(source(f"q{i}") for i in range(oversized))]
    lost = source("p0").service
    plan = plan_odometry(robot, available, service=lost)
    assert plan.relations == ("short",) and plan.quality == 0.5
    assert plan.proven_best
    second = plan_odometry(robot, available, service=lost, tried=[plan])
    assert second.relations == ("worse",)
    with pytest.raises(GenerationError):
        plan_odometry(robot, available, service=lost, tried=[plan, second])


def sharing(*causes: str) -> Iterable[Source]:
    """The same robot; the odometry and its wheels have something in common."""
    for each in SOM:
        common = each in (ODOM, LEFT.service) and causes
        yield from dataclasses.replace(each, fails_with=tuple(common or ())).sources


def test_what_shares_a_cause_is_used_only_if_nothing_else_will_do() -> None:
    robot = ontology(*ROBOT.functions, law("slip", "speed", "gyration", quality=0.1))
    lost = dataclasses.replace(ODOM, fails_with=("usb_hub",))
    assert plan_odometry(robot, service=lost).relations == ("wheels", "turning")
    apart = plan_odometry(robot, sharing("usb_hub", "mast"), service=lost)
    assert apart.relations == ("slip", "gyro") and apart.proven_best
    assert plan_odometry(robot, sharing("mast"), service=lost).relations[0] == "wheels"
    better_than_nothing = plan_odometry(ROBOT, sharing("usb_hub"), service=lost)
    assert better_than_nothing.relations == ("wheels", "turning")
    second = plan_odometry(robot, sharing("usb_hub"), service=lost, tried=[apart])
    assert second.relations == ("wheels", "turning")
    with pytest.raises(NoSubstitute, match="missing left"):
        plan_odometry(ROBOT, sharing("usb_hub"), excluded=["usb_hub"], service=lost)
    with pytest.raises(NoSubstitute):
        plan_odometry(ROBOT, sharing("/drive"), excluded=["/drive"])


def hosted(*off: Source, fails_with: Sequence[str] = ()) -> Iterable[Source]:
    """The robot on the computer `pi`, save some sources, which are on none of that name."""
    for each in SOM:
        host = "board" if set(each.sources) & set(off) else "pi"
        yield from dataclasses.replace(each, host=host, fails_with=tuple(fails_with)).sources


def test_what_is_on_the_same_host_is_used_only_if_nothing_else_will_do() -> None:
    robot = ontology(*ROBOT.functions, law("slip", "speed", "gyration", quality=0.1))
    lost = dataclasses.replace(ODOM, host="pi")
    assert plan_odometry(robot, hosted(GYRATION), service=lost).relations == ("slip", "gyro")
    assert plan_odometry(robot, hosted(LEFT, RIGHT), service=lost).relations[0] == "wheels"
    for available in (hosted(), hosted(LEFT)):  # one host, or too little elsewhere: the best of all
        assert plan_odometry(robot, available, service=lost).relations == ("wheels", "turning")


def test_where_all_is_on_one_host_the_other_causes_are_avoided_as_ever() -> None:
    robot = ontology(*ROBOT.functions, law("slip", "speed", "gyration", quality=0.1))
    lost = dataclasses.replace(ODOM, host="pi", fails_with=("usb_hub",))
    available = [
        source
        for each in SOM
        for source in dataclasses.replace(
            each, host="pi", fails_with=("usb_hub",) if each is LEFT.service else ()
        ).sources
    ]
    assert plan_odometry(robot, available, service=lost).relations == ("slip", "gyro")


def test_unknown_methods_are_named() -> None:
    with pytest.raises(ModelError, match="'fast' is not known; allowed are best, depth_first, orr"):
        plan_odometry(method="fast")


def test_another_service_on_the_same_topic_is_passed_on() -> None:
    lost, other = source("angle", "/joints", "/arm"), source("angle", "/joints", "/gripper")
    plan = plan_odometry(available=[lost, other], service=lost.service)
    assert plan.inputs == (other,) and plan.program.inputs == plan.program.outputs


def test_inputs_on_the_same_topic_are_told_apart_by_their_nodes() -> None:
    left = service("/joints", "/left", [Provision("left", "position")]).sources[0]
    right = service("/joints", "/right", [Provision("right", "position")]).sources[0]
    plan = plan_odometry(available=[right, left])
    assert plan.inputs == (left, right)
    assert plan.program.inputs == ("/joints/position", "/joints/position")
    step = compile_program(plan.program.code, 2, 2).step
    assert step((1.0, 2.0), 0.0) == (3.0, 3.0)
    swapped = dataclasses.replace(plan, inputs=(right, left))
    assert swapped != plan


def test_safe_values_are_a_program_without_inputs() -> None:
    resort = LastResort(values=(("turn", -0.5), ("speed", 0.0)))
    safe = safe_values(dataclasses.replace(ODOM, last_resort=resort))
    assert safe is not None and safe.service == ODOM.name
    assert safe.program.inputs == () and safe.program.outputs == ("/odom/speed", "/odom/turn")
    assert "# safe value: speed" in safe.program.code
    assert compile_program(safe.program.code, 0, 2).step((), 0.0) == (0.0, -0.5)
    one = safe_values(dataclasses.replace(ODOM, last_resort=LastResort(values=(("turn", 1.0),))))
    assert one is not None and one.program.outputs == ("/odom/turn",)
    assert compile_program(one.program.code, 0, 1).step((), 0.0) == (1.0,)
    assert safe_values(ODOM) is None
