"""Finds more for `shsa check` beside a robot that runs: the nodes that healing will keep."""
from typing import Iterator

from shsa_core.analysis.finding import Finding
from shsa_core.healing.duties import duties_of
from shsa_core.healing.naming import Names
from shsa_core.model.som import Som
from shsa_core.ros.master.node_api import FAILURES, master_api
from shsa_core.ros.master.registrations import read_pairs
from shsa_learning.doctor import fate_of


def check_running(som: Som, namespace: str) -> Iterator[Finding]:
    """Report the nodes that are kept if they fail, as they do more than the SOM says.

    Nothing is reported where no robot runs.
    """
    try:
        listed = master_api("/shsa_check").getSystemState()
    except FAILURES:
        return
    duties = duties_of(som, Names(namespace), *map(read_pairs, listed))
    for service in som:
        if service.node in duties and service.contain is None:
            yield Finding(
                "warning",
                service.where,
                f"if {service.node} fails it {fate_of(service, duties[service.node])}",
                "Say `contain: none`, or `contain: node` if it is to be killed all the same",
            )
