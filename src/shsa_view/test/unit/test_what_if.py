"""The robot without a service or a node; and the drawing."""
from dataclasses import replace
from typing import Any, Dict
from xml.etree import ElementTree

import pytest
from shsa_core.errors import ShsaError
from shsa_core.language.expression import parse_law
from shsa_core.model.ontology import Ontology, Property, TransferFunction
from shsa_core.model.som import Som
from shsa_view import graph
from shsa_view.what_if import answer, concerned, cut_sets
from view_facts import ONTOLOGY, SOM


def told(found: bool, name: str = "ammeter") -> Dict[str, Any]:
    return {
        "service": name,
        "found": found,
        "relations": ["law"] if found else [],
        "quality": 0.9 if found else None,
        "missing": [] if found else ["power"],
        "detail": "",
    }


def test_the_services_of_a_node_are_concerned() -> None:
    assert [each.name for each in concerned(SOM, "ammeter", "")] == ["ammeter"]
    assert [each.name for each in concerned(SOM, "", "/voltmeter")] == ["voltmeter"]
    with pytest.raises(ShsaError, match="no node '/nobody'"):
        concerned(SOM, "", "/nobody")


def test_a_node_is_in_a_cut_set_with_each_that_it_needs_then() -> None:
    assert cut_sets(ONTOLOGY, SOM, "/ammeter") == {
        ("/ammeter", "/voltmeter"): ["ammeter", "voltmeter"],
        ("/ammeter", "/wattmeter"): ["ammeter"],
    }


def test_without_relations_a_node_is_a_cut_set_alone() -> None:
    bare = Ontology(ONTOLOGY.properties, {}, ())
    assert cut_sets(bare, SOM, "/ammeter") == {("/ammeter",): ["ammeter"]}


def test_what_is_left_is_said_in_words() -> None:
    cuts = cut_sets(ONTOLOGY, SOM, "/ammeter")
    found = answer("What if ammeter failed?", [told(True)], cuts)
    assert found["cut_sets"] == [["/ammeter", "/voltmeter"], ["/ammeter", "/wattmeter"]]
    assert found["left"] == (
        "ammeter would be computed by law, quality 0.9. "
        "If /voltmeter failed as well, ammeter and voltmeter could not be healed. "
        "If /wattmeter failed as well, ammeter could not be healed."
    )


def test_a_loss_is_said_with_what_is_missing() -> None:
    found = answer("", [told(False)], {("/ammeter",): ["ammeter"]})
    assert found["left"] == "ammeter could not be healed (missing: power)."


def test_functions_of_a_property_come_by_the_name_of_their_relation() -> None:
    functions = [
        TransferFunction(name, "a", (), parse_law("1"), 1.0, text="1") for name in ("s", "r")
    ]
    ontology = Ontology({"a": Property("a"), "b": Property("b")}, {}, tuple(functions))
    assert [each.relation for each in graph.functions_for(ontology, "a")] == ["r", "s"]
    assert graph.functions_for(ontology, "b") == graph.functions_for(ontology, "nothing") == ()


def test_the_drawing_has_an_id_for_every_element() -> None:
    drawn = graph.drawing(ONTOLOGY, SOM)
    assert drawn["error"] == "" and drawn["svg"].startswith("<svg")
    ids = {each.get("id") for each in ElementTree.fromstring(drawn["svg"]).iter()}
    assert {"service-ammeter", "property-power", "relation-law-voltage", "edge-11"} <= ids
    assert {"id": "edge-0", "from": "service-ammeter", "to": "property-current"} in drawn["edges"]
    assert len(drawn["edges"]) == 3 + 9


def test_a_hostile_name_stays_text() -> None:
    hostile = replace(next(iter(SOM)), name='<script>"]', topic="</svg>&<b>")
    drawn = graph.drawing(Ontology({}, {}, ()), Som([hostile]))
    assert drawn["error"] == "" and "<script" not in drawn["svg"]
    ids = {each.get("id") for each in ElementTree.fromstring(drawn["svg"]).iter()}
    assert 'service-<script>"]' in ids


def test_what_cannot_be_read_is_not_drawn(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(graph, "MOST_ELEMENTS", 3)
    assert "at most 3" in graph.drawing(ONTOLOGY, SOM)["error"]
    monkeypatch.setenv("PATH", "/nowhere")
    assert "graphviz" in graph.drawing(Ontology({}, {}, ()), Som())["error"]
