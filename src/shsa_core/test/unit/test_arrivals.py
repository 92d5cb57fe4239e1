"""What a substitute's threads have heard, and when its core is told."""
import os
import subprocess
import sys
import time

from shsa_core.ros.graph.arrivals import Arrivals
from shsa_core.substitution.events import Advertised, InputArrived, OtherHeard


def arrived(time: float, topic: str = "/in") -> InputArrived:
    return InputArrived(time, topic, "/source", (("data", time),))


def is_woken(arrivals: Arrivals) -> bool:
    """Whether the reader need not wait."""
    before = time.monotonic()
    arrivals.wait(5.0)
    return time.monotonic() - before < 4.0


def calm() -> Arrivals:
    arrivals = Arrivals()
    arrivals.read(["/in", "/in2"])
    arrivals.hurry(False)
    return arrivals


def test_what_is_waited_for_is_told_at_once_and_all_of_it() -> None:
    arrivals = Arrivals()
    arrivals.read(["/in"])
    arrivals.put_input(arrived(1.0))
    arrivals.put_input(arrived(2.0))
    assert is_woken(arrivals)
    assert arrivals.take(reads=False) == [arrived(1.0), arrived(2.0)]


def test_else_the_newest_is_kept_until_it_is_read() -> None:
    arrivals = calm()
    arrivals.put_input(arrived(1.0))
    arrivals.put_input(arrived(2.0))
    arrivals.put_other(OtherHeard(2.5, "/out", "/node"))
    before = time.monotonic()
    arrivals.wait(0.05)
    assert time.monotonic() - before >= 0.05, "nobody waits for these"
    assert arrivals.take(reads=False) == [OtherHeard(2.5, "/out", "/node")]
    assert arrivals.take(reads=True) == [arrived(2.0)]
    assert arrivals.take(reads=True) == []


def test_what_calls_for_a_decision_brings_the_inputs_along_in_order() -> None:
    arrivals = calm()
    arrivals.put_other(OtherHeard(1.0, "/out", "/node"))
    arrivals.put(Advertised(3.0, "/out"))
    arrivals.put_input(arrived(2.0))
    assert is_woken(arrivals)
    assert [event.time for event in arrivals.take(reads=False)] == [1.0, 2.0, 3.0]


def test_what_is_only_prepared_for_wakes_nobody_and_is_there_once_it_is_read() -> None:
    arrivals = Arrivals()
    arrivals.put_input(arrived(1.0, "/plan"))
    arrivals.put(Advertised(2.0, "/out"))
    assert arrivals.take(reads=True) == [Advertised(2.0, "/out")]
    arrivals.read(["/plan"])
    assert arrivals.take(reads=True) == [arrived(1.0, "/plan")]


def test_a_process_that_stands_by_leaves_the_processor_to_others_until_it_matters() -> None:
    """In a process of its own: nobody but root gets its priority back."""
    program = """
import os, threading
from shsa_core.ros.graph import priority
nice = lambda: os.getpriority(os.PRIO_PROCESS, threading.get_native_id())
usual, lowered = nice(), priority.lower()
assert nice() == usual + (priority.LOWERED if lowered else 0), nice()
others = []
thread = threading.Thread(target=lambda: others.append(nice()))
thread.start(); thread.join()
assert others == [nice()]
if lowered:
    priority.restore(); priority.restore()
    assert nice() == usual
    ready, end = threading.Event(), threading.Event()
    def wait():
        os.nice(priority.LOWERED); ready.set(); end.wait(); others.append(nice())
    kept, raised = [threading.Thread(target=wait) for _ in range(2)]
    for each in (kept, raised):
        ready.clear(); each.start(); ready.wait()
    priority.restore_all({kept.native_id})
    end.set(); kept.join(); raised.join()
    assert sorted(others[1:]) == sorted([usual, usual + priority.LOWERED]), others
print(lowered)
"""
    done = subprocess.run(
        [sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, check=True, timeout=60.0
    )
    assert done.stdout.strip() == str(os.geteuid() == 0)
