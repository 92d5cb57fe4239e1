"""Monitor and reconfigurator watch each other: a launch starts again who died, not who hangs.

Who hangs is named. It is ended if it is a process of our own user on this computer, and a launch
starts it again: its heartbeats come with its process number from the kernel, so nobody is ended for
another. Both never end each other: who ends must itself be at work, and so it is heard; and where
that failed, the monitor waits longer than the reconfigurator.
"""
import threading
import time
from typing import Optional

import rospy

from shsa_core.ros.processes import kernel
from shsa_core.ros.processes.heartbeats import Heart, Signs

LOOK_S = 0.2
"""Between two looks; one that comes late counts as one."""
PATIENCE_S = {"monitor": 3.0, "reconfigurator": 5.0}
"""How long each may be silent. They differ, so that both never end each other."""


class Companion:
    """Watches the other healer by its heartbeats, and sends ours.

    Args:
        role: what the other one is: its node's name, and who hears our heartbeats.
        signs: what was heard for us.
    """

    def __init__(self, role: str, signs: Signs) -> None:
        self.role = role
        self._name = rospy.resolve_name(role)
        self._heart, self._signs = Heart(role), signs
        self._beaten = time.monotonic()
        self._known: Optional[kernel.Identity] = None
        self._looks = 0
        self.problem = ""
        threading.Thread(target=self._work, name="companion", daemon=True).start()

    def beat(self) -> None:
        """To be called by the loop that does the work: we are at work."""
        self._beaten = time.monotonic()
        self._heart.beat()

    @property
    def told(self) -> str:
        """How the other one is, in words."""
        return self.problem or ("it gives signs of life" if self._known else "it was not heard yet")

    def _work(self) -> None:
        while not rospy.is_shutdown():
            time.sleep(LOOK_S)
            self._look(time.monotonic())

    def _look(self, now: float) -> None:
        sign = self._signs.of(self._name)
        if sign is None or now - self._beaten > 2 * LOOK_S:
            return  # it was never heard, or we are not at work ourselves
        if now - sign.time < 2 * LOOK_S:
            if self._known is None or self._known[0] != sign.pid:
                self._known = kernel.identity(sign.pid)
            if self.problem:
                rospy.loginfo("%s gives signs of life again.", self._name)
            self._looks, self.problem = 0, ""
            return
        self._looks += 1
        if self._looks * LOOK_S >= PATIENCE_S[self.role]:
            self._looks = 0
            self._silent(sign.pid)

    def _silent(self, pid: int) -> None:
        """It has been silent for long: it is gone, or it hangs."""
        process = kernel.same_process(self._known) if self._known else None
        problem = f"{self._name} hangs: process {pid} gives no sign of life"
        done = "Its launch starts it again."
        if process is None:
            problem, done = f"{self._name} has ended", "No other has come."
        elif kernel.started_by_launch(process):
            try:
                kernel.kill(process)
            except OSError as error:
                done = f"It cannot be ended: {error}."
        else:
            done = "No launch would start it again: it is left alone."
        if problem != self.problem:
            self.problem = problem
            rospy.logerr("%s. %s", problem, done)
