"""Line 7: monitor and reconfigurator are killed in every state of an incident."""
import random
import re
import time
from contextlib import suppress
from typing import Dict, Iterator, List, Match, Optional, Sequence, Set

import psutil

from graph import PATIENCE_S, Graph
from reliability.publishers import TIRELESS
from reliability.rig import Rig
from reliability.scoreboard import Figures, Line, Mark, Trial
from reliability.trying import each
from shsa_testing.graph import node_process
from shsa_testing.waiting import wait_until

HEALERS = (("/monitor",), ("/reconfigurator",), ("/monitor", "/reconfigurator"))
STAGES = ("well", "failing", "healing", "healed", "returning")
NAME = re.compile("__name:=(substitute_.*)")


def die(rig: Rig, rng: random.Random) -> Figures:
    """Kill a healer at a stage, or both: what was begun is ended, and nothing is doubled."""
    stage, victims = rng.choice(STAGES), rng.choice(HEALERS)
    failed = time.monotonic()
    if stage != "well":
        failed = rig.kill("/first")
    if stage == "healing":
        time.sleep(rng.uniform(0.0, 0.05))
    if stage in ("healed", "returning"):
        rig.await_healed("/a", failed)
    if stage == "returning":
        rig.start("/first")
        rig.consumers.await_node("/first", time.monotonic())
    before = {healer: node_process(healer) for healer in victims}
    killed = [rig.kill_node(healer) for healer in victims][0]
    figures: Dict[str, float] = {}
    for healer in victims:
        up = lambda: (now := node_process(healer)) is not None and now != before[healer]
        wait_until(up, PATIENCE_S, f"{healer} is back")
    figures["back"] = time.monotonic() - killed
    if stage in ("failing", "healing", "healed"):
        rig.await_healed("/a", killed if stage == "healed" else failed)
        if stage == "healed":
            figures["gap while healed"] = rig.outage("/a", killed)
        rig.bring_back("/first")
    else:
        rig.await_well()
    rig.one_publisher("/a")
    wait_until(lambda: not orphans(rig), 5.0, "no substitute is left that nobody lists")
    return figures


def orphans(rig: Rig) -> List[str]:
    """Return the running substitutes that the reconfigurator does not list."""
    found: Set[Optional[Match[str]]] = set()
    for process in rig.graph.processes():
        with suppress(psutil.Error):
            found.update(map(NAME.fullmatch, process.cmdline()))
    names = {"/" + match.group(1) for match in found if match}
    return sorted(names - {row.node for row in rig.healing.substitutions})


def deaths(graph: Graph, seeds: Sequence[int]) -> Iterator[Trial]:
    """Yield trials: each is one death."""
    yield from each(graph, 7, seeds, die, **TIRELESS)


LINES = (
    Line(
        7,
        "monitor or reconfigurator kill -9 in every state",
        "back, adopts what runs, no orphan, no double; no gap while healed",
        deaths,
        full=200,
        short=2,
        marks=(Mark("gap while healed", 50.0, "ms"),),
    ),
)
