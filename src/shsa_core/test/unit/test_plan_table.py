"""Plans made before they are asked for: the table says what a search would say."""
from dataclasses import replace
from random import Random
from typing import Dict, Iterable, List, Optional

from hypothesis import given, settings, strategies as st
from shsa_testing.models import law, ontology, random_model, service, som_of

from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.errors import NoSubstitute
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Deadlines, Provision, Service
from shsa_core.model.som import Som
from shsa_core.planning.plan_table import PlanTable
from shsa_core.planning.planner import Planner
from shsa_testing.thorough import many

ROBOT = ontology(
    law("wheels", "speed", "left", "right"),
    law("wheels", "turn", "right", "left"),
    law("gyro", "turn", "gyration", quality=0.5),
)


def single(name: str, node: str = "", needed: bool = False, quality: float = 1.0) -> Service:
    """A service that provides the property of its name."""
    return service("/" + name, node or "/" + name, [Provision(name, "f", quality=quality)], needed)


ODOM = service("/odom", "/drive", [Provision("speed", "v"), Provision("turn", "w")], needed=True)
LEFT, RIGHT, GYRATION = (single(name) for name in ("left", "right", "gyration"))
ALL = (ODOM, LEFT, RIGHT, GYRATION)


def table(services: Iterable[Service] = ALL, robot: Ontology = ROBOT) -> PlanTable:
    """A table of which every answer is made."""
    services = tuple(services)
    made = empty(services, robot)
    made.change((), services)
    make_all(made)
    return made


def empty(services: Iterable[Service], robot: Ontology) -> PlanTable:
    """A table of which no answer is made."""
    search = lambda each, without: plan_service(robot, each, made.sources, without)
    made: PlanTable = PlanTable(robot, [each for each in services if each.needed], search)
    return made


def make_all(ready: PlanTable) -> List[str]:
    """Make every answer; those that were made."""
    made = []
    name = ready.step()
    while name is not None:
        made.append(name)
        name = ready.step()
    return made


def read(ready: PlanTable, name: str) -> List[str]:
    """The topics that the plan of a service reads."""
    plan = ready.plan(name)
    assert plan is not None
    return sorted({source.topic for source in plan.inputs})


def test_the_table_has_the_plan_before_the_node_fails() -> None:
    ready = table()
    assert not ready.stale and ready.step() is None
    assert read(ready, ODOM.name) == ["/left", "/right"]
    ready.change([ODOM], ())
    assert read(ready, ODOM.name) == ["/left", "/right"]


def test_what_cannot_be_read_or_written_here_is_left_out_and_the_rest_is_healed() -> None:
    strange = replace(LEFT, provides=(replace(LEFT.provides[0], unreadable="not built here"),))
    spare = replace(single("left", "/spare"), name="spare", topic="/spare")
    ready = table((ODOM, strange, RIGHT, GYRATION, spare))
    assert read(ready, ODOM.name) == ["/right", "/spare"]
    ready.change([strange], ())
    assert read(ready, ODOM.name) == ["/right", "/spare"]


def test_a_service_that_cannot_be_written_has_no_plan_and_the_others_have() -> None:
    sound, noise = single("sound", needed=True), single("noise")
    robot = ontology(*ROBOT.functions, law("ear", "sound", "noise"))
    ready = table((replace(ODOM, unwritable="not built here"), *ALL[1:], sound, noise), robot)
    assert ready.plan(ODOM.name) is None and read(ready, sound.name) == ["/noise"]


def test_a_plan_whose_input_is_gone_is_made_anew() -> None:
    ready = table()
    ready.change([RIGHT], ())
    assert ready.plan(ODOM.name) is None and ready.stale
    assert ready.step() == ODOM.name
    assert ready.plan(ODOM.name) is None and not ready.stale  # there is none


def test_without_more_nodes_a_service_is_hopeless_as_well() -> None:
    ready = table((ODOM, LEFT))
    assert ready.hopeless(ODOM.name, [ODOM.node])
    assert ready.hopeless(ODOM.name, [ODOM.node, "/another"])
    assert not ready.hopeless(ODOM.name, []), "its own node may do well"
    assert not table().hopeless(ODOM.name, [ODOM.node, "/another"])


