"""Repetitions of one row of hosts.py, in JSON, one line each.

Usage: hosts_row.py ROW COUNT. Exit status 1 if a failure was not healed, or nobody came back.
"""
import json
import random
import signal
import sys
import time
from typing import Callable, Iterable, List, NamedTuple, Sequence

from shsa_msgs.msg import Incident

from distributed_rover import NODE, DistributedRover, Heard, distributed_rover
from shsa_testing.healing import moment_of

PERIOD_S = 0.02
DEADLINE_S = 0.25
SETTLED_S = 3.0
SETTLED_HERE_S = 1.5
"""Time of a link that is never mended."""
LISTEN_S = 1.0


class Outcome(NamedTuple):
    """One repetition."""

    outage_ms: float
    lost: int
    late: int
    taken: int
    taken_age_ms: float
    delayed: int
    publishers: int
    two_heard_ms: float
    incidents: int
    kinds: str
    ended: str


Failure = Callable[[DistributedRover], object]


class Row(NamedTuple):
    """A row of the table. `mend` comes after `lasts` s; 0: once healing has healed."""

    name: str
    fail: Failure
    mend: Failure
    lasts: float = 0.0
    standby: str = "warm"


def cut(seconds: float) -> Row:
    """Take the Raspberry Pi's cable out for so long."""
    restore = lambda rover: rover.link.restore()
    return Row(f"link cut, {seconds:g} s", lambda rover: rover.link.cut(), restore, seconds)


def impair(rover: DistributedRover) -> None:
    """A bad link."""
    rover.link.impair(loss=0.05, delay=0.05)


KILL, RESTART = DistributedRover.kill_amperemeter, DistributedRover.revive
ROWS = (
    Row("amperemeter killed, warm", KILL, RESTART),
    Row("Raspberry Pi off", DistributedRover.power_off, DistributedRover.power_on),
    *(cut(seconds) for seconds in (2.0, 8.0, 20.0)),
    Row(
        "5 % loss, 50 ms delay, 60 s",
        impair,
        lambda rover: rover.link.repair(),
        60.0,
    ),
    Row("amperemeter killed, hot", KILL, RESTART, standby="hot"),
)


def measure(rover: DistributedRover, row: Row) -> Outcome:
    """One repetition, from well to well. Raises AssertionError if the topic is not healed."""
    rover.await_well()
    before = rover.latest()
    begun = time.monotonic() - LISTEN_S
    time.sleep(random.random() * PERIOD_S)
    ended: List[str] = []
    failed = time.monotonic()
    row.fail(rover)
    if row.lasts:
        time.sleep(row.lasts - (time.monotonic() - failed))
    else:
        rover.await_healed(before)
        time.sleep(SETTLED_HERE_S)
    settled, mended = rover.speakers(LISTEN_S), time.monotonic()
    row.mend(rover)
    if row.lasts:
        time.sleep(SETTLED_S)
        ended = rover.revive()
    rover.await_well()
    if row.lasts:
        settled = rover.speakers(LISTEN_S)
    incidents = rover.incidents(before)
    heard, steps = rover.since(begun), rover.steps(before)
    stale = [each for each in heard if each.age > DEADLINE_S]
    late = [each for each in stale if each.node == NODE]
    taken = [each for each in late if counts(each.at, steps)]
    fresh = [each for each in heard if each.age <= DEADLINE_S]
    until = float("inf") if row.lasts else mended  # a node that starts takes processor time
    outage = [each for each in fresh if each.at < until]
    return Outcome(
        1e3 * max(b.at - a.at for a, b in zip(outage, outage[1:])),
        lost(outage),
        len(late),
        len(taken),
        1e3 * max((each.age for each in taken), default=0.0),
        len(stale) - len(late),
        len(settled),
        1e3 * two_heard(fresh),
        len(incidents),
        " ".join(sorted({each.kind for each in incidents})),
        " ".join(ended),
    )


def lost(fresh: Sequence[Heard]) -> int:
    """Count the messages missed in between."""
    count = 0
    for a, b in zip(fresh, fresh[1:]):
        step = b.number - a.number if a.node == b.node else round((b.at - a.at) / PERIOD_S)
        count += max(0, step - 1)
    return count


def counts(time: float, steps: Iterable[Incident]) -> bool:
    """Return whether the amperemeter counted as the publisher at a moment in s.

    It does up to `detected` and from `returned` on, until it fails again.
    """
    counted, incident = True, 0
    for step in steps:
        back = step.state in (Incident.RETURNING, Incident.ENDED)
        if back is not counted:
            fails = step.detected if step.id != incident else step.header.stamp
            if moment_of(step.returned if back else fails) > time:
                break
            counted = back
        incident = step.id
    return counted


def two_heard(fresh: Sequence[Heard]) -> float:
    """For how long in s the messages of two publishers came among each other."""
    total = 0.0
    for before, message, after in zip(fresh, fresh[1:], fresh[2:]):
        if before.node == after.node != message.node:
            total += after.at - message.at
    return total


def main(name: str, count: int) -> int:
    """Measure until there are so many."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # what was started ends
    row = next(each for each in ROWS if each.name == name)
    with distributed_rover(row.standby) as rover:
        for _ in range(count):
            try:
                print(json.dumps(measure(rover, row)._asdict()), flush=True)
            except AssertionError as error:
                print(f"missed: {error}\n{rover.last_words()}", file=sys.stderr)
                return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], int(sys.argv[2])))
