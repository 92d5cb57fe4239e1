"""A graph shared with another computer, made of namespaces, whose link can be cut.

Needs the right to make namespaces.
"""
import json
import os
import socket
import sys
from contextlib import contextmanager
from typing import Callable, Iterator, Tuple

from graph import Graph
from shsa_testing.computers import Computer, Computers

FAR = "far"
ANSWER_S = 5.0


@contextmanager
def far_graph() -> Iterator[Tuple[Graph, Computer]]:
    """Yield a graph whose master the other computer reaches as well, and that computer.

    Raises OSError if namespaces are not permitted, or nothing answers at the master's address.
    """
    with Computers(FAR) as network:
        os.environ["ROS_IP"] = network.here
        with Graph() as graph:
            port = os.environ["ROS_MASTER_URI"].rsplit(":", 1)[1]
            os.environ["ROS_MASTER_URI"] = f"http://{network.here}:{port}"
            socket.create_connection((network.here, int(port)), ANSWER_S).close()
            yield graph, network[FAR]


def print_measured(measure: Callable[[Graph, Computer], object]) -> None:
    """Print what is measured on such a graph as one JSON object.

    Raises AssertionError if what is waited for does not come; the last words of the graph's
    processes are on stderr then.
    """
    with far_graph() as (graph, far):
        try:
            print(json.dumps(measure(graph, far)), flush=True)
        except AssertionError:
            print(graph.last_words(60), file=sys.stderr)
            raise
