"""Maps what the master lists of nodes to their duties: what a kill would cost beyond the SOM."""
from collections import defaultdict
from typing import DefaultDict, Dict, FrozenSet, List, Set, Tuple

from shsa_core.healing.naming import Names
from shsa_core.model.som import Som

Pairs = FrozenSet[Tuple[str, str]]
"""Names of topics or services, and the nodes that have registered them."""
TF = ("/tf", "/tf_static")
NO_COMMANDS = ("/clock", *TF)
OF_EVERY_NODE = ("/rosout", "/diagnostics", "/statistics")
"""Topics on which a node tells of itself."""
OWN_TOPICS = ("/parameter_descriptions", "/parameter_updates", "/bond")
OWN_SERVICES = (
    *("get_loggers", "set_logger_level", "set_parameters", "tf2_frames"),
    *("list", "load_nodelet", "unload_nodelet"),
)
SERVED, ASKED = ("/goal", "/cancel"), ("/status", "/feedback", "/result")
"""The topics of an action: what its server hears, and what it says."""
MOST_NAMED = 3


def duties_of(
    som: Som, names: Names, publishers: Pairs, subscribers: Pairs, services: Pairs
) -> Dict[str, Tuple[str, ...]]:
    """Return the duties, in words, of each node that publishes a service and has any."""
    published, subscribed, served = map(_by_node, (publishers, subscribers, services))
    listeners = _by_node(frozenset((node, topic) for topic, node in subscribers))
    in_som = {each.topic for each in som} | {each.beyond_gate for each in som}
    nodes = {node for topic, node in publishers if topic in in_som}
    found: Dict[str, Tuple[str, ...]] = {}

    def of_healing(name: str) -> bool:
        return name.startswith(names.topics)

    def heard(topic: str, node: str) -> bool:
        return any(not names.of_healing(each, False) for each in listeners[topic] - {node})

    for node in sorted(nodes):
        if names.of_healing(node, any(each.node == node for each in som)):
            continue
        says = published[node] - in_som
        hears = subscribed[node] - in_som
        action = {topic[:-5] for topic in hears if topic.endswith("/goal")}
        actions = {name for name in action if f"{name}/result" in says}
        asks = {topic[:-5] for topic in says if topic.endswith("/goal")}
        parts = {name + end for name in actions | asks for end in (*SERVED, *ASKED)}
        commands = {
            each
            for each in hears - parts
            if each not in (*NO_COMMANDS, *OF_EVERY_NODE)
            and not each.endswith(OWN_TOPICS)
            and not of_healing(each)
        }
        told = {
            each
            for each in says - parts
            if each not in (*TF, *OF_EVERY_NODE)
            and not each.endswith(OWN_TOPICS)
            and not of_healing(each)
            and heard(each, node)
        }
        calls = {each for each in served[node] if each.rsplit("/", 1)[-1] not in OWN_SERVICES}
        duties: List[str] = []
        duties += [f"takes {_named(commands)}"] if commands else []
        duties += ["broadcasts tf"] if says & set(TF) else []
        duties += [f"serves the action {_named(actions)}"] if actions else []
        duties += [f"serves {_named(calls)}"] if calls else []
        duties += [f"publishes {_named(told)}"] if told else []
        if duties:
            found[node] = tuple(duties)
    return found


def _by_node(pairs: Pairs) -> DefaultDict[str, Set[str]]:
    found: DefaultDict[str, Set[str]] = defaultdict(set)
    for name, node in pairs:
        found[node].add(name)
    return found


def _named(names: Set[str]) -> str:
    first, more = sorted(names)[:MOST_NAMED], len(names) - MOST_NAMED
    return ", ".join(first) + (f" and {more} more" if more > 0 else "")
