"""The incidents that are shown."""
from shsa_core.healing.incident import State
from shsa_view.incidents import MOST, Incidents
from view_facts import incident


def test_steps_of_one_incident_are_one() -> None:
    incidents = Incidents()
    incidents.add(incident(State.HEALING, detected=100.0))
    incidents.add(incident(State.ENDED, detected=100.000001))
    (told,) = incidents.newest_first()
    assert (told["key"], told["state"]) == ("100000-1", "ended")


def test_the_same_number_after_a_restart_is_another_incident() -> None:
    incidents = Incidents()
    incidents.add(incident(State.ENDED, detected=100.0))
    incidents.add(incident(State.HEALING, detected=200.0))
    assert [each["key"] for each in incidents.newest_first()] == ["200000-1", "100000-1"]
    found = incidents.open_of("ammeter")
    assert found is not None and found[0] == "200000-1"


def test_what_the_log_says_is_shown_and_nobody_works_on_it() -> None:
    incidents = Incidents()
    incidents.add(incident(State.HEALED), logged=True)
    assert incidents.open_of("ammeter") is None
    assert [each["state"] for each in incidents.newest_first()] == ["healed"]


def test_what_is_told_counts_for_more_than_the_log() -> None:
    incidents = Incidents()
    incidents.add(incident(State.RETURNING))
    incidents.add(incident(State.HEALED), logged=True)
    found = incidents.open_of("ammeter")
    assert found is not None and found[1].state is State.RETURNING


def test_only_the_newest_are_kept() -> None:
    incidents = Incidents()
    for number in range(MOST + 5):
        incidents.add(incident(State.ENDED, id=number, detected=100.0 * number))
    assert len(incidents.newest_first()) == MOST
    assert incidents.newest_first()[-1]["id"] == 5


def test_changes_are_told_once() -> None:
    incidents = Incidents()
    incidents.add(incident(State.HEALING))
    assert len(incidents.take_changed()) == 1
    incidents.add(incident(State.HEALING))
    assert incidents.take_changed() == []


def test_text_is_on_one_line_and_not_endless() -> None:
    incidents = Incidents()
    incidents.add(incident(State.HEALING, detail="a\nb\x1b" + "c" * 5000, code="a\nb\x1b"))
    (told,) = incidents.newest_first()
    assert told["detail"].startswith("a\\nb\\x1bccc") and len(told["detail"]) < 1100
    assert told["code"] == "a\nb\\x1b"
