"""The schedule of chaos: which faults, of what, for how long, by a seed."""
from dataclasses import dataclass
from random import Random
from typing import Iterator, List, Mapping, Optional, Sequence, Tuple

PAIRS_SHARE = 0.3  # of the steps have faults of two nodes at once
LONGEST_APART_S = 0.2  # between the beginnings of the two
SHORTEST_S, LONGEST_S = 1.0, 4.0
MASTER_AWAY_S = (0.1, 2.0)
MASTER = "/master"
"""The name of the master in a schedule: no service has a name like this."""


@dataclass(frozen=True)
class Planned:
    """One fault of a step: `after` s from its beginning, for `seconds`. `target`: a service."""

    target: str
    fault: str
    seed: int
    after: float
    seconds: float


@dataclass(frozen=True)
class Step:
    """The faults that are made together; numbers count from 1."""

    number: int
    faults: Tuple[Planned, ...]


@dataclass(frozen=True)
class Card:
    """One fault that can be made, and the node that it is about."""

    target: str
    node: str
    fault: str


def cards(possible: Mapping[str, Sequence[str]], nodes: Mapping[str, str]) -> List[Card]:
    """Deal every possible fault: `possible` has the words of each target, `nodes` its node."""
    return [Card(each, nodes[each], word) for each in possible for word in possible[each]]


def schedule(seed: int, deck: Sequence[Card]) -> Iterator[Step]:
    """Yield the steps, without end: all cards in a random order, then all again in another one.

    A step has one card, or two of different nodes.
    """
    random = Random(f"chaos {seed}")
    waiting: List[Card] = []
    number = 0
    while deck:
        if not waiting:
            waiting = list(deck)
            random.shuffle(waiting)
        number += 1
        first = waiting.pop()
        chosen = [first]
        if random.random() < PAIRS_SHARE:
            second = _another(first, waiting)
            if second is not None:
                waiting.remove(second)
                chosen.append(second)
        apart = random.uniform(0.0, LONGEST_APART_S)
        yield Step(
            number,
            tuple(_planned(random, card, apart * place) for place, card in enumerate(chosen)),
        )


def _another(first: Card, waiting: Sequence[Card]) -> Optional[Card]:
    if first.target == MASTER:
        return None
    others = (each for each in reversed(waiting) if each.node != first.node)
    return next((each for each in others if each.target != MASTER), None)


def _planned(random: Random, card: Card, after: float) -> Planned:
    low, high = MASTER_AWAY_S if card.target == MASTER else (SHORTEST_S, LONGEST_S)
    return Planned(
        card.target,
        card.fault,
        random.randrange(2**31),
        round(after, 3),
        round(random.uniform(low, high), 3),
    )
