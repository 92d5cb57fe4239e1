"""Healing while the master hangs, after it was started anew, beside subscribers that hang, and
while processes, descriptors or room for a log are lacking.
"""
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Iterator, List

import psutil
import pytest
import rosgraph
import rospy
from own_master import MAY_BE_LIMITED, ORDINARY, OUTAGE_S, Robot, running
from shsa_msgs.msg import Incident

from shsa_core.files.som_file import added_path
from shsa_testing.faulty_publisher import FaultyNode
from shsa_testing.graph import kill_hard, node_process, publishers
from shsa_testing.graph import registered_nodes, subscribers
from shsa_testing.healing import TopicRecord
from shsa_testing.processes import end_process
from shsa_testing.processes import running as runs
from shsa_testing.waiting import wait_until

HANGS_S = 4.0
SEEN_S = 1.5  # by then what was added is seen
ALONE_S = 0.5  # without the reconfigurator an idle process waits for it so long
BACK_S = 2.5  # after the master answers; 1 s if the machine has nothing else to do

HUNG = """
import rospy
from shsa_msgs.msg import Float64Stamped
rospy.init_node("hung")
rospy.Subscriber("/hot", Float64Stamped, lambda message: None)
rospy.spin()
"""


@pytest.fixture(scope="module")
def robot() -> Iterator[Robot]:
    with running(ORDINARY) as made:
        yield made
    psutil.wait_procs(left(made), 20.0)
    assert not left(made), "all that was started has ended"


def left(robot: Robot) -> List[psutil.Process]:
    """Return the processes of a robot that run."""
    home = robot.environment["ROS_HOME"]
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.Error):
            if process.environ().get("ROS_HOME") == home and runs(process):
                found.append(process)
    return found


def test_1_a_master_that_hangs_delays_no_takeover(robot: Robot) -> None:
    robot.master.send_signal(signal.SIGSTOP)
    begun = time.monotonic()
    try:
        Path(added_path(robot.som)).write_text("services: {}\n", "utf-8")  # as `shsa add` does
        assert robot.taken_over("/hot", "/hot_node") < OUTAGE_S
        time.sleep(max(0.0, begun + SEEN_S - time.monotonic()))
        assert robot.taken_over("/warm", "/warm_node") < OUTAGE_S
        robot.healing.await_state("/warm", "healed")
        time.sleep(max(0.0, begun + HANGS_S - time.monotonic()))
        assert max(robot.outage(topic, begun) for topic in ("/hot", "/warm")) < OUTAGE_S
    finally:
        robot.master.send_signal(signal.SIGCONT)
    for topic in ("/hot", "/warm"):
        robot.returned(topic, f"{topic}_node")


def test_2_a_master_that_is_started_anew_is_told_what_it_knew(robot: Robot) -> None:
    robot.settle()
    rospy.set_param("/some/parameter", [1, "two"])
    gone = FaultyNode("/gone_node", "/gone")
    wait_until(lambda: "/gone_node" in registered_nodes(), 10.0, "a node that will be gone")
    robot.await_kept()
    robot.master.kill()
    robot.master.wait()
    end_process(gone.process)
    assert robot.taken_over("/hot", "/hot_node") < OUTAGE_S
    robot.start_master()
    begun = time.monotonic()
    wait_until(lambda: "/old_consumer" in subscribers("/cold"), 10.0, "the old consumer")
    assert time.monotonic() - begun < BACK_S
    assert rospy.get_param("/some/parameter") == [1, "two"]
    assert rospy.has_param("/shsa/som/services/hot/period")
    assert not rospy.has_param("/run_id")
    assert "/gone_node" not in registered_nodes()
    assert rosgraph.Master("/test").lookupService("/warm_node/get_loggers").startswith("rosrpc")
    robot.returned("/hot", "/hot_node")
    kill_hard("/cold_node")  # its substitute is a process that is made now
    substitute = robot.healing.await_state("/cold", "healed").substitute
    robot.records["/cold"].await_node(substitute)
    robot.returned("/cold", "/cold_node")
    robot.settle()


def test_3_hung_subscribers_keep_nobody_from_hearing_the_original(robot: Robot) -> None:
    words = [sys.executable, "-c", HUNG]
    hung = [robot.run(*words, f"__name:=hung_{number}") for number in range(8)]
    names = [f"/hung_{number}" for number in range(8)]
    wait_until(lambda: {*names} <= {*subscribers("/hot")}, 20.0, "those that will hang")
    for process in hung:
        process.send_signal(signal.SIGSTOP)
    assert robot.taken_over("/hot", "/hot_node") < OUTAGE_S
    robot.returned("/hot", "/hot_node")
    wait_until(lambda: {*robot.told("hung")} >= {*names}, 5.0, "the hung ones are named")
    for process in hung:
        end_process(process)


def reconfigurator() -> psutil.Process:
    process = node_process("/reconfigurator")
    assert process is not None
    return process


