"""The substitute: a node made of three strings that takes over a topic (Section V-A3 of the paper)."""
import sys
import threading
from typing import Optional, Tuple

import rospy
from shsa_msgs.msg import Substitutions

from shsa_core.errors import ShsaError
from shsa_core.ros.graph import clock
from shsa_core.ros.graph.computation import Computation
from shsa_core.ros.graph.inputs import Inputs
from shsa_core.ros.node import run
from shsa_core.ros.graph.outputs import Outputs
from shsa_core.ros.graph.som_lookup import Directory

EARLY = 0.25  # of the period; but no sooner after a message, however many consumers connect
HANDOVER = 1.0  # s; so long it serves those whom the original, that is back, does not serve yet
REFRESH = 1.0  # s between two looks of an idle substitute at the SOM
USAGE = "usage: rosrun shsa_core substitute INPUTS CODE OUTPUT"
Strings = Tuple[Tuple[str, ...], str, Tuple[str, ...]]


class Substitute:
    """Evaluates its program at the lost topic's period, and publishes the result.

    It follows its row in /shsa/substitutions: the program, whether it speaks, and whom it stands in for. Mute, it
    goes on computing, so that it can speak at once. Without a row it does as it was started: `speaking`, and `strings` if there are any.

    Raises ShsaError if `strings` are not valid.
    """

    def __init__(self, strings: Optional[Strings], speaking: bool) -> None:
        self._wake = threading.Condition()
        self._wanted = strings
        self._speaking = speaking
        self._original = ""
        self._muted_at = float("-inf")
        self._strings: Optional[Strings] = None
        self._directory = Directory()
        self._inputs = Inputs(self._arrived)
        self._outputs = Outputs(self._joined)
        self._computation: Optional[Computation] = None
        self._due = self._spoke = 0.0
        if strings is not None:
            self._switch(strings)
        rospy.Subscriber("/shsa/substitutions", Substitutions, self._heed, tcp_nodelay=True)

    def spin(self) -> None:
        """Evaluate and publish until ROS shuts down."""
        while not rospy.is_shutdown():
            wanted = self._wait()
            if wanted is not None and wanted != self._strings:
                try:
                    self._switch(wanted)
                except ShsaError as error:
                    rospy.logerr("%s refuses its program: %s", rospy.get_name(), error)
                    self._strings = wanted
                continue
            if self._computation is None:
                self._directory.refresh(REFRESH)
            elif clock.now() >= self._due:
                self._evaluate(self._computation)

    def _wait(self) -> Optional[Strings]:
        """Sleep until something is due; the program that is wanted now."""
        with self._wake:
            computation = self._computation
            ready = computation is not None and computation.complete
            if self._wanted == self._strings:
                self._wake.wait(max(0.0, self._due - clock.now()) if ready else 0.1)
            return self._wanted

    def _evaluate(self, computation: Computation) -> None:
        if not computation.complete:
            return
        message = computation.message()
        now = clock.now()
        yielding = self._original and now < self._muted_at + HANDOVER
        computation.stand_in_for(self._original if self._speaking or yielding else "")
        if message is not None and (self._speaking or yielding):
            computation.publish(message)
            self._spoke = now
        self._due += computation.period
        if self._due < now:
            self._due = now + computation.period

    def _switch(self, strings: Strings) -> None:
        """Compute another program from now on; the old one goes on until the new one is made.

        Without code there is nothing to compute yet: it only listens to the inputs and connects to the consumers of the
        outputs, so as to have both at once.
        """
        inputs, code, outputs = strings
        services = self._directory.find([*inputs, *outputs])
        heard = self._inputs.listen(services[: len(inputs)])
        old = self._computation
        wanted = services[len(inputs) :]
        if code:
            self._computation = Computation(heard, code, wanted, self._outputs)
        else:
            self._computation = None
            self._outputs.prepare(wanted)
        self._strings = strings
        if old is not None:
            old.close()

    def _arrived(self) -> None:
        """The first message goes out as soon as all inputs are there."""
        if self._due == 0.0:
            with self._wake:
                self._wake.notify_all()

    def _joined(self) -> None:
        """A consumer has connected: it may have waited for long, and hears the next message early."""
        with self._wake:
            if self._speaking and self._computation is not None:
                early = self._spoke + EARLY * self._computation.period
                self._due = min(self._due, early)
                self._wake.notify_all()

    def _heed(self, table: Substitutions) -> None:
        for row in table.substitutions:
            if row.node != rospy.get_name():
                continue
            with self._wake:
                self._wanted = (tuple(row.inputs), row.code, tuple(row.outputs))
                if row.speaking and not self._speaking:
                    self._due = 0.0
                elif self._speaking and not row.speaking:
                    self._muted_at = clock.now()
                self._speaking, self._original = row.speaking, row.original
                self._wake.notify_all()


def _paths(text: str) -> Tuple[str, ...]:
    return tuple(path for path in text.split(",") if path)


def main() -> None:
    """Run the node: three strings on the command line; `~muted` starts it mute."""
    arguments = rospy.myargv(sys.argv)[1:]
    if len(arguments) != 3:
        raise SystemExit(USAGE)
    inputs, code, outputs = arguments
    strings = (_paths(inputs), code, _paths(outputs))
    run("substitute", lambda: Substitute(strings, not rospy.get_param("~muted", False)).spin())


def standby() -> None:
    """Run an idle substitute, to be given its program by its row."""
    run("standby", lambda: Substitute(None, speaking=False).spin())
