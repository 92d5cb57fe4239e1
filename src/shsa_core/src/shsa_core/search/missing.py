"""Finds the properties that a lost property lacks."""
from itertools import chain
from typing import Callable, Dict, Iterable, Iterator, List, Sequence, Set, Tuple

Functions = Callable[[int], Sequence[Iterable[int]]]
"""The lost inputs of each function that yields a property: all of them are needed."""

DONE = 2**62  # later than any visit


def lacking(target: int, functions: Functions) -> Set[int]:
    """Return the lost properties in reach of `target` from which all others could be derived.

    `functions` give the lost inputs of a property's functions, save of those that use the target. A
    part is a property, or several that depend on one another, after all that it depends on. Named
    is what can still not be derived within its part once all before it can: what has no function,
    and what waits for itself. Not the fewest names, since each way to the target counts. Linear in
    what is in reach (R. Tarjan: Depth-first search and linear graph algorithms, 1972).
    """
    named: Set[int] = set()
    order: Dict[int, int] = {target: 0}  # of the visits; DONE once the part is complete
    leaving: Set[int] = set()  # those that reach another part
    pending = [target]
    own = functions(target)
    number, earliest = target, 0
    left: Iterator[int] = chain.from_iterable(own)
    if not own:
        return named
    # Those above, their inputs that are left, and the earliest visit that each reaches.
    path: List[Tuple[int, Iterator[int], int]] = []
    while True:
        for input_ in left:
            seen = order.get(input_)
            if seen is None:
                own = functions(input_)
                if not own:
                    order[input_] = DONE
                    named.add(input_)
                    leaving.add(number)
                    continue
                path.append((number, left, earliest))
                number, left, earliest = input_, chain.from_iterable(own), len(order)
                order[number] = earliest
                pending.append(number)
                break
            if seen == DONE:
                leaving.add(number)
            elif seen < earliest:
                earliest = seen
        else:
            complete = earliest == order[number]
            if complete:
                part = _taken(pending, number)
                if leaving.isdisjoint(part):
                    named.update(part)  # each waits for another one
                elif len(part) > 1:
                    named.update(_waiting(part, functions))
                order.update(dict.fromkeys(part, DONE))
            if not path:
                return named
            reached = earliest
            number, left, earliest = path.pop()
            if complete:
                leaving.add(number)
            elif reached < earliest:
                earliest = reached


def _waiting(part: Sequence[int], functions: Functions) -> Set[int]:
    """Return what cannot be derived of a part although all that it needs outside can be."""
    members = frozenset(part)
    waiting = set(part)
    users: Dict[int, List[Tuple[int, List[int]]]] = {}  # the functions that wait for a property
    ready: List[int] = []
    for number in part:
        for inputs in functions(number):
            inside = [input_ for input_ in inputs if input_ in members]
            count = [len(inside)]
            for input_ in inside:
                users.setdefault(input_, []).append((number, count))
            if not inside:
                ready.append(number)
    waiting.difference_update(ready)
    while ready:
        for output, count in users.pop(ready.pop(), ()):
            count[0] -= 1
            if not count[0] and output in waiting:
                waiting.discard(output)
                ready.append(output)
    return waiting


def _taken(pending: List[int], number: int) -> List[int]:
    """Remove what is pending from `number` on, and return it."""
    place = len(pending) - 1
    while pending[place] != number:
        place -= 1
    part = pending[place:]
    del pending[place:]
    return part
