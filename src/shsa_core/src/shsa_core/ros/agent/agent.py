"""The agent of a computer: carries out there what the reconfigurator wants, and tells what happens.

Without a reconfigurator it does nothing; what it has started goes on, and knows of that.
"""
import argparse
import os
import re
import shlex
import sys
import threading
from contextlib import suppress
from typing import Callable

import rospy
from shsa_msgs import msg

from shsa_core.errors import ModelError, ShsaError
from shsa_core.hosts.conversation import COMMANDS, EVENTS, AgentEnd, HostEvent
from shsa_core.model.names import Names
from shsa_core.ros import clock, settings
from shsa_core.ros.agent.all_hosts import Load
from shsa_core.ros.master.announce import register_again
from shsa_core.ros.master.node_api import FAILURES
from shsa_core.ros.node import publish, run
from shsa_core.ros.processes.launch import await_turn, hear_successor
from shsa_core.ros.processes.heartbeats import CUT_OFF, Signs, hearer
from shsa_core.ros.processes.local import LocalHost
from shsa_core.ros.processes.starting import Setup
from shsa_core.ros.trust.signing import SignedPublisher, Signing
from shsa_core.ros.wire import names
from shsa_core.ros.workers import guarded, repeating


class AgentNode:
    """Takes commands from the reconfigurator alone, by their signature."""

    def __init__(self, arguments: argparse.Namespace, followed: Callable[[], bool]) -> None:
        self._name = arguments.name
        if not re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", self._name):
            raise ShsaError(f"--name is {self._name!a}: letters, digits and _ are allowed")
        signing = Signing(arguments.secret)
        self._lock = threading.Lock()
        self._end = AgentEnd(settings.LOST_BEATS * settings.TURN_S)
        self._load, self._followed = Load(self._name), followed
        self._publisher = SignedPublisher(signing, names.host_events(self._name), msg.HostEvent)
        prefix = Names(rospy.get_namespace()).prefix
        given = arguments.journal, arguments.sandbox, self._name
        restarts = arguments.restart_as_root or os.geteuid() != 0
        signs = Signs(hearer(self._name), self._reach)
        how = Setup(prefix, signing.path, *given, forks=True, restarts=restarts)
        self._host = LocalHost(self._tell, signs, how)
        left = self._host.take_up()
        if left:
            rospy.loginfo("Taking up what was left behind: %s.", ", ".join(sorted(left)))
        topic = names.host_commands(self._name)
        signing.subscribe(topic, signing.checked(topic, msg.HostCommand), self._received)

    def spin(self) -> None:
        """Be there until ROS shuts down; then stop what was started, or hand it over."""
        rospy.loginfo("Agent of %s ready.", self._name)
        repeating("master", settings.LOOK_S, self._look_at_master).start()
        while not rospy.is_shutdown():
            guarded("The agent", self._load.look, clock.now())
            with self._lock:
                guarded("The agent", self._say, "")
            rospy.rostime.wallsleep(settings.TURN_S)
        if not self._followed():
            self._host.stop_all()

    def _reach(self) -> bytes:
        with self._lock:
            return b"" if self._end.session == 0 or self._end.is_open(clock.now()) else CUT_OFF

    def _look_at_master(self) -> None:
        """See to it that a new master knows us: a reconfigurator that follows must find us."""
        with self._lock:
            heard = self._end.is_open(clock.now())
        with suppress(*FAILURES):
            if not (heard or rospy.is_shutdown()):
                register_again()

    def _received(self, message: msg.HostCommand) -> None:
        with self._lock:
            if not self._end.hear(message, clock.now()):
                return
        try:
            self._host.carry_out(COMMANDS.from_text(message.command, rospy.get_name(), "this"))
        except ModelError as error:
            rospy.logerr("Refused a command: %s.", error)

    def _tell(self, event: HostEvent) -> None:
        """Say what has happened; a reconfigurator that listens later sees what runs."""
        with self._lock:
            if self._end.is_open(clock.now()):
                self._end.said += 1
                self._say(EVENTS.to_text(event))

    def _say(self, text: str) -> None:
        """Publish; the caller holds the lock, so that numbers come in order."""
        seen = self._load.seen
        message = msg.HostEvent(
            session=self._end.session,
            open=self._end.is_open(clock.now()),
            number=self._end.said,
            heard=self._end.heard,
            event=text,
            running=self._host.children.running(),
            load=seen.load,
            cores=seen.cores,
            received=seen.received,
            transmitted=seen.sent,
        )
        publish(self._publisher, message)


def main() -> None:
    """Run the agent node."""
    parser = argparse.ArgumentParser(prog="agent", description=main.__doc__)
    parser.add_argument("--name", required=True, help="the computer's name, as in the SOM's hosts")
    parser.add_argument("--secret", default="", help="the file with the secret of healing")
    parser.add_argument("--journal", default="", help="what the substitutes' journals begin with")
    parser.add_argument("--restart-as-root", action="store_true", help="also if we are root")
    sandbox = "a program and its arguments to run the substitutes in"
    parser.add_argument("--sandbox", type=shlex.split, default="", help=sandbox)
    arguments = parser.parse_args(rospy.myargv(sys.argv)[1:])
    node = f"agent_{arguments.name}"
    await_turn(node)
    followed = hear_successor()
    run(node, lambda: AgentNode(arguments, followed).spin())
