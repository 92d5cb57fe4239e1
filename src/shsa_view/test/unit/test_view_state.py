"""The document that the page shows, and the changes in it."""
import json
import math
from typing import Any, Dict

import pytest
from shsa_core.healing.incident import State
from shsa_view import facts
from shsa_view.state import STRIP_S, State as View
from view_facts import NODES, ONTOLOGY, SOM, SUBSTITUTE, gone, health, incident, substitute, well


def row(view: View, name: str = "ammeter") -> Dict[str, Any]:
    found: Dict[str, Any] = view.document(0.0)["services"][name]
    return found


def robot(view: View) -> Dict[str, str]:
    found: Dict[str, str] = view.document(0.0)["robot"]
    return found


def test_nothing_is_known_at_first() -> None:
    document = View("/robot1/", actions=True).document(5.0)
    assert (document["version"], document["now"]) == (1, 5.0)
    assert (document["namespace"], document["actions"]) == ("/robot1/", True)
    assert document["robot"]["state"] == "unknown"
    assert document["services"] == {} and document["incidents"] == []
    assert document["healing"]["monitor"] == "unknown"


def test_all_is_well() -> None:
    view = well()
    assert robot(view) == {"state": "well", "text": "All well. 3 services are watched."}
    told = row(view)
    assert (told["state"], told["publisher"], told["substitute"]) == ("well", "/ammeter", None)
    assert (told["standby"], told["needed"], told["period"]) == ("hot", True, 0.02)
    current = told["properties"]["current"]
    assert (current["unit"], current["symbol"], current["range"]) == ("A", "i", [0.0, 100.0])
    assert (current["value"], current["error_rms"]) == (None, 0.1)


def test_a_substitute_is_told_with_its_error_and_its_derivation() -> None:
    view = well()
    gone(view)
    told = row(view)
    assert (told["state"], told["publisher"]) == ("substituted", SUBSTITUTE)
    assert (told["substitute"], told["incident"]) == (SUBSTITUTE, 1)
    assert told["properties"]["current"]["error_rms"] == 0.25
    assert told["derivation"] == [
        *("property-current", "relation-law-current"),
        *("property-power", "service-wattmeter", "property-voltage", "service-voltmeter"),
    ]
    assert robot(view)["state"] == "substituted"
    assert view.document(0.0)["substitutes"][SUBSTITUTE]["publishing"]


def test_the_original_returns() -> None:
    view = well()
    gone(view)
    view.handle(facts.IncidentTold(incident(State.RETURNING)))
    assert row(view)["state"] == "returning"
    view.handle(facts.HealthTold("", (health("ammeter"),), whole=False))
    view.handle(facts.SubstitutesTold((), (SUBSTITUTE,), whole=False))
    view.handle(facts.IncidentTold(incident(State.ENDED, ended=110.0)))
    assert (row(view)["state"], row(view)["incident"]) == ("well", None)
    assert row(view)["derivation"] == []
    (told,) = view.document(0.0)["incidents"]
    assert (told["state"], told["moments"]["ended"], told["lost"]) == ("ended", 110.0, [])


@pytest.mark.parametrize(
    ("state", "word"),
    [
        (State.HEALING, "healing"),
        (State.UNHEALED, "not_healed"),
        (State.SAFE, "not_healed"),
        (State.KEPT, "kept"),
    ],
)
def test_what_is_not_healed_is_said(state: State, word: str) -> None:
    view = well()
    view.handle(facts.HealthTold("", (health("ammeter", "failed"),), whole=False))
    view.handle(facts.IncidentTold(incident(state)))
    assert row(view)["state"] == word
    assert robot(view)["state"] == "not_healed" and "ammeter" in robot(view)["text"]
    lost = view.document(0.0)["incidents"][0]["lost"]
    assert lost == ([] if state is State.KEPT else ["current"])


def test_a_failed_service_that_nobody_needs_leaves_the_robot_well() -> None:
    view = well()
    view.handle(facts.HealthTold("", (health("wattmeter", "failed", "silent"),), whole=False))
    assert (row(view, "wattmeter")["state"], robot(view)["state"]) == ("failed", "well")
    assert row(view, "wattmeter")["detail"] == "/wattmeter: silent"


def test_the_rest_is_well_only_if_everything_watched_is() -> None:
    view = well()
    gone(view)
    assert robot(view)["text"] == "ammeter has a substitute. The rest is well."
    view.handle(facts.HealthTold("", (health("wattmeter", "failed", "silent"),), whole=False))
    assert robot(view)["text"] == "ammeter has a substitute. Not well: wattmeter."
    view.handle(facts.HealthTold("", (), (("/voltage", "/voltmeter"),), whole=False))
    assert robot(view)["text"].endswith(" Not well: wattmeter. Not heard yet: voltmeter.")
    view = well()
    view.handle(facts.HealthTold("", (health("wattmeter", "failed", "silent"),), whole=False))
    text = "All that is needed is well. Not well: wattmeter."
    assert robot(view) == {"state": "well", "text": text}


def test_a_late_node_is_told_with_why_it_is_not_blamed() -> None:
    view = well()
    late = health("ammeter", detail="not blamed: its connection is made anew")
    view.handle(facts.HealthTold("", (late,), whole=False))
    assert (row(view)["state"], row(view)["detail"]) == ("well", f"/ammeter: {late.detail}")


