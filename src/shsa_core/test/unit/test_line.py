"""Texts over a line arrive in order and each once, whatever the line does to them."""
import random
from typing import List, Tuple

import pytest

from shsa_core.ros.agent.line import Line, Numbered
from shsa_core.ros.settings import SILENT_S as RESEND_S


def test_what_is_said_is_numbered_and_said_again_until_it_was_heard() -> None:
    line = Line()
    assert line.say("a", 0.0) == Numbered(1, "a")
    assert line.say("b", 0.1) == Numbered(2, "b")
    assert line.again(RESEND_S - 0.01) == []
    assert line.again(RESEND_S) == [Numbered(1, "a"), Numbered(2, "b")]
    assert line.again(RESEND_S + 0.01) == []  # not again at once
    line.hear(0, 1, 0.3)
    assert line.again(0.3 + RESEND_S) == [Numbered(2, "b")]
    assert line.since == 0.3
    line.hear(0, 2, 1.0)
    assert line.since is None and line.again(9.0) == []


def test_what_comes_twice_or_too_early_is_dropped() -> None:
    line = Line()
    assert line.hear(1, 0, 0.0)
    assert not line.hear(1, 0, 0.0)
    assert not line.hear(3, 0, 0.0)
    assert line.heard == 1
    assert line.hear(2, 0, 0.0) and line.hear(3, 0, 0.0)


@pytest.mark.parametrize("seed", range(20))
def test_nothing_is_lost_over_a_line_that_loses_doubles_and_delays(seed: int) -> None:
    chance = random.Random(seed)
    here, there = Line(), Line()
    wires: Tuple[List[Tuple[int, int, str]], List[Tuple[int, int, str]]] = [], []
    said = [str(number) for number in range(50)]
    heard: List[str] = []
    rest, now = list(said), 0.0
    while len(heard) < len(said):
        now += 0.01
        assert now < 300.0
        out = [here.say(rest.pop(0), now)] if rest and chance.random() < 0.5 else []
        for number, text in [*out, *here.again(now)]:
            wires[0].append((number, here.heard, text))
        wires[1].append((0, there.heard, ""))
        for wire, end in zip(wires, (there, here)):
            chance.shuffle(wire)
            for each in [message for message in wire if chance.random() < 0.3]:
                if chance.random() < 0.8:
                    wire.remove(each)  # else it comes again
                if chance.random() < 0.3:
                    continue  # it is lost, or late
                if end.hear(each[0], each[1], now):
                    heard.append(each[2])
    assert heard == said
