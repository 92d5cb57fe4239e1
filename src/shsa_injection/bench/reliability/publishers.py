"""Lines 1, 2, 5 and 6: publishers that die, hang, flap, and fail together."""
import random
import signal
import time
from typing import Dict, Iterator, Sequence

from graph import Graph
from reliability.rig import DEADLINE_S, NODES, PERIOD_S, Rig
from reliability.scoreboard import Figures, Line, Mark, Trial
from reliability.trying import attempt, each
from shsa_core.model.substitution import CHANGEOVER_S
from shsa_testing.graph import publishers
from shsa_testing.healing import moment_of
from shsa_testing.waiting import wait_until

FLAPPING_S, SHORT_FLAPPING_S = 300.0, 10.0
TIRELESS: Dict[str, object] = {"switches": 0}


def crash(rig: Rig, rng: random.Random) -> Figures:
    """`kill -9` of the hot topic's node."""
    time.sleep(rng.random() * PERIOD_S)
    failed = rig.kill("/first")
    rig.await_healed("/a", failed)
    wait_until(lambda: "/first" not in publishers("/a"), 5.0, "its registration is gone")
    outage = rig.outage("/a", failed)
    return {"outage": outage, "hole of a return": rig.returns_well("/a", "/first")}


def hang(rig: Rig, rng: random.Random) -> Figures:
    """SIGSTOP of the hot topic's node, which wakes up afterwards; nobody has just come up."""
    time.sleep(2 * CHANGEOVER_S + rng.random() * PERIOD_S)
    failed = rig.hang("/first")
    incident = rig.await_healed("/a", failed)
    wait_until(lambda: rig.nodes["/first"].poll() is not None, 5.0, "it is killed")
    is_told = lambda: not (rig.healing.latest("/a") or incident).killed.is_zero()
    wait_until(is_told, 5.0, "that is told")
    incident = rig.healing.latest("/a") or incident
    last, seen, killed = (
        moment_of(stamp) for stamp in (incident.last_good, incident.detected, incident.killed)
    )
    rig.nodes["/first"].send_signal(signal.SIGCONT)
    outage = rig.outage("/a", failed)
    substitute = [m.at for m in rig.messages("/a", failed) if m.node == incident.substitute]
    late = [m for m in rig.messages("/a", substitute[0]) if m.node == "/first"]
    assert not late, f"{len(late)} messages of it were heard after the takeover"
    rig.bring_back("/first")
    return {
        "found after its deadline": 1e3 * (seen - last - DEADLINE_S),
        "killed after the decision": 1e3 * (killed - seen),
        "outage": outage,
    }


def flap(rig: Rig, rng: random.Random, seconds: float) -> Figures:
    """Kill an original again and again; somebody else starts it again at once."""
    begun = time.monotonic()
    rate = 10 ** rng.uniform(-1.0, 1.0)
    while time.monotonic() - begun < seconds:
        time.sleep(min(1.0 / rate, 10.0))
        rig.kill("/first")
        rig.start("/first")
    returns, overlap = rig.returns("/first", begun), rig.overlap("/a", begun)
    assert returns <= 3, f"it was let in {returns} times"
    return {"returns": returns, "overlap": overlap}


def orderly(rig: Rig, rng: random.Random) -> Figures:
    """Kill a node that comes back: one incident, and never two voices."""
    failed = rig.kill("/first")
    rig.await_healed("/a", failed)
    outage = rig.outage("/a", failed)
    rig.bring_back("/first")
    return {"outage": outage}


def substitute_dies(rig: Rig, rng: random.Random) -> Figures:
    """Kill the original, then its substitute."""
    failed = rig.kill("/first")
    incident = rig.await_healed("/a", failed)
    again = rig.kill_node(incident.substitute)
    rig.await_healed("/a", again)
    outage = rig.outage("/a", again)
    rig.bring_back("/first")
    return {"outage, substitute": outage}


def input_dies(rig: Rig, rng: random.Random) -> Figures:
    """Kill the original, then what its substitute reads."""
    failed = rig.kill("/first")
    rig.await_healed("/a", failed)
    again = rig.kill("/third")
    rig.await_healed("/a", again)
    outage = rig.outage("/a", again)
    rig.start("/third")
    rig.bring_back("/first")
    return {"outage, input": outage}


def together(rig: Rig, rng: random.Random) -> Figures:
    """Two needed nodes within 0.1 s, and one that their substitutes read."""
    failed = rig.kill("/first")
    time.sleep(rng.uniform(0.0, 0.1))
    second = rig.kill("/second")
    time.sleep(rng.uniform(0.0, 0.1))
    third = rig.kill(rng.choice(["/third", "/fourth"]))
    for topic, since in (("/a", max(failed, third)), ("/b", max(second, third))):
        rig.await_healed(topic, since)
    outages = {f"outage, {t}": rig.outage(t, f) for t, f in (("/a", failed), ("/b", second))}
    for node in NODES:
        if rig.nodes[node].poll() is not None:
            rig.start(node)
    rig.await_well()
    return outages


def crashes(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    yield from each(graph, 1, seeds, crash, **TIRELESS)


def hangs(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    yield from each(graph, 2, seeds, hang, **TIRELESS)


def flapping(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    """Yield trials: every tenth one flaps, the others are orderly."""
    seconds = FLAPPING_S if len(seeds) > 10 else SHORT_FLAPPING_S
    for seed in seeds:
        if seed % 10 == 0:
            with Rig(graph) as rig:
                yield attempt(5, seed, lambda: flap(rig, random.Random(seed), seconds))
    yield from each(graph, 5, [seed for seed in seeds if seed % 10], orderly, **TIRELESS)


def several(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    """Yield trials: each is one of the three."""
    kinds = (substitute_dies, input_dies, together)
    for number, deed in enumerate(kinds):
        yield from each(graph, 6, [s for s in seeds if s % 3 == number], deed, **TIRELESS)


LINES = (
    Line(
        1,
        "off (crash)",
        "outage p95 within 1.5 periods at 50 Hz (hot); stale registration gone",
        crashes,
        full=200,
        short=2,
        marks=(
            Mark("outage", 30.0, "ms"),
            Mark("hole of a return", 40.0, "ms"),
            Mark("both heard", 20.0, "ms"),
        ),
    ),
    Line(
        2,
        "hang",
        "found at its deadline, killed within 100 ms of the decision, and never heard again",
        hangs,
        full=100,
        short=1,
        marks=(
            Mark("found after its deadline", 20.0, "ms"),
            Mark("killed after the decision", 100.0, "ms"),
            Mark("both heard", 20.0, "ms"),
        ),
    ),
    Line(
        5,
        "flapping at 0.1 to 10 Hz",
        "at most 3 switches back, no overlap above one period; orderly returns stay incidents",
        flapping,
        full=20,
        short=1,
        marks=(Mark("overlap", 20.0, "ms"), Mark("both heard", 20.0, "ms")),
    ),
    Line(
        6,
        "substitute dies, its input dies, two topics at once, three in a row",
        "each healed, or ended as stated",
        several,
        full=90,
        short=2,
    ),
)
