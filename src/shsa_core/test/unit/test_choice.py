"""The choice of a derivation where errors are known."""
from dataclasses import replace
from itertools import islice
from typing import Any, List, Mapping, Sequence, Tuple

import pytest
from test_prediction import law, models, sensor

from shsa_core.codegen import choice
from shsa_core.codegen.choice import MOST, joined
from shsa_core.codegen.generator import way
from shsa_core.codegen.plans import Plan, plan_service
from shsa_core.codegen.prediction import Predictor, predictor
from shsa_core.errors import NoSubstitute
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service, Source
from shsa_core.search.derivation import SourceTable
from shsa_core.search.ranking import Ranking

LOST = sensor("y", None, "/lost")
X, Z = sensor("x", None), sensor("z", None)


def plans(
    ontology: Ontology,
    *sources: Source,
    lost: Service = LOST.service,
    method: str = "best",
    measured: Mapping[str, Error] = {},
) -> List[Plan]:
    """All plans for a lost service, in the order in which they would be tried.

    `measured`: the errors of those by one relation that were measured.
    """
    som = [*lost.sources, *sources]
    found: List[Plan] = []
    knows = predictor(ontology, som)
    if measured and knows is not None:
        ways = {each.relations[0]: way(each.derivations[0]) for each in plans(ontology, *sources)}
        knows = knows.knowing({ways[name]: error for name, error in measured.items()})
    table = SourceTable(ontology.network, som)
    try:
        while True:
            found.append(
                plan_service(ontology, lost, table, [lost.node], method, found, predictor=knows)
            )
    except NoSubstitute:
        return found


def order(ontology: Ontology, *sources: Source, **more: Any) -> List[str]:
    """By which relation or service each plan is."""
    found = plans(ontology, *sources, **more)
    return [(each.relations or [s.path for s in each.inputs])[0] for each in found]


def test_the_smallest_error_is_the_best_whatever_the_quality() -> None:
    ontology = models(
        law("y", "x", Error(0.5), 0.99, name="high"), law("y", "z", Error(0.2), 0.3, name="low")
    )
    first, second = plans(ontology, X, Z)
    assert (first.relations, second.relations) == (("low",), ("high",))
    assert first.proven_best and second.proven_best
    (error,) = first.errors
    assert error is not None and error.rms == 0.2
    without = models(*(replace(each, error=None) for each in ontology.functions))
    assert [each.relations for each in plans(without, X, Z)] == [("high",), ("low",)]
    assert [each.errors for each in plans(without, X, Z)] == [(None,), (None,)]


def test_an_error_that_is_known_comes_before_one_that_is_not_and_harm_is_not_used() -> None:
    ontology = models(
        law("y", "x", quality=0.99, name="a_promise"),
        law("y", "2*x", Error(3.0, baseline=2.0), name="harmful"),
        law("y", "3*x", Error(1.9, baseline=2.0), name="poor"),
        law("y", "4*x", quality=0.9, name="lesser_promise"),
    )
    assert order(ontology, X) == ["poor", "a_promise", "lesser_promise"]
    harmful = models(law("y", "2*x", Error(3.0, baseline=2.0), name="harmful"))
    knows = predictor(harmful, [X])
    with pytest.raises(NoSubstitute, match=r"y by harmful: its error of 3 \(rms\) is not below"):
        plan_service(harmful, LOST.service, SourceTable(harmful.network, [X]), predictor=knows)


THREE = models(
    law("y", "x", Error(0.1), name="first"),
    law("y", "2*x", Error(0.2), name="second"),
    law("y", "3*x", Error(0.3), name="third"),
)


@pytest.mark.parametrize(
    "measured, expected",
    [
        ({"first": 0.5, "second": 0.2}, ["second", "first", "third"]),
        ({"first": 0.5, "third": 0.2}, ["third", "second", "first"]),
        ({"first": 0.5}, ["first", "second", "third"]),  # of the others it is not known
        ({"first": 0.5, "second": 0.45}, ["first", "second", "third"]),  # that is not clear
        ({"first": 0.5, "second": 0.45, "third": 0.35}, ["third", "first", "second"]),
    ],
)
def test_errors_that_were_measured_count_before_those_predicted(
    measured: Mapping[str, float], expected: List[str]
) -> None:
    errors = {name: Error(rms, n=100) for name, rms in measured.items()}
    assert order(THREE, X, measured=errors) == expected
    found = {each.relations[0]: each.errors[0] for each in plans(THREE, X, measured=errors)}
    for name, error in errors.items():
        assert found[name] == error


def limited(limit: float) -> Service:
    (value,) = LOST.service.provides
    return replace(LOST.service, provides=(replace(value, fault_tolerant_error=limit),))


def test_what_errs_more_than_is_tolerated_is_not_used_and_it_is_said_why() -> None:
    unknown = law("y", "4*x", quality=0.9, name="promise")
    ontology = replace(THREE, functions=(*THREE.functions, unknown))
    assert order(ontology, X, lost=limited(0.4)) == ["first", "second", "promise"]
    assert order(ontology, X, lost=limited(0.1)) == ["promise"], "its error is not known"
    assert order(THREE, X, lost=limited(0.1)) == []
    table, knows = SourceTable(THREE.network, [X]), predictor(THREE, [X])
    with pytest.raises(NoSubstitute) as none:
        plan_service(THREE, limited(0.1), table, predictor=knows)
    why = "y by first: its error of 0.196 (p95) is above fault_tolerant_error, 0.1"
    assert str(none.value) == f"no substitute for y: {why}"
    assert none.value.refused == why and none.value.missing == ()
    # What was measured counts.
    measured = {"first": Error(0.5, p95=0.9), "third": Error(0.01, p95=0.02)}
    assert order(THREE, X, lost=limited(0.1), measured=measured) == ["third"]


