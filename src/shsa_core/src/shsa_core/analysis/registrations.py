"""Finds what of its registrations a master that was started anew is told again.

Nothing is made up: what is registered again is what the master said itself, and what the node that
it said it of says still. A node that has registered anew meanwhile is left as it is.
"""
import re
from collections import defaultdict
from typing import Any, Collection, Dict, FrozenSet, Iterable, Iterator, List, Mapping
from typing import NamedTuple, Set, Tuple

from shsa_core.model.kinds import Word

NAME = re.compile(r"(/[A-Za-z0-9_]+)+\Z")
LONGEST_NAME = 1000
MOST = 100_000
"""Registrations; a master that tells more than any robot has is not followed."""
NOT_RESTORED = ("run_id",)
"""A launch gives a new master a new one, and leaves if another is there."""

Pairs = FrozenSet[Tuple[str, str]]
"""Names of topics or services, and the nodes that have registered them."""


class Part(Word):
    """The kinds of registration, in the order of registering again.

    Publishers come before subscribers: the master tells each new publisher to the subscribers that
    it knows, with the few that it knows so far, and roscpp drops all others.
    """

    PUBLISHER = "publisher"
    SERVICE = "service"
    SUBSCRIBER = "subscriber"


class Graph(NamedTuple):
    """All that a master has registered, and where it says that nodes and services are."""

    parts: Mapping[Part, Pairs]
    nodes: Mapping[str, str]
    providers: Mapping[str, str]


NOTHING = Graph(dict.fromkeys(Part, frozenset()), {}, {})

Said = Mapping[Part, Mapping[str, str]]
"""Topics that a node publishes or subscribes, by its own word, and the type of each."""


class Registration(NamedTuple):
    """To be registered on behalf of a node: a topic with its type, or a service with its URI."""

    part: Part
    node: str
    name: str
    what: str
    uri: str


def together(now: Graph, known: Graph, nodes: Collection[str]) -> Graph:
    """Return a graph with what was known of some nodes besides, which the master does not know."""
    parts = {
        part: now.parts[part] | {pair for pair in pairs if pair[1] in nodes}
        for part, pairs in known.parts.items()
    }
    uris = {node: uri for node, uri in known.nodes.items() if node in nodes}
    served = {name for name, node in known.parts[Part.SERVICE] if node in nodes}
    providers = {name: uri for name, uri in known.providers.items() if name in served}
    return Graph(parts, {**uris, **now.nodes}, {**providers, **now.providers})


def read_pairs(rows: Any) -> Pairs:
    """Return one part of the master's system state; what is no name is left out."""
    if not isinstance(rows, (list, tuple)):
        return frozenset()
    found: Set[Tuple[str, str]] = set()
    for row in rows:
        if not isinstance(row, (list, tuple)) or len(row) != 2 or not isinstance(row[1], list):
            continue
        name, nodes = row
        found.update((name, node) for node in nodes if is_name(name) and is_name(node))
        if len(found) > MOST:
            return frozenset()
    return frozenset(found)


def is_name(name: Any) -> bool:
    """Return whether something is the full name of a topic, a service or a node."""
    return isinstance(name, str) and len(name) <= LONGEST_NAME and bool(NAME.match(name))


def to_ask(known: Graph, now: Graph) -> Dict[str, str]:
    """Return the nodes that have lost a registration, and where they are.

    Not those that are somewhere else by now.
    """
    found = {}
    for part, pairs in known.parts.items():
        for _, node in pairs - now.parts[part]:
            uri = known.nodes.get(node)
            if uri is not None and now.nodes.get(node, uri) == uri:
                found[node] = uri
    return found


def to_register(known: Graph, now: Graph, said: Mapping[str, Said]) -> List[Registration]:
    """Return what nodes have lost, in the order in which it is to be registered.

    `said`: by node, for those that have answered at their URI.
    """
    asked = to_ask(known, now)
    lost = {part: pairs - now.parts[part] for part, pairs in known.parts.items()}
    found: List[Registration] = []
    for node in [each for each in said if each in asked]:
        for part, topics in said[node].items():
            for topic, kind in topics.items():
                if (topic, node) in lost[part]:
                    found.append(Registration(part, node, topic, kind, asked[node]))
        for name, provider in lost[Part.SERVICE]:
            if provider == node and name in known.providers:
                where = known.providers[name]
                found.append(Registration(Part.SERVICE, node, name, where, asked[node]))
    order = list(Part)
    return sorted(found, key=lambda each: (order.index(each.part), each[1:]))


def to_tell(
    new: Iterable[Tuple[Registration, Any]], known: Graph, now: Graph, settled: Set[str]
) -> Iterator[Tuple[List[str], str, List[str]]]:
    """Yield subscribers that publishers were there before, by URI: the topic, its publishers.

    `new`: registrations, and what the master has answered to each. `settled`: nodes of which all is
    registered that was; roscpp drops those publishers that it is not told of.
    """
    offered = {topic for topic, _ in now.parts[Part.PUBLISHER]}
    former: Dict[str, Set[str]] = defaultdict(set)
    later: Dict[str, Set[str]] = defaultdict(set)
    for topic, node in known.parts[Part.PUBLISHER]:
        uri = known.nodes.get(node)
        former[topic].update([uri] if uri else ())
        later[topic].update([uri] if uri and node not in settled else ())
    for each, uris in new:
        if each.part is Part.SUBSCRIBER and isinstance(uris, list):
            # Or one came up meanwhile.
            if each.name in offered or not former[each.name].issuperset(uris):
                yield [each.uri], each.name, sorted(later[each.name].union(uris))


def missing_parameters(
    known: Mapping[str, Any], now: Mapping[str, Any], inside: str = "/"
) -> List[Tuple[str, Any]]:
    """Return the parameters that were known and are not set now, by their full names.

    What is set now stays, whatever it was before.
    """
    found: List[Tuple[str, Any]] = []
    for key, value in known.items():
        name = inside + key
        if not is_name(name) or (inside == "/" and key in NOT_RESTORED):
            continue
        if key not in now:
            found.append((name, value))
        elif isinstance(value, dict) and isinstance(now[key], dict):
            found += missing_parameters(value, now[key], name + "/")
    return found
