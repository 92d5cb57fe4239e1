"""What a user wishes of substitutes: relations to prefer, nodes to avoid."""
import json
import pathlib
from dataclasses import replace
from typing import Any, List, Sequence

import pytest
from som_trees import changed, som_of
from test_choice import LOST, X, Z, plans
from test_prediction import law, models, sensor

from shsa_core.cli.main import main
from shsa_core.codegen.plans import plan_service
from shsa_core.errors import ModelError
from shsa_core.files.som_file import som_parameters
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Source
from shsa_core.search.derivation import SourceTable


def order(
    ontology: Ontology, *sources: Source, prefer: Sequence[str] = (), avoid: Sequence[str] = ()
) -> List[str]:
    """By which relations each plan is, in the order in which they are tried."""
    lost = replace(LOST.service, prefer=tuple(prefer), avoid=tuple(avoid))
    return [" ".join(each.relations) for each in plans(ontology, *sources, lost=lost)]


def test_a_preferred_relation_comes_first_unless_it_does_harm() -> None:
    ontology = models(
        law("y", "x", Error(0.2, baseline=2.0), name="best"),
        law("y", "2*x", Error(0.9, baseline=2.0), name="poor"),
        law("y", "3*x", Error(2.5, baseline=2.0), name="harmful"),
        law("y", "4*x", name="unknown"),
    )
    assert order(ontology, X) == ["best", "poor", "unknown"]
    assert order(ontology, X, prefer=["poor"]) == ["poor", "best", "unknown"]
    assert order(ontology, X, prefer=["unknown"]) == ["unknown", "best", "poor"]
    assert order(ontology, X, prefer=["harmful"]) == ["best", "poor", "unknown"]
    both = order(ontology, X, prefer=["unknown", "poor"])
    assert both == ["poor", "unknown", "best"]  # among themselves as ever


def test_without_figures_the_others_stay_in_their_order() -> None:
    ontology = models(
        law("y", "x", quality=0.9, name="high"),
        law("y", "2*x", quality=0.8, name="middle"),
        law("y", "w", quality=0.7, name="low"),
        law("w", "z", name="way"),
    )
    other = sensor("y", None, "/other", 0.85)
    plain = ["high", "", "middle", "low way"]
    assert order(ontology, X, Z, other) == plain
    assert order(ontology, X, Z, other, prefer=["nothing"]) == plain
    assert order(ontology, X, Z, other, prefer=["way"]) == ["low way", "high", "", "middle"]


def test_what_reads_an_avoided_node_comes_last() -> None:
    ontology = models(
        law("y", "x", Error(0.2), name="good"), law("y", "z", Error(0.9), name="poor")
    )
    node = X.service.node
    assert order(ontology, X, Z, avoid=[node]) == ["poor", "good"]
    assert order(ontology, X, avoid=[node]) == ["good"]
    assert order(ontology, X, Z, avoid=[node], prefer=["good"]) == ["poor", "good"]


def test_of_what_is_as_good_the_cheaper_one_is_taken() -> None:
    ontology = models(
        law("y", "x", quality=0.9, name="a"),
        law("y", "z", quality=0.9, name="b"),
        law("y", "2*z", quality=0.8, name="c"),
        law("y", "w", quality=0.9, name="d"),
        law("w", "z", name="way"),
    )
    dear = replace(X, service=replace(X.service, cost=500))
    assert order(ontology, X, Z) == ["a", "b", "d way", "c"]
    assert order(ontology, dear, Z) == ["b", "a", "d way", "c"]
    assert order(ontology, dear, Z, avoid=[Z.service.node])[0] == "a"
    known = models(*(replace(each, error=Error(0.2)) for each in ontology.functions[:2]))
    assert order(known, X, Z) == ["a", "b"] and order(known, dear, Z) == ["b", "a"]
    one, other = sensor("y", None, "/a", 0.9), sensor("y", None, "/b", 0.9)
    (plan, *_) = plans(ontology, replace(one, service=replace(one.service, cost=2)), other)
    assert plan.inputs == (other,)


def test_depth_first_follows_what_is_preferred() -> None:
    ontology = models(
        law("y", "x", name="a"), law("y", "w", name="b"), law("w", "z", name="way"), law("y", "v")
    )

    def first(*sources: Source, prefer: Sequence[str]) -> List[str]:
        lost = replace(LOST.service, prefer=tuple(prefer))
        table = SourceTable(ontology.network, sources)
        return list(plan_service(ontology, lost, table, method="orr").relations)

    other, way = sensor("y", None, "/other"), sensor("w", None, "/way")
    assert first(X, Z, prefer=[]) == ["a"]
    assert first(X, Z, prefer=["b"]) == ["b", "way"]
    assert first(X, Z, way, prefer=["b"]) == ["b"]
    assert first(X, Z, way, prefer=["way"]) == ["b", "way"]
    assert first(X, Z, other, prefer=[]) == []
    assert first(X, Z, other, prefer=["b"]) == ["b", "way"]
    assert first(X, other, prefer=["b"]) == []


def test_common_causes_count_more_than_wishes() -> None:
    service = replace(LOST.service, fails_with=("hub",), host="pi", avoid=("/x",))
    assert service.avoided == (
        *(("hub", "pi", "/x"), ("hub", "pi")),
        *(("hub", "/x"), ("hub",)),
        ("/x",),
    )
    assert replace(service, avoid=()).avoided == (("hub", "pi"), ("hub",))


