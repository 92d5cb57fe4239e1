"""Lines 8 and 9: a master that is started again, and subscribers that hang."""
import random
import time
from typing import Iterator, Sequence

from graph import BENCH, PATIENCE_S, Graph
from reliability.publishers import TIRELESS
from reliability.rig import Rig, stopped
from reliability.scoreboard import Figures, Line, Mark, Trial
from reliability.trying import each
from shsa_testing.graph import subscribers
from shsa_testing.waiting import wait_until

HUNG = 8


def master_restarts(rig: Rig, rng: random.Random) -> Figures:
    """Kill the master and start it anew; then a node dies, and another one comes back."""
    rig.graph.master.kill()
    rig.graph.master.wait()
    time.sleep(rng.uniform(0.0, 2.0))
    rig.graph.start_master()
    answers = time.monotonic()
    known = lambda: rig.consumers.rospy.node in subscribers("/a")
    wait_until(known, PATIENCE_S, "the master knows the old consumers")
    known_after = time.monotonic() - answers
    failed = rig.kill("/second")
    rig.await_healed("/b", failed)
    outage = rig.outage("/b", failed)
    rig.bring_back("/second")
    return {"known again after": known_after, "outage, warm": outage}


def hung_subscribers(rig: Rig, rng: random.Random) -> Figures:
    """Eight subscribers hang; a node dies and comes back."""
    names = [f"/hung_{rng.randrange(10**9)}" for _ in range(HUNG)]
    hung = [
        rig.graph.python(BENCH / "consumer.py", "/a", f"__name:={name[1:]}", heard=True)
        for name in names
    ]
    listed = lambda: set(names) <= set(subscribers("/a"))
    wait_until(listed, PATIENCE_S, "they have subscribed")
    with stopped(*(process.pid for process in hung)):
        failed = rig.kill("/first")
        rig.await_healed("/a", failed)
        outage = rig.outage("/a", failed)
        started = time.monotonic()
        rig.start("/first")
        rig.consumers.await_node("/first", started)
        heard = time.monotonic() - started
        for process in hung:
            process.kill()
    for process in hung:
        process.wait()
    rig.await_well()
    return {"outage": outage, "original heard again after": heard}


def restarts(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    yield from each(graph, 8, seeds, master_restarts, **TIRELESS)


def hanging(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    yield from each(graph, 9, seeds, hung_subscribers, **TIRELESS)


LINES = (
    Line(
        8,
        "master restart",
        "healing goes on, old consumers are served, within 1 s of the master's answering",
        restarts,
        full=50,
        short=0,
        marks=(Mark("known again after", 1.0, "s"), Mark("outage, warm", 1000.0, "ms")),
    ),
    Line(
        9,
        "8 hung third-party subscribers",
        "the healthy consumer is served within 500 ms",
        hanging,
        full=50,
        short=1,
        marks=(Mark("outage", 500.0, "ms"),),
    ),
)