def test_a_service_that_comes_makes_the_plans_stale_that_it_could_improve_and_no_others() -> None:
    robot = ontology(*ROBOT.functions, law("ear", "sound", "noise"))
    sound, noise = single("sound", needed=True), single("noise")
    ready = table([*ALL, sound, noise], robot)
    heard = ready.plan(sound.name)
    ready.change((), [single("speed", "/spare")])
    assert ready.plan(ODOM.name) is None
    assert ready.plan(sound.name) is heard
    assert make_all(ready) == [ODOM.name]
    assert "/speed" in read(ready, ODOM.name)


def test_a_service_that_is_back_as_it_was_concerns_only_plans_made_without_it() -> None:
    ready = table([*ALL, single("spare", needed=True)])
    before = ready.plan(ODOM.name)
    ready.change([GYRATION], ())
    ready.change((), [GYRATION])
    assert ready.plan(ODOM.name) is before and not ready.stale
    ready.change([RIGHT], ())
    make_all(ready)
    ready.change((), [RIGHT])
    assert make_all(ready) == [ODOM.name]
    assert read(ready, ODOM.name) == ["/left", "/right"]


def test_a_service_that_is_back_on_another_node_concerns_all_that_follow_from_it() -> None:
    ready = table()
    ready.change([GYRATION], ())
    ready.change((), [replace(GYRATION, node="/other")])
    assert ready.stale


def test_a_plan_never_uses_the_node_that_publishes_the_service_now() -> None:
    ready = table([*ALL, single("speed", "/left"), single("turn", "/turn")])
    assert "/speed" in read(ready, ODOM.name)
    ready.change([ODOM], [replace(ODOM, node="/left")])
    assert ready.plan(ODOM.name) is None
    make_all(ready)
    assert ready.plan(ODOM.name) is None


def test_the_table_answers_nothing_for_services_that_are_not_needed() -> None:
    ready = table()
    assert ready.plan(LEFT.name) is None
    ready.forget(ODOM.name)
    assert ready.plan(ODOM.name) is None and not ready.stale


@settings(max_examples=many(300), deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_the_table_always_says_what_a_search_would_say(seed: int) -> None:
    robot, sources, _ = random_model(seed)
    random = Random(seed)
    every = [replace(each, needed=random.random() < 0.5) for each in som_of(sources)]
    ready = empty(every, robot)
    available: Dict[str, Service] = {}
    for _ in range(8):
        gone = [each for each in available.values() if random.random() < 0.3]
        come = [each for each in every if each.name not in available and random.random() < 0.7]
        if random.random() < 0.2:
            come = [replace(each, node="/elsewhere") for each in come]
        for each in gone:
            del available[each.name]
        available.update({each.name: each for each in come})
        ready.change(gone, come)
        for _ in range(random.randint(0, 3)):
            ready.step()
        for each in every:
            plan = ready.plan(each.name)
            if plan is not None:
                assert plan == searched(robot, each, ready)
    make_all(ready)
    for each in every:
        if each.needed and ready.plan(each.name) is None:
            assert searched(robot, each, ready) is None


def searched(robot: Ontology, each: Service, ready: PlanTable) -> Optional[Plan]:
    """The plan that a search gives."""
    try:
        return plan_service(robot, each, ready.sources, ready.to_avoid(each.name))
    except NoSubstitute:
        return None


def test_a_plan_is_carried_out_with_the_periods_that_the_som_has_now() -> None:
    read = LEFT.sources
    planner = Planner(ROBOT, Som(ALL), {}, "best", Deadlines())
    (before,) = planner.signals(read)
    planner.som = Som([replace(each, period=0.5) if each is LEFT else each for each in ALL])
    (slower,) = planner.signals(read)
    assert (before.period, slower.period) == (LEFT.period, 0.5)
    planner.som = Som([RIGHT])
    (gone,) = planner.signals(read)
    assert (gone.period, gone.node) == (LEFT.period, LEFT.node), "it is read as it was"
