"""Plans made before they are asked for: the table says what a search would say."""
import dataclasses
from random import Random
from typing import Dict

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from search_models import law, ontology, random_model, service

from shsa_core.codegen.plans import plan_service
from shsa_core.errors import NoSubstitute
from shsa_core.healing.plan_table import PlanTable
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Service, Som

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
