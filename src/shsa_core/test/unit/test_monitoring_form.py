"""Frames and lengths of arrays: what is learned of them, when they fail, and what is only told."""
from dataclasses import replace
from typing import Any, Tuple

import pytest

from monitor_bench import NODE, PERIOD, TOPIC, Bench, service
from shsa_core.model.samples import Part
from shsa_core.monitoring.events import Message

Form = Tuple[Tuple[str, Part], ...]
FRAME, RANGES = "header.frame_id", "ranges"
SCAN: Form = ((FRAME, "laser"), (RANGES, 360))


def say(bench: Bench, form: Form, count: int = 60, node: str = NODE) -> Bench:
    for _ in range(count):
        bench.wait(PERIOD)
        bench.send(Message(bench.now, TOPIC, node, (1.0,), form=form))
    return bench


def scanning(form: Form = SCAN, **changes: Any) -> Bench:
    bench = Bench(service(**changes))
    bench.connect(uri="one")
    return say(bench, form)


@pytest.mark.parametrize(
    "form, kind, told",
    [
        (((FRAME, "map"), (RANGES, 360)), "frame", "header.frame_id is 'map', and was 'laser'"),
        (((FRAME, ""), (RANGES, 360)), "frame", "header.frame_id is '', and was 'laser'"),
        (((FRAME, "laser"), (RANGES, 359)), "length", "ranges has 359 elements, and had 360"),
        (((FRAME, "laser"), (RANGES, 0)), "length", "ranges has 0 elements, and had 360"),
    ],
)
def test_another_form_is_found_and_good_again(form: Form, kind: str, told: str) -> None:
    bench = say(scanning(), form, 3)
    assert bench.kinds() == [(NODE, kind)] and bench.failures[0].detail.startswith(told)
    say(bench, form, 300)
    assert bench.state() == "failed" and len(bench.failures) == 1
    say(bench, SCAN, 5)
    assert bench.state() == "healthy"


@pytest.mark.parametrize(
    "first, then",
    [
        (((FRAME, "a"),), ((FRAME, "b"),)),  # both from the start
        (((RANGES, 100),), ((RANGES, 300),)),  # a cloud of as many points as are seen
        (((RANGES, 1),), ((RANGES, 0),)),
        (((RANGES, 0),), ((RANGES, 5),)),
    ],
)
def test_what_varies_from_the_start_may_go_on_to(first: Form, then: Form) -> None:
    bench = Bench(service())
    bench.connect()
    for _ in range(200):
        say(bench, first, 1)
        say(bench, then, 1)
    say(bench, ((FRAME, "c"), (RANGES, 0)))
    assert bench.failures == []


def test_the_only_element_of_an_array_that_is_no_longer_there_is_missed() -> None:
    bench = say(scanning((("position", 1),)), (("position", 0),), 3)
    assert bench.kinds() == [(NODE, "length")]


def test_a_longer_array_and_a_part_that_is_missing_are_no_failure() -> None:
    bench = say(scanning(), ((FRAME, "laser"), (RANGES, 720)))
    say(bench, ())
    say(bench, (("other", 1),))
    assert bench.failures == []


def test_who_names_a_frame_later_than_it_speaks_is_not_blamed() -> None:
    """As one that localizes itself; the frame that it named at first is held against nobody."""
    for first in ("", "laser"):
        bench = say(scanning(((FRAME, first), ("child_frame_id", ""))), ((FRAME, first),))
        say(bench, ((FRAME, first or "map"), ("child_frame_id", "base_link")))
        assert bench.failures == [] and bench.state() == "healthy"


def test_an_array_that_was_longer_once_varies_and_may_be_shorter() -> None:
    """A list of what is seen has as many elements as long as the robot stands."""
    bench = say(scanning(), ((FRAME, "laser"), (RANGES, 361)), 1)
    say(bench, ((FRAME, "laser"), (RANGES, 2)))
    assert bench.failures == [] and bench.state() == "healthy"
    say(bench, ((FRAME, "map"), (RANGES, 2)), 3)
    assert bench.kinds() == [(NODE, "frame")]


def test_too_few_messages_tell_nothing() -> None:
    bench = Bench(service())
    bench.connect()
    say(bench, SCAN, 49)
    say(bench, ((FRAME, "map"), (RANGES, 10)))
    assert bench.failures == []


def test_another_process_of_the_node_may_have_another_form() -> None:
    bench = scanning()
    bench.disconnect()
    bench.connect(uri="two")
    say(bench, ((FRAME, "laser"), (RANGES, 180)))
    assert [each.kind for each in bench.failures] == ["node_gone"] and bench.state() == "healthy"


def test_a_silence_and_another_connection_teach_nothing_else() -> None:
    bench = scanning()
    bench.wait(1.0)
    bench.send(replace(Message(bench.now, TOPIC, NODE, (1.0,)), form=SCAN))
    say(bench, SCAN, 10)
    assert bench.state() == "healthy"
    say(bench, ((FRAME, "map"), (RANGES, 360)), 3)
    assert [str(each.kind) for each in bench.failures] == ["silent", "frame"]


def test_the_form_of_a_substitute_and_of_event_driven_topics_is_not_judged() -> None:
    bench = Bench(service())
    bench.substitutes(("/substitute", True))
    bench.connect("/substitute")
    say(bench, SCAN, node="/substitute")
    say(bench, ((FRAME, "map"), (RANGES, 0)), node="/substitute")
    assert bench.failures == []
    assert say(scanning(period=None), ((FRAME, "map"), (RANGES, 0))).failures == []
