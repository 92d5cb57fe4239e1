"""A substitute advertises its topics, and tells others of them as seldom as that serves."""
from typing import Any, Dict, List

from substitute_driver import PERIOD, signal

from shsa_core.substitution.advertising import Advertising
from shsa_core.substitution.events import Command, Remind, Withdraw

COUNT, LOOKS = 100, 3


def prepared(pause: float = PERIOD) -> Advertising:
    """Many topics, advertised one after the other until the time 0."""
    advertising = Advertising()
    outputs = [signal(f"/topic_{number}") for number in range(COUNT)]
    advertising.prepare(outputs)
    for number, output in enumerate(outputs):
        advertising.advertised(output.topic, (number - COUNT) * pause)
    return advertising


def run(advertising: Advertising, until: float) -> List[Command]:
    """All that it wants by a moment."""
    said: List[Command] = []
    while advertising.next() < until:
        said += advertising.due(advertising.next())
    return said


def test_one_look_at_the_master_is_for_all_that_would_be_looked_at_soon() -> None:
    said = run(prepared(), 100.0)
    looks = [each.topics for each in said if isinstance(each, Remind)]
    times = [sum(f"/topic_{number}" in topics for topics in looks) for number in range(COUNT)]
    assert set(times) == {LOOKS}, "none is left out"
    assert len(looks) == LOOKS, "and not one a topic"


def test_who_is_in_a_hurry_waits_for_no_other() -> None:
    advertising = prepared()
    run(advertising, 10.0)
    advertising.hurry(signal("/topic_7"), 10.0)
    looks = run(advertising, 10.19)
    assert looks == [Remind(("/topic_7",))] * 2


def test_what_is_not_needed_any_more_is_withdrawn_one_by_one() -> None:
    advertising = prepared()
    run(advertising, 10.0)
    advertising.hurry(signal("/topic_7"), 10.0)
    begin = 10.2
    said = run(advertising, begin + 10 * 0.05 - 1e-6)
    assert len([each for each in said if isinstance(each, Withdraw)]) == 10
    run(advertising, 100.0)
    assert advertising.topics == ("/topic_7",)


class Unread(Dict[str, Any]):
    """May be asked for one topic, and not looked through."""

    def __iter__(self) -> Any:
        raise AssertionError("all topics were looked through")

    items = values = keys = __iter__


def test_what_is_not_due_costs_the_same_however_many_topics_there_are() -> None:
    advertising = prepared()
    run(advertising, 10.0)
    advertising._topics["/topic_7"] = False
    advertising._topics = Unread(advertising._topics)
    advertising.advertised("/topic_7", 10.0)
    assert advertising.next() > 10.0 and advertising.due(10.0) == []
