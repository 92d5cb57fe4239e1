"""Line 3: every class of fault of a stream is found; by the monitor's core, in simulated time.

Sound streams of noise are made faulty by `shsa inject`'s own faults. Two nodes provide the value,
and a relation says that they agree: so a wrong value has a witness.
"""
import heapq
import math
import random
from itertools import count
from typing import Any, Iterator, List, Optional, Sequence, Tuple

from graph import Graph
from reliability.scoreboard import Figures, Line, Mark, Trial
from reliability.trying import attempt
from shsa_core.files.ontology_file import load_ontology
from shsa_core.model.checks import Witness, default_checks
from shsa_core.model.health import PublisherHealth
from shsa_core.model.ontology import Ontology
from shsa_core.model.service import Provision, Service
from shsa_core.model.som import Som
from shsa_core.monitoring import events
from shsa_core.monitoring.machine import Monitor
from shsa_injection.faults import MESSAGE_FAULTS, Reading, Stream, message_fault
from shsa_testing.failures import failures_in

PERIOD_S = 0.02
RANGE = (0.0, 100.0)
WITNESS = 3.0
AGE_S = 0.002
FRAME, LENGTH = "laser", 100
SOUND_S, FAULTY_S = 10.0, 15.0
ONTOLOGY = """
properties: {a: {}, b: {}, c: {}}
relations:
  b: {a: b}
  c: {a: c}
"""


class Streams:
    """Three sound streams, and the monitor that hears them; the first may be made faulty."""

    def __init__(self, ontology: Ontology, rng: random.Random) -> None:
        self.failures: List[PublisherHealth] = []
        self.heard = 0
        self._rng, self._now = rng, 100.0
        self._core = Monitor(ontology=ontology)
        self._order = count()
        self._coming: List[Tuple[float, int, Tuple[str, Reading]]] = []
        services = [_service(name) for name in "abc"]
        self._hear(events.SomChanged(self._now, Som(services)))
        for each in services:
            self._hear(events.Connected(self._now, each.topic, each.node))

    def _hear(self, event: Any) -> None:
        self.failures += failures_in(self._core.handle(event))

    def run(self, seconds: float, fault: Any = None) -> Optional[float]:
        """Let time pass; in s, when a failure of the first was found, None: it was not."""
        begun = self._now
        for _ in range(round(seconds / PERIOD_S)):
            self._now += PERIOD_S
            value = 50.0 + 20.0 * math.sin(self._now) + self._rng.gauss(0.0, 0.3)
            for name in "abc":
                time = self._now + self._rng.uniform(0.0, 0.004)
                noisy = value + self._rng.gauss(0.0, 0.3)
                sent = [(time, Reading((noisy,), time - AGE_S, FRAME))]
                if name == "a" and fault is not None:
                    sent = fault.feed(*sent[0])
                for at, reading in sent:
                    heapq.heappush(self._coming, (at, next(self._order), (name, reading)))
            self._deliver(self._now + PERIOD_S)
            if any(each.topic == "/a" for each in self.failures):
                return self._now - begun
        return None

    def _deliver(self, until: float) -> None:
        while self._coming and self._coming[0][0] < until:
            time, _, (name, reading) = heapq.heappop(self._coming)
            self._tick(time)
            age = None if reading.stamp is None else time - reading.stamp
            values, length = reading.values, int(LENGTH * reading.share)
            form = ("header.frame_id", reading.frame or ""), ("ranges", length)
            whom = f"/{name}", f"/{name}_node"
            self._hear(events.Message(time, *whom, values, age=age, form=form))
            self.heard += name == "a"
        self._tick(until)

    def _tick(self, until: float) -> None:
        while self._core.next_deadline <= until:
            self._hear(events.Tick(self._core.next_deadline))


def _service(name: str) -> Service:
    checks = default_checks(of_values=True) + ((Witness(WITNESS),) if name == "a" else ())
    value = Provision(name, "data", RANGE, checks=checks)
    return Service(
        name, f"/{name}", "shsa_msgs/Float64Stamped", f"/{name}_node", PERIOD_S, (value,)
    )


def inject(ontology: Ontology, seed: int) -> Figures:
    """One fault of one class; the classes take turns."""
    word = sorted(MESSAGE_FAULTS)[seed % len(MESSAGE_FAULTS)]
    streams = Streams(ontology, random.Random(seed))
    streams.run(SOUND_S)
    assert not streams.failures, f"sound streams failed: {streams.failures[0]}"
    sound = streams.heard
    fault = message_fault(word, seed, Stream(PERIOD_S, (RANGE,)))
    found = streams.run(FAULTY_S, fault)
    assert found is not None, f"{word} ({fault.detail or 'no more to say'}) was not found"
    innocent = sorted({each.topic for each in streams.failures} - {"/a"})
    assert not innocent, f"{word}: {innocent} were blamed"
    return {f"{word}: found after": found, f"{word}: messages": streams.heard - sound}


def every_class(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    """Yield trials: each is an injection."""
    path = graph.folder / "ontology.yaml"
    path.write_text(ONTOLOGY)
    ontology, errors = load_ontology(str(path))
    assert not errors
    for seed in seeds:
        yield attempt(3, seed, lambda: inject(ontology, seed))


LINES = (
    Line(
        3,
        "stuck, garbage, wrong, slow, delayed, intermittent, too fast, NaN/inf, stamps, duplicate",
        "every class found, none missed, over 3,000 seeded injections; bad messages are bounded",
        every_class,
        full=3000,
        short=24,
        marks=tuple(Mark(f"{word}: found after", FAULTY_S, "s") for word in sorted(MESSAGE_FAULTS)),
        so_far="by the monitor's core in simulated time; live, a few of each in the rostest "
        "`inject`. Spoofing is line 12. A wrong value within its range needs a witness.",
    ),
)
