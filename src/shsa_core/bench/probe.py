"""The independent consumer of a benchmark: the pauses that it saw, and where it was late itself."""
import threading
from typing import Iterable, List, Optional, Sequence, Tuple

from graph import BENCH, Graph
from shsa_testing.waiting import wait_until

STARTUP_S = 120.0


class Probe:
    """Runs gap_probe.py, which notes pauses of `topics` of at least `least` s.

    `pauses`: topic, begin and end in s; `late`: when it was not scheduled itself, begin and end.
    """

    def __init__(self, graph: Graph, topics: Sequence[str], least: float) -> None:
        self.pauses: List[Tuple[str, float, float]] = []
        self.late: List[Tuple[float, float]] = []
        self.listening = False
        self._process = graph.python(BENCH / "gap_probe.py", str(least), *topics, heard=True)
        threading.Thread(target=self._read, daemon=True).start()
        wait_until(lambda: self.listening, STARTUP_S, "the independent consumer listens")

    def _read(self) -> None:
        assert self._process.stdout is not None
        for line in self._process.stdout:
            word, *rest = line.split()
            if word == "pause":
                self.pauses.append((rest[0], float(rest[1]), float(rest[2])))
            elif word == "late":
                self.late.append((float(rest[0]), float(rest[1])))
            elif word == "listening":
                self.listening = True

    def longest(self, begin: float, end: float, topics: Optional[Iterable[str]] = None) -> float:
        """The longest pause of these topics, of all if none are named, that ended in a time; s."""
        wanted = None if topics is None else set(topics)
        among = [each for each in list(self.pauses) if wanted is None or each[0] in wanted]
        return max((e - b for _, b, e in among if begin <= e <= end), default=0.0)
