"""The gate doubts an event-driven node only by what its substitute has said of late."""
from dataclasses import replace

from gate_stand import GATED, NODE, SUBSTITUTE, Stand, with_value_checks
from shsa_core.model.checks import Witness


def doubting() -> Stand:
    """Return a stand whose event-driven node jumps to 7, which its substitute does not see."""
    stand = Stand(replace(GATED, period=None, provides=(with_value_checks(Witness(4.0)),)))
    stand.substitute()
    for time, value, node in ((0.1, 2.0, SUBSTITUTE), (0.2, 1.0, NODE), (0.3, 7.0, NODE)):
        stand.until(time)
        stand.message(value, node)
    return stand


def test_no_event_is_doubted_by_what_a_substitute_said_long_before() -> None:
    stand = doubting()
    assert stand.values() == [1.0], "the substitute did not see the jump"
    stand.until(60.0)
    assert stand.message(7.0)


def test_what_an_old_value_did_not_doubt_is_believed_on() -> None:
    stand = doubting()
    for time, value, node in ((20.0, 7.0, NODE), (30.0, 7.0, NODE), (40.0, 2.0, SUBSTITUTE)):
        stand.until(time)
        stand.message(value, node)
    stand.until(40.1)
    assert stand.message(7.0)


def test_a_doubt_lasts_as_long_after_one_that_an_old_value_ended() -> None:
    stand = doubting()
    for time, value, node in ((60.0, 1.5, NODE), (99.9, 2.0, SUBSTITUTE)):
        stand.until(time)
        stand.message(value, node)
    for time in (100.0, 100.1, 100.2):
        stand.until(time)
        stand.message(20.0)
    assert 20.0 not in stand.values()
