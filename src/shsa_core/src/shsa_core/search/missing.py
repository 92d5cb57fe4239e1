"""What a property lacks that has no derivation."""
from typing import Callable, Dict, List, Sequence, Set

Inputs = Callable[[int], Sequence[int]]


def last_parts(target: int, inputs: Inputs) -> Set[int]:
    """The members of those parts in reach of `target` from which no other part is reached.

    A part is a property, or several that depend on one another; `inputs` are those that a property depends on at once.
    Linear in what is in reach (R. Tarjan: Depth-first search and linear graph algorithms, SIAM J. Computing 1, 1972).
    """
    last: Set[int] = set()
    order: Dict[int, int] = {target: 0}  # of the visits
    earliest: Dict[int, int] = {
        target: 0
    }  # the first visited one that is reached and still pending
    leaves: Set[int] = set()  # pending ones that reach a part which is complete
    pending = [target]
    path = [(target, iter(inputs(target)))]
    while path:
        number, left = path[-1]
        for input_ in left:
            if input_ not in order:
                order[input_] = earliest[input_] = len(order)
                pending.append(input_)
                path.append((input_, iter(inputs(input_))))
                break
            if input_ in earliest:
                earliest[number] = min(earliest[number], order[input_])
            else:
                leaves.add(number)
        else:
            path.pop()
            complete = earliest[number] == order[number]
            if complete:
                place = len(pending) - 1
                while pending[place] != number:
                    place -= 1
                part = pending[place:]
                del pending[place:]
                if leaves.isdisjoint(part):
                    last.update(part)
                for member in part:
                    del earliest[member]
            if path:
                user = path[-1][0]
                if complete:
                    leaves.add(user)
                else:
                    earliest[user] = min(earliest[user], earliest[number])
    return last