def test_wishes_stand_in_the_som() -> None:
    som = som_of(changed("avoid", ["camera", "/arm/left"]))
    (service,) = som
    assert service.avoid == ("/camera", "/arm/left")
    assert som_of(som_parameters(som)) == som
    assert som_of(changed("prefer", ["f1"])).services[service.name].prefer == ("f1",)
    for key, wrong in (("avoid", ["a b"]), ("avoid", "/camera"), ("prefer", [[]])):
        with pytest.raises(ModelError, match=key):
            som_of(changed(key, wrong))


BOAT = """\
properties: {current: , speed: , flow: }
relations:
  fit: {current: {function: 3*speed, quality: 0.9}}
  stream: {current: {function: 2*flow, quality: 0.8}}
  guess: {current: {function: 2.5*flow, quality: 0.5}}
"""
SENSOR = "{topic: /%s, type: p/T, node: /%s_node, period: 0.1, provides: {%s: {field: v}}}\n"


@pytest.fixture
def boat(tmp_path: pathlib.Path, capsys: Any) -> Any:
    def run(wish: str, command: str, *words: str, speed: str = "") -> str:
        lost = SENSOR % (3 * ("current",))
        lines = ["services:\n  current: " + lost.replace("period", f"needed: true, {wish}, period")]
        lines += [f"  {name}: {SENSOR % (3 * (name,))}" for name in ("speed", "flow")]
        lines[1] = lines[1].replace("period", f"{speed}period")
        ontology, som = tmp_path / "o.yaml", tmp_path / "s.yaml"
        ontology.write_text(BOAT)
        som.write_text("".join(lines))
        models_ = [str(ontology)] if command == "check" else ["--ontology", str(ontology)]
        main([command, *words, *models_, "--som", str(som)])
        return str(capsys.readouterr().out)

    return run


def test_find_shows_what_is_preferred(boat: Any) -> None:
    out = boat("prefer: [guess]", "find", "current", "--explain")
    assert "current: quality 0.5 by guess from /flow/v  (preferred: guess), proven best" in out
    assert "    quality 0.9 by fit from /speed/v\n    quality 0.8 by stream from /flow/v" in out
    answer = json.loads(boat("prefer: [guess]", "find", "current", "--json"))
    assert answer["relations"] == ["guess"] and answer["preferred"] == ["guess"]
    assert "preferred" not in json.loads(boat("prefer: [no]", "find", "current", "--json"))


def test_find_shows_what_is_to_be_avoided_last(boat: Any) -> None:
    wish = "avoid: [/speed_node]"
    out = boat(wish, "find", "current", "--explain")
    assert "current: quality 0.8 by stream from /flow/v, proven best" in out
    avoided = "quality 0.9 by fit from /speed/v  (to be avoided: /speed_node)"
    assert f"    quality 0.5 by guess from /flow/v\n    {avoided}" in out
    assert "dead branches" not in out
    out = boat(wish, "find", "current", "--method", "all")
    assert [line.split(" by ")[1].split()[0] for line in out.splitlines()] == [
        *("stream", "guess", "fit")
    ]
    out = boat(wish, "find", "current", "--explain", "--without", "/flow")
    assert f"current: {avoided}, proven best" in out
    whole = json.loads(boat(wish, "find", "/current_node", "--json", "--without", "/flow"))
    assert whole["services"][0]["to_avoid"] == ["/speed_node"]


def test_find_and_report_follow_all_wishes(boat: Any) -> None:
    def listed(wish: str) -> List[str]:
        lines = boat(wish, "find", "current", "--method", "all").splitlines()
        return [line.split(" by ")[1].split()[0] for line in lines]

    def reported(wish: str) -> List[str]:
        (service,) = json.loads(boat(wish, "report", "--json"))["services"]
        return [each["by"] for each in service["alternatives"]]

    for wish, first in (
        ("standby: cold", ["fit", "stream", "guess"]),
        ("prefer: [guess]", ["guess", "fit", "stream"]),
        ("avoid: [/speed_node]", ["stream", "guess", "fit"]),
        ("avoid: [/speed_node], prefer: [guess]", ["guess", "stream", "fit"]),
    ):
        assert listed(wish) == reported(wish) == first
    out = boat("prefer: [guess]", "find", "current", "--method", "orr")
    assert "by guess from /flow/v  (preferred: guess)" in out


def test_find_tells_what_a_service_costs(boat: Any) -> None:
    out = boat("cost: 3", "find", "current", "--explain", speed="cost: 40, ")
    assert "current: quality 0.9, cost 40 by fit from /speed/v" in out
    assert "speed  measured by /speed_node at /speed/v  (quality 1, cost 40)" in out
    assert "    quality 0.8 by stream" in out
    answer = json.loads(boat("cost: 3", "find", "current", "--json", speed="cost: 40, "))
    assert answer["cost"] == 40
    assert "cost must be a whole number from 1" in boat("cost: 0", "check")


def test_a_wish_of_what_is_not_there_is_told(boat: Any) -> None:
    out = boat("prefer: [fit, fat], avoid: [/flow_node, /nobody]", "check")
    assert "current prefers the relation fat, which is not there" in out
    assert "current avoids the node /nobody, which is not there" in out
    assert "relation fit" not in out and "/flow_node" not in out
