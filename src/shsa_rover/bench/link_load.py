"""Traffic of healing between the rover's three computers, in bytes/s.

The rover drives on one computer, and the kernel's counters of each TCP connection (`ss`) say what
would cross the network if its nodes ran as in the paper's Fig. 6: amperemeter and IMU on the
Raspberry Pi, drivetrain, voltmeter and SoC estimator on the mainboard, steering, master and healing
on the notebook. A byte counts with the headers of the segment that carries it; segments without
data, as acknowledgements, count as headers alone. Connections that were closed meanwhile, as calls
of a moment, are left out.

Writes results/bench/link_load.csv.
"""
import argparse
import re
import subprocess
import time
from collections import Counter
from pathlib import Path
from typing import Dict, Iterator, NamedTuple, Tuple

from graph import PATIENCE_S, Graph
from report import print_table, write_table
from shsa_testing.waiting import wait_until

HOSTS = {
    **dict.fromkeys(("amperemeter", "imu"), "raspberry_pi"),
    **dict.fromkeys(("drivetrain", "voltmeter", "soc_estimator"), "mainboard"),
    **dict.fromkeys(("driver", "rosmaster", "monitor", "reconfigurator", "idle"), "notebook"),
}
HEALING = ("monitor", "reconfigurator", "idle")
ROVER = "the rover itself"
HEADERS_B = 66  # Ethernet 14, IP 20, TCP with time stamps 32
SETTLING_TIME_S = 15.0  # until the idle processes have connected
COLUMNS = ("from", "to", "for", "payload_bytes_per_s", "segments_per_s", "bytes_per_s")
_SOCKET = re.compile(r"^\d+\s+\d+\s+(\S+)\s+(\S+)\s+users:\(\(.*?pid=(\d+),")


class Sent(NamedTuple):
    """Bytes of data and segments that one end of a connection has sent."""

    data: int
    segments: int


def connections(nodes: Dict[int, str]) -> Dict[Tuple[str, str, str], Sent]:
    """By address, peer and node: what each end that one of `nodes` (by process) holds has sent."""
    text = subprocess.check_output(["ss", "-tinpHO", "state", "established"], text=True)
    found = {}
    for line in text.splitlines():
        match = _SOCKET.match(line)
        if match is not None and int(match[3]) in nodes:
            sent = (re.search(rf" {key}:(\d+)", line) for key in ("bytes_sent", "segs_out"))
            counts = [0 if each is None else int(each[1]) for each in sent]
            found[_address(match[1]), _address(match[2]), nodes[int(match[3])]] = Sent(*counts)
    return found


def _address(text: str) -> str:
    """Return an address in one way of writing."""
    return text.replace("[::ffff:", "").replace("]", "")


def crossing(seconds: float, nodes: Dict[int, str]) -> Iterator[Tuple[Tuple[str, str, str], Sent]]:
    """Traffic from one host to another, and for whom."""
    before = connections(nodes)
    time.sleep(seconds)
    after = connections(nodes)
    holder = {(local, peer): node for local, peer, node in after}
    for key, sent in after.items():
        local, peer, node = key
        other = holder.get((peer, local))
        if other is None or key not in before or HOSTS[node] == HOSTS[other]:
            continue
        healing = [each for each in (node, other) if each in HEALING]
        link = HOSTS[node], HOSTS[other], healing[0] if healing else ROVER
        yield link, Sent(*(now - then for now, then in zip(sent, before[key])))


def nodes_of(graph: Graph) -> Dict[int, str]:
    """Return the nodes that run on the three computers, by process."""
    found = {graph.master.pid: "rosmaster"}
    for process in graph.processes():
        words = process.cmdline()
        name = next((w[8:].lstrip("/") for w in words if w.startswith("__name:=")), "")
        name = "idle" if name.startswith("substitute") else name
        if name in HOSTS and "rosrun" not in " ".join(words[:2]):
            found[process.pid] = name
    return found


def main() -> None:
    """Count, print and write."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=20.0, help="of counting")
    parser.add_argument("--results", type=Path, default=Path("results/bench"))
    options = parser.parse_args()
    with Graph() as graph:
        graph.start("roslaunch", "shsa_rover", "rover.launch")
        wanted = set(HOSTS)
        wait_until(lambda: wanted <= set(nodes_of(graph).values()), PATIENCE_S, "the rover")
        time.sleep(SETTLING_TIME_S)
        data: Counter = Counter()
        segments: Counter = Counter()
        for link, sent in crossing(options.seconds, nodes_of(graph)):
            data[link] += sent.data
            segments[link] += sent.segments
    rows = [
        (*link, *(round(each / options.seconds) for each in (
            data[link], segments[link], data[link] + HEADERS_B * segments[link]
        )))
        for link in sorted(data)
    ]  # fmt: skip
    options.results.mkdir(parents=True, exist_ok=True)
    write_table(options.results / "link_load.csv", COLUMNS, rows)
    print_table("Between the rover's computers", COLUMNS, [tuple(map(str, row)) for row in rows])


if __name__ == "__main__":
    main()
