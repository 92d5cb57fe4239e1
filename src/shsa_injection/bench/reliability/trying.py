"""Trials on a healthy robot, and on a new one after a trial that did not hold."""
import random
from dataclasses import replace
from typing import Callable, Iterator, Sequence

from graph import Graph
from reliability.rig import Rig
from reliability.scoreboard import Figures, Trial

Deed = Callable[[Rig, random.Random], Figures]


def attempt(line: int, seed: int, deed: Callable[[], Figures]) -> Trial:
    """Return a trial by a deed that raises AssertionError if what must hold does not."""
    try:
        return Trial(line, seed, True, deed())
    except AssertionError as error:
        return Trial(line, seed, False, {}, str(error) or "an assertion failed")


def each(
    graph: Graph, line: int, seeds: Sequence[int], deed: Deed, **settings: object
) -> Iterator[Trial]:
    """Yield the trials of a deed, one after the other on one robot as long as they hold."""
    left = list(seeds)
    while left:
        with Rig(graph, **settings) as rig:
            while left:
                seed = left.pop(0)
                trial = attempt(line, seed, lambda: deed(rig, random.Random(seed)))
                if trial.held:
                    figures = {**trial.figures, "both heard": rig.both_heard}
                    yield replace(trial, figures=figures)
                    continue
                told = [f"{each.topic} {each.state}: {each.detail}" for each in rig.open()]
                words = "\n".join([trial.why, *told, graph.last_words()])
                yield replace(trial, why=words)
                break
