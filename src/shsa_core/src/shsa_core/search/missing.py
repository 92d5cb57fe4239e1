"""Finds the properties that a lost property lacks."""
from typing import Callable, Dict, FrozenSet, Iterable, List, Sequence, Set, Tuple

import networkx as nx

Functions = Callable[[int], Sequence[Iterable[int]]]
"""The lost inputs of each function that yields a property: all of them are needed."""


def lacking(target: int, functions: Functions) -> Set[int]:
    """Return the lost properties in reach of `target` from which all others could be derived.

    `functions` give the lost inputs of a property's functions, save of those that use the target. A
    part is a property, or several that depend on one another. Named is what can still not be
    derived within its part once all that it needs outside can be: what has no function, and what
    waits for itself. Not the fewest names, since each way to the target counts. Linear in what is
    in reach.
    """
    graph = nx.DiGraph()
    graph.add_node(target)
    open_ = [target]
    while open_:
        number = open_.pop()
        inputs = {input_ for each in functions(number) for input_ in each}
        open_ += [input_ for input_ in inputs if input_ not in graph]
        graph.add_edges_from((number, input_) for input_ in inputs)
    named: Set[int] = set()
    for part in nx.strongly_connected_components(graph) if graph.size() else ():
        named |= _waiting(frozenset(part), functions)
    return named


def _waiting(part: FrozenSet[int], functions: Functions) -> Set[int]:
    """Return what cannot be derived of a part although all that it needs outside can be."""
    waiting = set(part)
    users: Dict[int, List[Tuple[int, List[int]]]] = {}  # the functions that wait for a property
    ready: List[int] = []
    for number in part:
        for inputs in functions(number):
            inside = part.intersection(inputs)
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
