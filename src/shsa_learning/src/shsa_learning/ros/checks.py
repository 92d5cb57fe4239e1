"""Finds more for `shsa check` beside a robot that runs: who is kept, and who reads whom."""
from typing import Iterator

from shsa_core.errors import listed
from shsa_core.analysis.duties import Pairs, duties_of, is_command, read_by
from shsa_core.model.names import Names
from shsa_core.model.som import Som
from shsa_core.ros.master.node_api import FAILURES, master_api
from shsa_core.analysis.registrations import read_pairs
from shsa_learning.doctor import fate_of
from shsa_learning.finding import Finding


def check_running(som: Som, namespace: str) -> Iterator[Finding]:
    """Report the nodes that are kept if they fail, as they do more than the SOM says.

    And those that read another service, without `derived_from` in the SOM. Nothing is reported
    where no robot runs.
    """
    try:
        state = master_api("/shsa_check").getSystemState()
    except FAILURES:
        return
    publishers, subscribers, services = map(read_pairs, state)
    duties = duties_of(som, Names(namespace), publishers, subscribers, services)
    for service in som:
        if service.node in duties and service.contain is None:
            yield Finding(
                "warning",
                service.where,
                f"if {service.node} fails it {fate_of(service, duties[service.node])}",
                "Say `contain: none`, or `contain: node` if it is to be killed all the same",
            )
    yield from _check_derived_from(som, subscribers)


def _check_derived_from(som: Som, subscribers: Pairs) -> Iterator[Finding]:
    """Report who reads a service, by the graph, where the SOM does not say so."""
    read = read_by(som)
    for node in dict.fromkeys(each.node for each in som):
        own = [each for each in som if each.node == node]
        unsaid = [
            each.name
            for each in som
            if each.node != node and (each.heard, node) in subscribers
            if each.heard not in read[node] and not is_command(each)
        ]
        if unsaid:
            yield Finding(
                "warning",
                own[0].where,
                f"{node} subscribes to {listed(unsaid)}, and no `derived_from` of it says so: "
                "a substitute for the one that reads the other would hear itself",
                f"Say `derived_from: [{', '.join(unsaid)}]` where values are computed from it; "
                "else it is taken as a command, for which the node is kept",
            )
