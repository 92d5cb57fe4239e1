"""Maps what the master lists of nodes to their duties: what a kill would cost beyond the SOM."""
import re
from collections import defaultdict
from typing import DefaultDict, Dict, Iterable, Mapping, Set, Tuple

from shsa_core.analysis.registrations import Pairs
from shsa_core.errors import listed
from shsa_core.model.names import Names
from shsa_core.model.service import Service
from shsa_core.model.som import Som

Had = Mapping[str, Tuple[str, ...]]
TF = ("/tf", "/tf_static")
OF_EVERY_NODE = ("/clock", "/rosout", "/diagnostics", "/statistics")
OWN_TOPICS = ("/parameter_descriptions", "/parameter_updates", "/bond")
OWN_SERVICES = (
    *("get_loggers", "set_logger_level", "set_parameters", "tf2_frames"),
    *("list", "load_nodelet", "unload_nodelet"),
)
OF_ACTION = ("/goal", "/cancel", "/status", "/feedback", "/result")
COMMANDS = re.compile(r"[/_](cmd|command|setpoint)|/(Twist|Ackermann.*|JointTrajectory)$")
"""In the topic, or the type, of what a node is told to do, though its values be derived from it."""
MOST = 3  # names of each kind


def duties_of(
    som: Som, names: Names, publishers: Pairs, subscribers: Pairs, services: Pairs, *, had: Had = {}
) -> Dict[str, Tuple[str, ...]]:
    """Return the duties, in words, of each node that publishes a service and has any.

    What it hears of another node is told to it, unless the SOM says that its values are derived
    from that. A node of the SOM that is gone keeps those that it `had`: it may soon be back.
    """
    by_node = lambda pairs: _grouped((node, name) for name, node in pairs)
    published, subscribed, served = map(by_node, (publishers, subscribers, services))
    listeners, publishing = map(_grouped, (subscribers, publishers))
    named = {topic for each in som for topic in (each.topic, each.heard)}
    orders = {each.heard for each in som if is_command(each)}
    read = read_by(som)
    givers = _grouped((topic, each.node) for each in som for topic in each.topics)
    gone = {each.node for each in som} - {node for _, node in publishers}
    found = {node: duties for node, duties in had.items() if node in gone}

    def others(topics: Set[str]) -> Set[str]:
        """Return the topics that nothing else here knows, and that mean more than the node."""
        rest = topics - named - {*TF, *OF_EVERY_NODE}
        return {t for t in rest if not t.endswith(OWN_TOPICS) and not t.startswith(names.topics)}

    for node in sorted({node for topic, node in publishers if topic in named}):
        if names.of_healing(node, any(each.node == node for each in som)):
            continue
        says = others(published[node])
        users = names.consumers({n for t in published[node] & named for n in listeners[t]} - {node})
        gives = lambda topic: topic not in read[node] and givers[topic] - {node}
        told = {
            topic
            for topic in subscribed[node] & named
            if topic in orders or gives(topic) or publishing[topic] & {*users}
        }
        hears = others(subscribed[node]) - read[node] | told
        actions = {t[:-5] for t in hears if t.endswith("/goal") and t[:-5] + "/result" in says}
        asks = {topic[:-5] for topic in says if topic.endswith("/goal")}
        parts = {name + end for name in actions | asks for end in OF_ACTION}
        heard = {each for each in says - parts if names.consumers(listeners[each] - {node})}
        calls = {each for each in served[node] if each.rsplit("/", 1)[-1] not in OWN_SERVICES}
        duties = [
            f"takes {listed(sorted(hears - parts), MOST)}" if hears - parts else "",
            "broadcasts tf" if not published[node].isdisjoint(TF) else "",
            "tells the time" if "/clock" in published[node] else "",
            f"serves the action {listed(sorted(actions), MOST)}" if actions else "",
            f"serves {listed(sorted(calls), MOST)}" if calls else "",
            f"publishes {listed(sorted(heard), MOST)}" if heard else "",
        ]
        found[node] = tuple(filter(None, duties))
    return {node: duties for node, duties in found.items() if duties}


def is_command(service: Service) -> bool:
    """Tell that a service is what a node is told to do, by its name or type."""
    return COMMANDS.search(f"{service.topic} {service.type}") is not None


def subscribers_of(som: Som, subscribers: Pairs) -> Dict[str, Tuple[str, ...]]:
    """Return the nodes that subscribe to each service's topic."""
    by_topic = _grouped(subscribers)
    return {each.heard: tuple(sorted(by_topic[each.heard])) for each in som}


def read_by(som: Som) -> Mapping[str, Set[str]]:
    """Return the topics that the values of each node are computed from, as the SOM says."""
    pairs = ((each.node, name) for each in som for name in each.derived_from)
    topics = lambda name: som.services[name].topics if name in som.services else (name,)
    return _grouped((node, topic) for node, name in pairs for topic in topics(name))


def _grouped(pairs: Iterable[Tuple[str, str]]) -> DefaultDict[str, Set[str]]:
    found: DefaultDict[str, Set[str]] = defaultdict(set)
    for key, value in pairs:
        found[key].add(value)
    return found
