"""The pool of idle processes that the warm topics share."""
from math import inf
from typing import Callable, Dict, Iterable, List, Optional, Tuple

from shsa_core.codegen.generator import Program
from shsa_core.healing.events import Command, Say, StartSubstitute, Substitution
from shsa_core.healing.settings import Settings
from shsa_core.model.policies import RESTART
from shsa_core.model.som import Som

REFILL_DELAY = (
    1.0  # s; the next process is not started beside a takeover: it would take its processor time
)


class Pool:
    """Idle processes, as many as the settings say, while `som` has warm topics; `new_name` names each."""

    def __init__(self, som: Som, settings: Settings, new_name: Callable[[], str]) -> None:
        self.nodes: List[str] = []
        self._settings = settings
        self._new_name = new_name
        self._paths: Dict[str, str] = {}
        self._inputs: Tuple[str, ...] = ()
        self._refill_at = -inf
        self.serve(som)

    def serve(self, som: Som) -> None:
        """Be there for the warm topics of another SOM."""
        warm = [s for s in som if s.needed and s.standby == "warm" and s.policy != RESTART]
        self._paths = {service.topic: service.path for service in warm}

    @property
    def topics(self) -> Tuple[str, ...]:
        """The warm topics."""
        return tuple(self._paths)

    @property
    def deadline(self) -> Optional[float]:
        """When one more process is due, in s; None: none is."""
        return self._refill_at if self._wants_more() else None

    def refill(self, time: float) -> List[Command]:
        """Start what is due."""
        commands: List[Command] = []
        while time >= self._refill_at and self._wants_more():
            self.nodes.append(self._new_name())
            commands.append(StartSubstitute(self.nodes[-1], None))
        return commands

    def take(self, time: float, topic: str) -> Optional[str]:
        """An idle process to work for `topic`; None if it is not warm, or none is there."""
        if topic not in self._paths or not self.nodes:
            return None
        self._refill_at = time + REFILL_DELAY
        return self.nodes.pop(0)

    def died(self, time: float, node: str, detail: str) -> List[Command]:
        """An idle process has ended by itself; it is replaced after a pause."""
        self.nodes.remove(node)
        self._refill_at = time + self._settings.retry
        return [Say("warn", f"An idle substitute's process died ({detail}).")]

    def listen(self, paths: Iterable[str]) -> None:
        """Let the processes hear `paths`, so that they have them when they get their program."""
        self._inputs = tuple(sorted(set(paths)))

    def rows(self) -> List[Substitution]:
        """The rows of the idle processes in the table of substitutions.

        They have advertised the warm topics, so that the consumers are connected: a roscpp consumer takes 0.2 s for that.
        """
        ready = Program(self._inputs, "", tuple(self._paths.values()))
        return [Substitution(node, "", ready, (), 0.0, False) for node in self.nodes]

    def _wants_more(self) -> bool:
        return bool(self._paths) and len(self.nodes) < self._settings.pool
