"""The table of substitutions: which substitutes run, what each computes, and which publish."""
from dataclasses import dataclass
from functools import cached_property
from typing import Any, Tuple

from shsa_core.model.kinds import OnPartition, Others
from shsa_core.model.service import Signal


CHANGEOVER_S = 1.0
"""The time in s that a change of substitutes may take: one that comes up or changes its program is
silent so long, and others are late with it; one that was muted serves so long whom the original
does not serve yet, which takes roscpp 0.2 s."""


@dataclass(frozen=True)
class Program:
    """The three strings of a substitute: input paths, code, output paths."""

    inputs: Tuple[str, ...]
    code: str
    outputs: Tuple[str, ...]


@dataclass(frozen=True)
class Substitution:
    """One row of the table; see shsa_msgs/Substitution.

    `quality` is 0 for safe values, which promise nothing. `original`: the node that it stands in
    for, once that is gone. `provider`: the node of the service in the SOM while it does well, or is
    only silent; empty: whoever is heard counts as that. `others`: what it writes into the fields
    that it does not compute; `last_message`: the last good message of the service, serialized;
    empty: not known. An idle process has neither `service` nor `code`. `host`: the computer that it
    runs on, empty: the reconfigurator's own. `on_partition`: what it does by itself while that
    cannot reach the reconfigurator. `yields`: it is still once the provider is heard, as the node
    that it stands in for was only silent. `bridge`: the silence in s of others after which it fills
    in while it is muted, 0: it does not; an idle process takes a topic over by itself after such a
    silence of the reconfigurator. `gated`: it publishes always, a gate chooses. `shared`: other
    substitutes run in the same node, and have rows of their own. `template`: a message of the
    original when it was well, serialized; empty: not known.
    """

    node: str
    service: str
    inputs: Tuple[Signal, ...]
    code: str
    outputs: Tuple[Signal, ...]
    relations: Tuple[str, ...] = ()
    quality: float = 0.0
    publishing: bool = False
    original: str = ""
    others: Others = Others.UNKNOWN
    last_message: bytes = b""
    host: str = ""
    on_partition: OnPartition = OnPartition.WAIT
    yields: bool = False
    bridge: float = 0.0
    gated: bool = False
    shared: bool = False
    template: bytes = b""
    provider: str = ""

    @property
    def idle(self) -> bool:
        """It has no program yet."""
        return not self.code

    @cached_property
    def topics(self) -> Tuple[str, ...]:
        """The topics that it has advertised, each once."""
        return tuple(dict.fromkeys(signal.topic for signal in self.outputs))


def row_key(row: Any) -> str:
    """Return the key of a row, or of its message: its node, its service, or both."""
    return shared_key(row.node, row.service) if row.shared else str(row.node or row.service)


def shared_key(node: str, service: str) -> str:
    """Return the key of a service's row in a node that several share."""
    return f"{node} {service}"
