"""Plans for topics: all fields by one substitute, nothing of what failed, the next best after a failure."""
import dataclasses
from random import Random
from typing import Dict, List

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_models import law, ontology, random_model, service

from shsa_core.errors import GenerationError, ModelError, NoSubstitute
from shsa_core.healing.plans import PlanTable, TopicPlan, plan_topic
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Service, Som

ROBOT = ontology(
    law("wheels", "speed", "left", "right", quality=0.9),
    law("turning", "turn", "left", "right", quality=0.8),
    law("gyro", "turn", "gyration", quality=0.5),
)
SPEED = service("speed", "/odom", "/drive", needed=True)
TURN = service("turn", "/odom", "/drive", needed=True)
LEFT, RIGHT = service("left", node="/wheels"), service("right", node="/wheels")
GYRATION = service("gyration", node="/imu")
SOM = Som([SPEED, TURN, LEFT, RIGHT, GYRATION])


def all_plans(method: str = "best") -> List[TopicPlan]:
    plans: List[TopicPlan] = []
    try:
        while True:
            plans.append(plan_topic(ROBOT, SOM, SOM, "/odom", method=method, tried=plans))
    except NoSubstitute:
        return plans


def test_one_plan_fills_all_fields_of_the_topic() -> None:
    plan = plan_topic(ROBOT, SOM, SOM, "/odom")
    assert plan.topic == "/odom"
    assert plan.program.outputs == ("/odom/speed", "/odom/turn")
    assert plan.program.inputs == ("/left/left", "/right/right")
    assert plan.relations == ("wheels", "turning")
    assert plan.services == (LEFT, RIGHT)
    assert plan.quality == pytest.approx(0.72)
    assert plan.proven_best
    assert [d.property for d in plan.derivations] == ["speed", "turn"]


def test_the_failed_topic_is_not_used_even_if_it_counts_as_available() -> None:
    robot = ontology(law("f", "speed", "turn"), law("g", "turn", "gyration"))
    plan = plan_topic(robot, SOM, SOM, "/odom")
    assert plan.services == (GYRATION,)


def test_excluded_nodes_and_topics_are_not_used() -> None:
    for excluded in ["/wheels", "/left"]:
        with pytest.raises(NoSubstitute) as none:
            plan_topic(ROBOT, SOM, SOM, "/odom", excluded=[excluded])
        assert "left" in none.value.missing
        assert none.value.properties == ("speed", "turn")


def test_what_is_not_available_is_not_used_and_is_missing() -> None:
    available = [s for s in SOM if s != RIGHT]
    with pytest.raises(NoSubstitute) as none:
        plan_topic(ROBOT, SOM, available, "/odom")
    assert none.value.missing == ("right",)
    assert str(none.value) == "no substitute for speed, turn: missing right"


def test_a_service_of_the_same_property_is_passed_on() -> None:
    spare = service("speed", "/speed2", quality=0.95)
    plan = plan_topic(ROBOT, Som([*SOM, spare]), [*SOM, spare], "/odom")
    assert plan.services == (spare, LEFT, RIGHT)
    assert plan.relations == ("turning",)


def test_tried_plans_are_passed_over_in_order_of_quality() -> None:
    plans = all_plans()
    assert [plan.relations for plan in plans] == [("wheels", "turning"), ("wheels", "gyro")]
    assert [plan.quality for plan in plans] == pytest.approx([0.72, 0.45])
    assert all(plan.proven_best for plan in plans)
    with pytest.raises(NoSubstitute, match="none is left after the 2 that failed"):
        plan_topic(ROBOT, SOM, SOM, "/odom", tried=plans)


def test_tried_plans_that_are_no_longer_possible_do_not_hide_what_is_missing() -> None:
    with pytest.raises(NoSubstitute, match="missing gyration, right"):
        plan_topic(ROBOT, SOM, [LEFT], "/odom", tried=all_plans())


def test_plans_are_equal_if_they_do_the_same() -> None:
    one, other = plan_topic(ROBOT, SOM, SOM, "/odom"), plan_topic(ROBOT, SOM, SOM, "/odom")
    assert one == other and hash(one) == hash(other)
    assert one.derivations != other.derivations
    assert one != all_plans()[1]


def test_orr_takes_the_first_found_and_then_the_best() -> None:
    plans = all_plans(method="orr")
    assert [plan.relations for plan in plans] == [("wheels", "gyro"), ("wheels", "turning")]
    assert [plan.proven_best for plan in plans] == [False, True]


def test_a_relation_that_cannot_be_executed_is_passed_over() -> None:
    best = dataclasses.replace(law("best", "speed", "left"), expression=None, text="learned")
    plan = plan_topic(ontology(*ROBOT.functions, best), SOM, SOM, "/odom")
    assert plan.relations == ("wheels", "turning")


def test_a_relation_that_cannot_be_executed_is_named_if_there_is_no_other() -> None:
    only = dataclasses.replace(law("only", "speed", "left"), expression=None, text="learned")
    robot = ontology(*ROBOT.functions[1:], only)
    with pytest.raises(GenerationError, match="only"):
        plan_topic(robot, SOM, SOM, "/odom")


def test_a_plan_that_is_too_large_for_code_is_refused_by_name() -> None:
    chain = [law(f"r{i}", f"p{i}", f"p{i + 1}") for i in range(3000)]
    som = Som([service("p0", "/odom", needed=True), service("p3000")])
    with pytest.raises(GenerationError, match="r0"):
        plan_topic(ontology(*chain), som, som, "/odom")


