"""Life of other processes, by their heartbeats: of the substitutes, and of the other healer."""
import threading
import time
from dataclasses import dataclass, field
from typing import Callable, Dict, Optional

import psutil
import rospy

from shsa_core.healing import events
from shsa_core.ros import settings
from shsa_core.ros.processes import kernel
from shsa_core.ros.processes.heartbeats import Heart, Sign, Signs
from shsa_core.ros.workers import Workers, guarded
from shsa_core.watch import Watch


@dataclass
class _Seen:
    sign: Sign
    clock: Watch = field(default_factory=Watch)
    starves: bool = False
    """Its clock stands by now for what it waits for a processor."""


class Life:
    """Tells which of the nodes that have given signs of life give none any more.

    `tell` hears in a thread of its own each one's first sign; and that it hangs, after `patience`
    heartbeats without one, or, where `stopping_counts`, as the kernel has stopped it. Time stands
    while we were not scheduled, or not `at_work()`; and while it waited for a processor, up to
    STARVED times that.
    """

    def __init__(
        self,
        signs: Signs,
        watched: Callable[[str], bool],
        tell: Callable[[events.ProcessPulse], None],
        patience: int = settings.HUNG_BEATS,
        at_work: Callable[[], bool] = lambda: True,
        stopping_counts: bool = True,
    ) -> None:
        self._signs, self._watched, self._tell = signs, watched, tell
        self._patience, self._at_work = patience * settings.TURN_S, at_work
        self._stopping_counts = stopping_counts
        self._seen: Dict[str, _Seen] = {}
        threading.Thread(target=self._work, name="signs of life", daemon=True).start()

    def _work(self) -> None:
        now = time.monotonic()
        while not rospy.is_shutdown():
            before = now
            time.sleep(settings.TICK_S)
            now = time.monotonic()
            for name, sign in list(self._signs.last.items()):
                if self._watched(name):
                    guarded("Watching others", self._look, name, sign, before, now)

    def _look(self, name: str, sign: Sign, before: float, now: float) -> None:
        seen = self._seen.get(name)
        if seen is None or seen.sign.pid != sign.pid:
            seen = self._seen[name] = _Seen(sign)
            self._tell(events.ProcessPulse(now, name, True))
        seen.clock.look(now, before + settings.TICK_S)
        if not self._at_work():
            seen.clock.stand(before, now)
        if sign != seen.sign:
            seen.sign, seen.starves = sign, False
        elif seen.clock.passed(sign.time) >= 2 * settings.TURN_S:
            # At first this only tells how long it has waited so far.
            seen.clock.starve(now if seen.starves else sign.time, kernel.waited(sign.pid))
            seen.starves = True
            late = seen.clock.has_passed(sign.time, self._patience)
            stopped = self._stopping_counts and kernel.stopped(sign.pid)
            if late or stopped or now - sign.time >= settings.STARVED * self._patience:
                self._tell(events.ProcessPulse(now, name, False))
                self._signs.last.pop(name, None)
                del self._seen[name]


class Companion:
    """Watches the other healer by its heartbeats, and sends ours.

    One that hangs is named, and ended if a launch starts it again. They never end each other: the
    one that ends must be at work, and so it is heard; and they differ in patience. `role`: the
    other one's name, and the hearer of our heartbeats; `signs`: what was heard for us.
    """

    def __init__(self, role: str, signs: Signs) -> None:
        self.role = role
        self.problem = ""
        self._name = rospy.resolve_name(role)
        self._heart, self._signs = Heart(role, Workers("registrations")), signs
        self._beaten = time.monotonic()
        self._process: Optional[psutil.Process] = None
        patience = settings.HUNG_HEALER_BEATS[role]
        at_work = lambda: time.monotonic() < self._beaten + 3 * settings.TURN_S
        Life(signs, self._name.__eq__, self._change, patience, at_work, stopping_counts=False)

    def beat(self) -> None:
        """To be called by the loop that does the work: we are at work."""
        self._beaten = time.monotonic()
        self._heart.beat()

    @property
    def told(self) -> str:
        """Return how the other one is, in words."""
        well = "it gives signs of life" if self._process else "it was not heard yet"
        return self.problem or well

    def _change(self, event: events.ProcessPulse) -> None:
        name, process, sign = event.node, self._process, self._signs.last.get(event.node)
        if event.heard:
            try:
                self._process = psutil.Process(sign.pid) if sign else None
            except (psutil.Error, OSError):
                self._process = None  # it cannot be told now: nobody is ended for it
            if self.problem:
                rospy.loginfo("%s gives signs of life again.", name)
            self.problem = ""
        elif process is None or kernel.gone(process):
            self.problem = f"{name} has ended"
            rospy.logerr("%s. No launch has started another one.", self.problem)
        else:
            self.problem = f"{name} hangs: process {process.pid} gives no sign of life"
            rospy.logerr("%s. %s", self.problem, _ended(process))


def _ended(process: psutil.Process) -> str:
    if not kernel.started_by_launch(process.pid):
        return "No launch would start it again: it is left alone."
    try:
        kernel.kill(process)
    except OSError as error:
        return f"It cannot be ended: {error}."
    return "Its launch starts it again."
