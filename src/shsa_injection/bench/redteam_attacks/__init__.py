"""What a stranger tries against a robot, one function an attack; each returns how often.

`python3 -m redteam_attacks ATTACK SECONDS FOLDER PID`. PID: an innocent process of the robot's
user. Code that was run would write FOLDER/ran.
"""
from typing import Callable, Dict

from redteam_attacks import calls, files, graph, publishers, trust
from redteam_attacks.target import Target
from redteam_attacks.view import view

ATTACKS: Dict[str, Callable[[Target, float], int]] = {
    each.__name__: each
    for each in (
        *(calls.calls, publishers.families, calls.announced, calls.slow, calls.bombs),
        *(calls.connections, publishers.subscribers, publishers.messages, graph.parameters),
        *(graph.names, graph.requests, files.files, graph.services, files.recordings),
        *(publishers.restarts, view, trust.clocks, trust.heartbeats, trust.gate),
    )
}
