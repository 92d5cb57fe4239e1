"""How far healing carries: 10, 100 and 1,000 topics on 3, 10 and 30 computers.

    python3 scale.py [--short] [--costs FILE] [--results DIR]

Measures what messages, failures and registrations cost on this machine, checks a discrete-event
model against runs that it has not seen, and lets the model go on where the machine ends: with one
monitor for all, and with a monitor on each computer. Writes scale_costs.json, scale_check.csv,
scale.csv and scale.png.
"""
import argparse
import json
import os
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any, Callable, Dict, List, NamedTuple, Sequence, Tuple

import numpy as np
from matplotlib import pyplot
from tqdm import tqdm

from report import print_table, summary, write_table
import scale_measured as measured
import scale_model as model
from scale_model import Costs, Flow, Load, Robot

TOPICS, HOSTS = (10, 100, 1000), (3, 10, 30)
LINK = 12.5e6
LATENCY_S = 0.0002
FLOWS = {"50 Hz, 76 B": (50.0, 8), "10 Hz, 8 kB": (10.0, 1000)}
BURSTS, SEEN_BURST = (1, 10, 40), 20
COLUMNS = (
    *("flow", "topics", "hosts", "monitors", "monitor", "link"),
    *("node dies: found", "healed", "host lost: healed", "breaks"),
)


def once(work: Callable[..., Any], *arguments: Any) -> Any:
    """Call it in a process of its own: a ROS node cannot start twice in one."""
    with ProcessPoolExecutor(1) as executor:
        return executor.submit(work, *arguments).result()
