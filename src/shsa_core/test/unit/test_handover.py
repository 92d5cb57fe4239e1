"""A substitute hands over to its returning original: whom it still serves, and when it waits."""
from typing import Any, List

from substitute_driver import PERIOD, Driver, only, row, running, served
from shsa_core.model.substitution import CHANGEOVER_S
from shsa_core.substitution import events


def standing_in() -> Driver:
    """A substitute that publishes in place of /node, which is not there."""
    driver = running(publishing=True, original="/node")
    driver.pass_to(PERIOD)
    return driver


def answer(driver: Driver, *consumers: str, up: bool = True) -> List[Any]:
    """Answer the last look."""
    look = only([command for _, command in driver.said], events.LookAtOriginal)[-1]
    return driver.tell(
        events.OriginalServes, look, frozenset(consumers) if up or consumers else None
    )


def due(driver: Driver, number: int) -> List[Any]:
    """Let time pass to the message of that number, with a fresh input."""
    driver.pass_to(number * PERIOD - 0.001)
    driver.arrive(1.0)
    return driver.pass_to(number * PERIOD)


def test_while_the_original_is_not_up_no_message_waits() -> None:
    driver = standing_in()
    answer(driver, up=False)
    assert served(due(driver, 2)) == [frozenset()]


def test_once_the_original_is_up_a_message_waits_for_a_look_at_whom_it_serves() -> None:
    driver = standing_in()
    answer(driver)
    commands = due(driver, 2)
    assert only(commands, events.LookAtOriginal) and not served(commands)
    assert served(answer(driver, "/early")) == [frozenset({"/early"})]


def test_an_original_that_serves_nobody_yet_and_does_not_answer_costs_half_a_period() -> None:
    driver = standing_in()
    answer(driver)
    assert not served(due(driver, 2))
    assert served(driver.pass_to(2.5 * PERIOD)) == [frozenset()]
    assert not served(answer(driver))  # it comes late, and the message has gone


def test_once_the_original_is_heard_nobody_is_served_before_it_is_known_who_hears_it() -> None:
    driver = standing_in()
    answer(driver, "/early")
    assert not served(due(driver, 2)) and not served(driver.pass_to(2.9 * PERIOD))
    assert served(answer(driver, "/early", "/late")) == [frozenset({"/early", "/late"})]


def test_a_muted_substitute_serves_only_those_whom_a_later_look_finds_unserved() -> None:
    driver = standing_in()
    answer(driver, up=False)
    driver.change(row(False, original="/node"))
    assert not served(due(driver, 2))
    assert served(answer(driver, "/early")) == [frozenset({"/early"})]
    assert not served(due(driver, 3)) and not served(due(driver, 4))  # nobody has answered
    assert not served(driver.pass_to(CHANGEOVER_S + 1.0))


def test_a_muted_substitute_publishes_nothing_that_was_not_due() -> None:
    driver = standing_in()
    driver.change(row(False, original="/node"))
    assert not served(answer(driver, "/early"))


def test_a_message_that_waits_goes_to_nobody_once_it_is_muted_unless_somebody_looks() -> None:
    driver = standing_in()
    answer(driver)
    assert not served(due(driver, 2))
    driver.change(row(False, original="/node"))
    assert not served(driver.pass_to(2.9 * PERIOD))
    assert served(answer(driver, "/early")) == [frozenset({"/early"})]


def test_an_original_that_is_gone_again_leaves_every_consumer_to_the_substitute() -> None:
    driver = standing_in()
    answer(driver, "/early")
    assert not served(due(driver, 2))
    assert served(answer(driver, up=False)) == [frozenset()]
    assert served(due(driver, 3)) == [frozenset()]


def test_a_message_that_waited_does_not_go_once_its_input_is_stale() -> None:
    driver = standing_in()
    answer(driver, "/early")
    assert not served(due(driver, 2))
    driver.pass_to(2.0)
    assert not served(answer(driver))