def test_without_a_monitor_nothing_is_claimed() -> None:
    view = well()
    view.handle(facts.Healer("monitor", "lost", "monitor: it is gone"))
    document = view.document(0.0)
    assert document["robot"]["state"] == "unknown"
    assert {each["state"] for each in document["services"].values()} == {"unknown"}
    assert document["healing"]["text"] == "monitor: it is gone"


def test_maintenance_is_told() -> None:
    view = well()
    view.handle(facts.MaintenanceTold(True))
    assert "nothing is killed or started" in view.document(0.0)["healing"]["text"]
    view.handle(facts.MaintenanceTold(False))
    assert view.document(0.0)["healing"]["text"] == ""


def test_what_the_monitor_of_a_computer_tells_counts_as_long_as_it_is_heard() -> None:
    view = well()
    view.handle(facts.HealthTold("", (), tuple((t, f"/{n}") for n, t in NODES.items()), False))
    view.handle(facts.Healer("monitor_pi", "alive"))
    view.handle(facts.HealthTold("pi", tuple(map(health, NODES))))
    assert row(view)["state"] == "well"
    view.handle(facts.Healer("monitor_pi", "lost"))
    assert row(view)["state"] == "unknown"


def test_without_a_reconfigurator_no_incident_is_open_until_it_is_told_again() -> None:
    view = well()
    view.handle(facts.IncidentTold(incident(State.HEALING)))
    view.handle(facts.Healer("reconfigurator", "lost", connected=False))
    assert row(view)["state"] == "well" and robot(view)["state"] == "unknown"
    view.handle(facts.IncidentTold(incident(State.HEALING)))
    assert row(view)["state"] == "healing"


def test_figures_are_of_who_publishes() -> None:
    view = well()
    rates = {"/ammeter": 49.5, "/stranger": 3.0}
    view.handle(facts.FiguresTold((facts.Figures("ammeter", rates, {"current": 2.5}, 3),)))
    assert row(view)["rate"] == 49.5 and row(view)["bridged"] == 3
    assert row(view)["properties"]["current"]["value"] == 2.5
    gone(view)
    assert row(view)["rate"] is None


def test_what_becomes_of_a_node_is_told_before_it_fails() -> None:
    view = well()
    assert row(view)["fate"] == ""
    view.handle(facts.DutiesTold("ammeter", "takes /cmd_vel"))
    assert row(view)["fate"] == "is kept: it takes /cmd_vel, which nothing takes over"
    view.handle(facts.DutiesTold("ammeter", ""))
    assert "is killed if something replaces it" in row(view)["fate"]


def test_a_strip_has_a_letter_a_second() -> None:
    view = well()
    view.second(1.0)
    gone(view)
    for _ in range(2):
        view.second(1.0)
    assert row(view)["strip"] == "wss"
    for _ in range(STRIP_S):
        view.second(1.0)
    assert row(view)["strip"] == "s" * STRIP_S


def test_changes_are_whole_rows_of_what_has_changed_alone() -> None:
    view = well()
    first = view.changes(1.0)
    assert first is not None and set(first["services"]) == set(NODES)
    assert view.changes(1.1) is None
    gone(view)
    change = view.changes(1.2)
    assert change is not None and change["now"] == 1.2
    assert set(change) == {"now", "robot", "services", "substitutes", "incidents"}
    assert change["services"] == {"ammeter": row(view)}
    assert [each["state"] for each in change["incidents"]] == ["healed"]
    assert view.changes(1.3) is None


def test_what_is_told_again_is_no_change() -> None:
    view = well()
    gone(view)
    view.changes(1.0)
    view.handle(facts.HealthTold("", (health("ammeter", "failed", "it is gone"),), whole=False))
    view.handle(facts.SubstitutesTold((substitute(publishing=True),), whole=False))
    view.handle(facts.IncidentTold(incident(State.HEALED, first_message=100.1)))
    assert view.changes(1.1) is None


def test_a_service_that_left_is_told_as_null() -> None:
    view = well()
    view.changes(1.0)
    kept = [each for each in SOM if each.name != "wattmeter"]
    view.handle(facts.ModelsRead(ONTOLOGY, SOM.with_services(kept)))
    view.handle(facts.ServicesTold((), ("wattmeter",), whole=False))
    change = view.changes(1.1)
    assert change is not None and change["services"]["wattmeter"] is None
    assert "wattmeter" not in view.document(1.1)["services"]


def test_a_plan_is_no_process() -> None:
    view = well()
    view.handle(facts.SubstitutesTold((substitute(False, node=""),)))
    assert view.document(0.0)["substitutes"] == {}


def test_a_whole_table_replaces_the_former_one() -> None:
    view = well()
    gone(view)
    view.handle(facts.SubstitutesTold(()))
    view.handle(facts.HealthTold("", (health("ammeter"),)))
    assert view.document(0.0)["substitutes"] == {}
    assert row(view, "voltmeter")["state"] == "unknown"


def test_the_document_is_json_whatever_a_number_is() -> None:
    view = well()
    view.handle(facts.IncidentTold(incident(State.HEALED, quality=math.nan, found=math.inf)))
    text = json.dumps(view.document(0.0), allow_nan=False)
    assert json.loads(text)["incidents"][0]["quality"] is None