def test_one_value_that_errs_too_much_stands_in_the_way_of_all() -> None:
    provides = (Provision("y", "y", fault_tolerant_error=0.3), Provision("w", "w"))
    lost = Service("both", "/both", "pkg/Type", "/n", 0.1, provides)
    ontology = models(
        *(law("y", f"{i}*x", Error(0.1 * i), name=f"y{i}") for i in (1, 2, 3)),
        *(law("w", f"{i}*z", Error(5.0), name=f"w{i}") for i in range(30)),
    )
    assert len(plans(ontology, X, Z, lost=lost)) == 30
    assert {each.relations[0] for each in plans(ontology, X, Z, lost=lost)} == {"y1"}


def test_another_sensor_without_figures_is_compared_by_its_quality() -> None:
    ontology = models(law("y", "x", Error(0.4, baseline=2.0), name="learned"))
    for quality, first in ((0.9, "/y/other/data"), (0.7, "learned")):
        other = sensor("y", None, "/other", quality)
        assert order(ontology, X, other)[0] == first
    # Nobody knows what share 0.4 is: then what measures comes first.
    ontology = models(law("y", "x", Error(0.4), name="learned"))
    assert order(ontology, X, sensor("y", None, "/other", 0.7))[0] == "/y/other/data"
    # One that has figures is compared by them.
    assert order(ontology, X, sensor("y", Error(0.5), "/other"))[0] == "learned"
    assert order(ontology, X, sensor("y", Error(0.3), "/other"))[0] == "/y/other/data"


def test_a_quality_follows_from_the_figures() -> None:
    ontology = models(law("y", "x", Error(0.5, baseline=2.0), 0.1))
    assert plans(ontology, X)[0].quality == 0.75


def test_each_value_of_a_service_is_derived_as_well_as_it_can_be() -> None:
    lost = Service(
        "both", "/both", "pkg/Type", "/n", 0.1, (Provision("y", "y"), Provision("w", "w"))
    )
    ontology = models(
        law("y", "x", Error(0.5), name="y1"),
        law("y", "z", Error(0.2), name="y2"),
        law("w", "x", Error(5.0), name="w1"),
        law("w", "z", Error(9.0), name="w2"),
    )
    found = plans(ontology, X, Z, lost=lost)
    assert found[0].relations == ("y2", "w1") and len(found) == 4
    assert [error.rms for error in found[0].errors if error] == [0.2, 5.0]
    assert found[-1].relations == ("y1", "w2")


def test_of_many_derivations_the_best_by_quality_are_compared() -> None:
    names = [f"s{i:03}" for i in range(MOST + 10)]
    functions = [
        law("y", name, Error(1.0 + i), quality=1.0 - 1e-3 * i, name="by_" + name)
        for i, name in enumerate(names)
    ]
    functions[MOST - 1] = replace(functions[MOST - 1], error=Error(0.2))
    functions[MOST] = replace(functions[MOST], error=Error(0.1))
    ontology = models(*functions)
    (found, *others) = plans(ontology, *(sensor(name, None) for name in names))
    assert found.relations == (f"by_s{MOST - 1:03}",) and not found.proven_best
    assert len(others) == MOST + 9, "the rest comes behind them"


def test_every_relation_has_its_turn_whatever_its_quality() -> None:
    names = [f"s{i:03}" for i in range(MOST + 10)]
    ontology = models(
        law("y", "p", Error(0.5), name="high"),
        law("y", "x", Error(0.1), quality=0.01, name="low"),
        *(law("p", name, Error(0.1), name="by_" + name) for name in names),
    )
    found = plans(ontology, X, *(sensor(name, None) for name in names))
    assert found[0].relations == ("low",) and not found[0].proven_best
    assert len(found) == MOST + 11


def test_what_relations_share_is_searched_once(monkeypatch: pytest.MonkeyPatch) -> None:
    ontology = models(*(law("y", f"{i}*x", Error(1.0), name=f"by_{i}") for i in range(20)))
    made: List[Ranking] = []

    def counted(*arguments: Any) -> Ranking:
        made.append(Ranking(*arguments))
        return made[-1]

    monkeypatch.setattr(choice, "Ranking", counted)
    table = SourceTable(ontology.network, [X])
    knows = predictor(ontology, [X])
    assert knows is not None
    number = ontology.network.number("y")
    found, complete = choice.compare(table, lambda function: True, number, knows)
    assert len(found) == 20 and complete
    assert len(made) == 1


def test_the_paper_s_method_stays_as_it_is() -> None:
    ontology = models(law("y", "x", Error(0.5), name="a"), law("y", "z", Error(0.2), name="b"))
    assert plans(ontology, X, Z, method="depth_first")[0].relations == ("a",)


def test_without_figures_nobody_predicts() -> None:
    plain = models(law("y", "x"))
    assert predictor(plain, [X]) is None
    assert isinstance(predictor(plain, [sensor("q", Error(1.0))]), Predictor)
    assert isinstance(predictor(models(law("y", "x", Error(1.0))), []), Predictor)


@pytest.mark.parametrize(
    "counts, expected",
    [
        ([2], [(0,), (1,)]),
        ([2, 2], [(0, 0), (0, 1), (1, 0), (1, 1)]),
        ([1, 3], [(0, 0), (0, 1), (0, 2)]),
        ([2, 0], []),
    ],
)
def test_choices_of_several_lists(
    counts: Sequence[int], expected: Sequence[Tuple[int, ...]]
) -> None:
    assert list(islice(joined(counts), 10)) == expected