def test_4_the_master_and_the_reconfigurator_may_die_together(robot: Robot) -> None:
    robot.settle()
    robot.await_kept()
    healer = reconfigurator()
    robot.master.kill()
    end_process(healer)
    robot.master.wait()
    assert robot.taken_over("/hot", "/hot_node") < OUTAGE_S
    assert robot.taken_over("/warm", "/warm_node") < ALONE_S + OUTAGE_S
    robot.start_reconfigurator()
    robot.start_master()
    wait_until(lambda: "/old_consumer" in subscribers("/cold"), 20.0, "the old consumer")
    for topic in ("/hot", "/warm"):
        robot.healing.await_state(topic, "healed")
        robot.returned(topic, f"{topic}_node")
    robot.settle()


def limit(process: psutil.Process, what: str, soft: str) -> None:
    """Limit a running process, as its user may: `prlimit --pid PID --nproc=1:`."""
    subprocess.run([*ORDINARY, "prlimit", f"--pid={process.pid}", f"--{what}={soft}:"], check=True)


def hang(robot: Robot, node: str) -> psutil.Process:
    process = node_process(node)
    assert process is not None
    process.send_signal(signal.SIGSTOP)
    return process


@pytest.mark.skipif(not MAY_BE_LIMITED, reason="no setpriv: the processes of root are not limited")
def test_5_without_processes_what_needs_none_is_healed_and_the_rest_later(robot: Robot) -> None:
    robot.settle()
    process = reconfigurator()
    limit(process, "nproc", "1")
    begun = time.monotonic()
    hung = hang(robot, "/hot_node")
    robot.healing.await_state("/hot", "healed")
    wait_until(lambda: not runs(hung), 5.0, "the hung one is killed")
    kill_hard("/cold_node")  # its substitute would be a new process
    robot.healing.await_state("/cold", "unhealed")
    limit(process, "nproc", "4000")
    cold = robot.healing.await_state("/cold", "healed", 15.0)
    robot.records["/cold"].await_node(cold.substitute)
    hot = robot.healing.await_state("/hot", "healed")
    heard = {who for _, who in robot.records["/hot"].others("/hot_node", begun)}
    assert heard == {hot.substitute}
    for topic in ("/hot", "/cold"):
        robot.returned(topic, f"{topic}_node")


def test_6_without_descriptors_healing_goes_on_as_soon_as_there_are_some(robot: Robot) -> None:
    robot.settle()
    process = reconfigurator()
    limit(process, "nofile", "1")
    hung = hang(robot, "/hot_node")
    robot.healing.await_state("/hot", "healed")
    new = TopicRecord("/shsa/incidents", Incident)  # a connection that cannot be accepted now
    kill_hard("/cold_node")
    robot.healing.await_state("/cold", "unhealed")
    limit(process, "nofile", "1000")
    wait_until(lambda: not runs(hung), 15.0, "the hung one is killed")
    cold = robot.healing.await_state("/cold", "healed", 15.0)
    robot.records["/cold"].await_node(cold.substitute)
    for topic in ("/hot", "/cold"):
        robot.returned(topic, f"{topic}_node")
    assert new.heard, "whoever came meanwhile was never served"


def test_7_a_log_that_cannot_be_written_keeps_nobody_from_healing(robot: Robot) -> None:
    """No file may grow: as on a disk that is full."""
    robot.settle()
    processes = [reconfigurator(), node_process("/monitor")]
    for process in processes:
        assert process is not None
        limit(process, "fsize", "0")
    assert robot.taken_over("/hot", "/hot_node") < OUTAGE_S
    kill_hard("/cold_node")
    cold = robot.healing.await_state("/cold", "healed", 15.0)
    robot.records["/cold"].await_node(cold.substitute)
    for topic in ("/hot", "/cold"):
        robot.returned(topic, f"{topic}_node")
    robot.settle()
    said = robot.errors()
    assert "Traceback" not in said, said[said.index("Traceback") - 300 :]
    assert 1 <= said.count("This is said once") <= 2 + 2 * len(robot.healing.substitutions)
    assert said.count("incident log") <= 1


def test_8_a_reconfigurator_that_came_just_before_the_master_died_is_known_to_the_next(
    robot: Robot,
) -> None:
    def where() -> str:
        with suppress(rosgraph.MasterException):  # nobody serves
            return str(rosgraph.Master("/test").lookupService("/shsa/reload"))
        return ""

    former = where()
    end_process(reconfigurator())
    robot.healing.forget()
    robot.start_reconfigurator()
    wait_until(lambda: where() not in ("", former), 20.0, "another one serves")
    robot.master.kill()
    robot.master.wait()
    robot.start_master()
    known = lambda: "/reconfigurator" in publishers("/shsa/substitutions")
    wait_until(known, 10.0, "the master knows it")
    wait_until(where, 10.0, "and what it serves")
    robot.settle()