def test_the_next_smaller_plan_is_taken_if_the_best_is_too_large_for_code() -> None:
    chain = [law(f"r{i}", f"p{i}", f"p{i + 1}") for i in range(3000)]
    short = law("short", "p0", "q", quality=0.5)
    som = Som([service("p0", "/odom", needed=True), service("p3000"), service("q")])
    assert plan_topic(ontology(*chain, short), som, som, "/odom").relations == ("short",)


def test_unknown_topics_and_methods_are_named() -> None:
    with pytest.raises(ModelError, match="/nope.*has /odom, /left"):
        plan_topic(ROBOT, SOM, SOM, "/nope")
    with pytest.raises(ModelError, match="'fast' is not known; allowed are best, orr"):
        plan_topic(ROBOT, SOM, SOM, "/odom", method="fast")


def table(som: Som = SOM, robot: Ontology = ROBOT) -> PlanTable:
    made = PlanTable(robot, som)
    made.update(som)
    while made.step() is not None:
        pass
    return made


def test_the_table_has_the_plan_before_the_node_fails() -> None:
    ready = table()
    assert ready.stale == ()
    assert ready.lookup("/odom") == plan_topic(ROBOT, SOM, SOM, "/odom", excluded=["/drive"])


def test_the_failure_itself_does_not_take_the_plan_away() -> None:
    ready = table()
    ready.update([LEFT, RIGHT, GYRATION])
    plan = ready.lookup("/odom")
    assert plan is not None and plan.services == (LEFT, RIGHT)


def test_a_plan_whose_input_has_just_died_is_not_used() -> None:
    ready = table()
    ready.update([s for s in SOM if s != RIGHT])
    assert ready.lookup("/odom") is None
    assert ready.stale == ("/odom",)
    assert ready.step() == "/odom"
    with pytest.raises(NoSubstitute, match="missing right"):
        ready.lookup("/odom")


def test_a_plan_whose_input_died_since_the_last_update_is_not_used() -> None:
    ready = table()
    assert ready.lookup("/odom", available={SPEED, TURN, LEFT, GYRATION}) is None
    assert ready.lookup("/odom", available={LEFT, RIGHT}) is not None
    assert ready.lookup("/odom", excluded={"/wheels"}) is None
    assert ready.lookup("/odom", excluded={"/right"}) is None
    assert ready.lookup("/odom", excluded={"/drive", "/odom"}) is not None


def test_a_service_that_comes_makes_the_plans_it_could_improve_stale_and_no_others() -> None:
    som = Som([*SOM, service("sound", needed=True), service("noise")])
    robot = ontology(*ROBOT.functions, law("ear", "sound", "noise"))
    ready = table(som, robot)
    heard = ready.lookup("/sound")
    spare = service("speed", "/speed2")
    ready.update([*som, spare])
    assert ready.lookup("/odom") is None
    assert ready.lookup("/sound") is heard
    ready.step()
    plan = ready.lookup("/odom")
    assert plan is not None and spare in plan.services


def test_an_answer_that_there_is_none_is_made_anew_when_a_service_comes_or_goes() -> None:
    ready = PlanTable(ROBOT, SOM)
    ready.update([LEFT])
    ready.step()
    with pytest.raises(NoSubstitute, match="missing gyration, right"):
        ready.lookup("/odom")
    ready.update([])
    assert ready.lookup("/odom") is None
    ready.step()
    with pytest.raises(NoSubstitute, match="missing gyration, left, right"):
        ready.lookup("/odom")
    ready.update(SOM)
    ready.step()
    assert ready.lookup("/odom") is not None


def test_a_plan_never_uses_the_node_that_publishes_the_topic_now() -> None:
    ready = table()
    moved = [dataclasses.replace(s, node="/wheels") for s in (SPEED, TURN)]
    ready.update([*moved, LEFT, RIGHT, GYRATION])
    assert ready.lookup("/odom") is None
    ready.step()
    with pytest.raises(NoSubstitute):
        ready.lookup("/odom")


def test_the_table_answers_nothing_for_topics_that_are_not_needed() -> None:
    assert table().lookup("/left") is None


@settings(max_examples=300, deadline=None, derandomize=True)
@given(st.integers(0, 2**32))
def test_the_table_always_says_what_a_search_would_say(seed: int) -> None:
    robot, services, _ = random_model(seed)
    random = Random(seed)
    fields: Dict[str, Service] = {}
    for each in services:
        fields.setdefault(each.path, dataclasses.replace(each, needed=random.random() < 0.5))
    som = Som(fields.values())
    ready = PlanTable(robot, som)
    for _ in range(6):
        available = [s for s in som if random.random() < 0.7]
        ready.update(available)
        for _ in range(random.randint(0, 3)):
            ready.step()
        for topic in {s.topic for s in som if s.needed}:
            nodes = [s.node for s in som.of_topic(topic)]
            try:
                plan = ready.lookup(topic)
            except NoSubstitute as none:
                with pytest.raises(NoSubstitute) as searched:
                    plan_topic(robot, som, available, topic, nodes)
                assert none.missing == searched.value.missing
            else:
                assert plan is None or plan == plan_topic(robot, som, available, topic, nodes)
