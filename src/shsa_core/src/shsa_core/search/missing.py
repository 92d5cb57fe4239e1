"""What a property lacks that has no derivation."""
from typing import Callable, Dict, Iterator, List, Sequence, Set, Tuple

Inputs = Callable[[int], Sequence[int]]
DONE = 2**62  # later than any visit


def last_parts(target: int, inputs: Inputs) -> Set[int]:
    """The members of those parts in reach of `target` from which no other part is reached.

    A part is a property, or several that depend on one another; `inputs` are those that a property
    depends on at once. Linear in what is in reach (R. Tarjan: Depth-first search and linear graph
    algorithms, SIAM J. Computing 1, 1972).
    """
    last: Set[int] = set()
    order: Dict[int, int] = {target: 0}  # of the visits; DONE once the part is complete
    leaving: Set[int] = set()  # those that reach another part
    pending = [target]
    number, left, earliest = target, iter(inputs(target)), 0
    path: List[
        Tuple[int, Iterator[int], int]
    ] = []  # those above, their inputs that are left, and the earliest visit that each reaches
    while True:
        for input_ in left:
            seen = order.get(input_)
            if seen is None:
                path.append((number, left, earliest))
                number, left, earliest = input_, iter(inputs(input_)), len(order)
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
                    last.update(part)
                order.update(dict.fromkeys(part, DONE))
            if not path:
                return last
            reached = earliest
            number, left, earliest = path.pop()
            if complete:
                leaving.add(number)
            elif reached < earliest:
                earliest = reached


def _taken(pending: List[int], number: int) -> List[int]:
    """Takes what is pending from `number` on."""
    place = len(pending) - 1
    while pending[place] != number:
        place -= 1
    part = pending[place:]
    del pending[place:]
    return part
