"""Values over time, the last hour, remedies, witnesses and metrics."""
from typing import Any, Dict

import pytest
from shsa_core.healing.incident import State
from shsa_core.model.kinds import Kind
from shsa_view import facts, history, metrics
from shsa_view.state import State as View
from shsa_view.witnesses import WitnessTable
from view_facts import ONTOLOGY, SOM, gone, incident, well

Document = Dict[str, Any]
EVIDENCE = "current is 71, allowed 0 to 60 (3 of 3 messages)"


def row(view: View, name: str = "ammeter") -> Document:
    return dict(view.document(1.0)["services"][name])


def figures(view: View, **values: float) -> None:
    """Tell the newest values of properties."""
    of = {"current": "ammeter", "voltage": "voltmeter", "power": "wattmeter"}
    rows = (facts.Figures(of[name], {}, {name: value}) for name, value in values.items())
    view.handle(facts.FiguresTold(tuple(rows)))


def test_values_of_sensor_substitute_and_witness_over_time() -> None:
    view = well()
    figures(view, current=2.0, voltage=12.0, power=24.0)
    view.second(10.0)
    gone(view)
    figures(view, current=2.1)
    view.second(11.0)
    told = view.history.values("ammeter")
    assert told["times"] == [10.0, 11.0] and told["substituted"] == [False, True]
    current = told["properties"]["current"]
    assert current["values"] == [2.0, 2.1]
    assert current["errors"] == [0.1, 0.25]
    assert current["witnesses"] == {"law": [2.0, 2.0]}
    assert view.history.values("nobody")["times"] == []


def test_a_relation_with_a_value_of_its_own_service_is_no_witness() -> None:
    table = WitnessTable(ONTOLOGY, SOM)
    known = {"power": 24.0, "voltage": 12.0}
    assert table.values(["current"], known) == {"current": {"law": 2.0}}
    assert table.values(["current", "power"], known) == {}
    assert table.values(["current"], {"power": 24.0}) == {}
    assert table.values(["current"], {"power": 24.0, "voltage": 0.0}) == {}


def test_values_are_kept_for_minutes_and_around_an_incident_for_longer() -> None:
    view = well()
    for second in range(90, 100):
        view.second(float(second))
    gone(view)
    for second in range(100, 700):
        view.second(float(second))
    newest = view.history.values("ammeter")
    assert newest["times"][0] == 399.0 and newest["incident"] is None
    (key,) = (each["key"] for each in view.document(1.0)["incidents"])
    around = view.history.values("ammeter", key)
    assert around["incident"] == key
    assert (around["times"][0], around["times"][-1]) == (90.0, 160.0)
    view.second(5.0)
    assert view.history.values("ammeter")["times"] == [5.0], "time ran backwards"


def test_the_last_hour_as_json_and_as_csv() -> None:
    view = well()
    view.second(90.0)
    gone(view)
    view.second(101.0)
    view.second(110.0)
    told = view.timeline(120.0)
    assert told["services"]["ammeter"] == [[90.0, "well"], [101.0, "substituted"]]
    (happened,) = told["incidents"]
    assert (happened["service"], happened["from"], happened["to"]) == ("ammeter", 100.0, None)
    lines = history.as_csv(told).splitlines()
    assert lines[0] == "what,service,from,to,state"
    assert "state,ammeter,90.0,101.0,well" in lines
    assert "incident,ammeter,100.0,,node_gone" in lines
    view.second(101.0 + history.HOUR_S + 1)
    later = view.timeline(101.0 + history.HOUR_S + 1)
    assert later["services"]["ammeter"] == [[102.0, "substituted"]]
    assert later["incidents"] == []


def test_a_name_in_the_csv_is_no_formula() -> None:
    told = {"now": 2.0, "services": {"=1+1": [[1.0, "well"]]}, "incidents": []}
    assert history.as_csv(told).splitlines()[1] == "state,'=1+1,1.0,2.0,well"


def test_why_and_what_to_do_about_a_node_that_is_gone() -> None:
    view = well()
    assert (row(view)["why"], row(view)["remedies"]) == ("", [])
    view.handle(facts.CommandsTold({"/ammeter": "rosrun a b __name:=ammeter"}))
    gone(view)
    assert row(view)["why"] == "it is gone"
    (remedy,) = row(view)["remedies"]
    assert remedy == {"text": "Start /ammeter again:", "command": "rosrun a b __name:=ammeter"}


def test_why_and_what_to_do_about_a_wrong_value() -> None:
    view = well()
    told = {"kind": Kind.OUT_OF_RANGE, "evidence": EVIDENCE, "missing": ("power",)}
    view.handle(facts.IncidentTold(incident(State.KEPT, kept_out=True, **told)))
    assert row(view)["why"] == EVIDENCE
    texts = {each["text"]: each["command"] for each in row(view)["remedies"]}
    assert texts["/ammeter is kept out. Repair it and restart healing, or, by operator:=true:"] == (
        "rosservice call /shsa/release /current"
    )
    assert texts["End /ammeter, if it does not recover:"] == "rosnode kill /ammeter"
    assert texts["Bring back what a substitute needs: power."] == ""
    (where,) = (typed for text, typed in texts.items() if text.startswith("Or correct"))
    path, _, line = where.rpartition(":")
    assert "current:" in open(path, encoding="utf-8").read().splitlines()[int(line) - 1]


def test_who_is_spared_is_told_with_the_reason() -> None:
    view = well()
    late = facts.Publisher("/current", "/ammeter", "healthy", detail="not blamed: the link is down")
    view.handle(facts.HealthTold("", (late,), whole=False))
    assert row(view)["why"] == "/ammeter: not blamed: the link is down"


def test_metrics() -> None:
    view = well()
    figures(view, current=2.0)
    gone(view)
    told = metrics.text(view.document(1.0)).splitlines()
    assert 'shsa_up{part="monitor"} 1' in told
    assert 'shsa_service_state{service="ammeter",topic="/current",state="substituted"} 1' in told
    assert 'shsa_service_state{service="ammeter",topic="/current",state="well"} 0' in told
    assert "shsa_incidents_open 1" in told
    assert 'shsa_incidents{service="ammeter",kind="node_gone"} 1' in told
    assert any(line.startswith('shsa_value{service="ammeter",property="current"') for line in told)
    assert not [line for line in told if line.endswith(" None") or line.endswith(" nan")]


@pytest.mark.parametrize("name", ['a"b', "a\\b", "a\nb"])
def test_a_name_does_not_end_a_label(name: str) -> None:
    document = {**well().document(1.0), "healing": {name: "alive"}}
    line = metrics.text(document).splitlines()[2]
    escaped = name.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
    assert line == f'shsa_up{{part="{escaped}"}} 1'
