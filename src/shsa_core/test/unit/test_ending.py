"""Ending nodes: a real master, real processes, and whatever anybody says of them."""
import os
import pathlib
import signal
import socket
import subprocess
import threading
import xmlrpc.client
from typing import Any, Callable, Dict, Iterator, List

import psutil
import pytest
import rosgraph

import plain_node
from plain_node import PlainNode
from shsa_core.errors import ShsaError
from shsa_core.healing.events import FindNode, Where
from shsa_core.ros.master.node_api import located, pid
from shsa_core.ros.processes import kernel, local as ending
from shsa_core.ros.processes.nodes import Nodes, protection
from shsa_testing.processes import free_port
from shsa_testing.waiting import wait_until
from strange_nodes import HOST, NONSENSE, StrangeNode, value

NAME, TOPIC, KIND = "/driver", "/speed", "std_msgs/Float64"
URIS = "/roslaunch/uris"
ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root starts processes of others")

IPV6 = pytest.mark.skipif(not socket.has_ipv6, reason="there is no IPv6 here")

Make = Callable[..., PlainNode]


@pytest.fixture(scope="module")
def master() -> "Iterator[subprocess.Popen[bytes]]":
    port = free_port()
    before = os.environ.get("ROS_MASTER_URI")
    os.environ["ROS_MASTER_URI"] = f"http://{HOST}:{port}"
    process = subprocess.Popen(["rosmaster", "--core", "-p", str(port)])
    try:
        wait_until(rosgraph.is_master_online, 20.0, "the master")
        yield process
    finally:
        process.kill()
        process.wait()
        os.environ.pop("ROS_MASTER_URI")
        if before is not None:
            os.environ["ROS_MASTER_URI"] = before


@pytest.fixture
def make() -> Iterator[Make]:
    made: List[PlainNode] = []

    def start(topics: str = TOPIC, **how: Any) -> PlainNode:
        made.append(PlainNode(topics, **how))
        return made[-1]

    yield start
    for each in made:
        each.end()


@pytest.fixture
def nodes(master: object) -> Iterator[Nodes]:
    yield Nodes()
    for topic, nodes in rosgraph.Master("/test").getSystemState()[0]:
        for node in nodes:
            registered = rosgraph.Master(node)
            registered.unregisterPublisher(topic, registered.lookupNode(node))


def register(uri: str, name: str = NAME, topic: str = TOPIC) -> None:
    """Register as anybody can: any name, any address."""
    rosgraph.Master(name).registerPublisher(topic, KIND, uri)


def outcome(end: Callable[..., bool], nodes: Nodes, node: str) -> Dict[str, str]:
    try:
        return {"left": ""} if end(nodes, node) else {}
    except ShsaError as why:
        return {"failed": str(why)}


def ended(nodes: Nodes, node: str = NAME) -> Dict[str, str]:
    """Return what becomes of `kill -9`."""
    return outcome(ending.end_process, nodes, node)


def asked(nodes: Nodes, node: str = NAME) -> Dict[str, str]:
    """Return what becomes of `rosnode kill`."""
    return outcome(ending.ask_to_leave, nodes, node)


def test_a_publisher_that_was_seen_well_is_ended_though_it_hangs(nodes: Nodes, make: Make) -> None:
    node = make()
    register(node.uri)
    known = nodes.learn(NAME, TOPIC)
    assert known is not None and known.process is not None
    assert known.process.pid == node.process.pid
    assert nodes.find(FindNode(NAME, True, TOPIC)) == (Where.HERE, "")
    node.stop()
    stopped = lambda: nodes.find(FindNode(NAME, True, TOPIC)) == (Where.STOPPED, "")
    wait_until(stopped, 5.0, "it is stopped")
    assert ended(nodes) == {"left": ""}
    assert nodes.find(FindNode(NAME, False, TOPIC)).where is Where.DEAD


def test_a_publisher_that_was_never_seen_well_is_asked_if_it_says_what_it_is(
    nodes: Nodes, make: Make
) -> None:
    node = make()
    register(node.uri)
    assert nodes.find(FindNode(NAME, True, TOPIC)) == (Where.HERE, "")
    assert asked(nodes) == {"left": ""}
    wait_until(lambda: not node.runs, 5.0, "it has ended")


@pytest.mark.parametrize("kind", NONSENSE)
def test_a_node_that_answers_nonsense_is_ended_all_the_same(
    nodes: Nodes, make: Make, kind: str
) -> None:
    node = make(kind=kind)
    register(node.uri)
    assert nodes.learn(NAME, TOPIC) is not None
    assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.HERE
    assert ended(nodes) == {"left": ""}
    wait_until(lambda: not node.runs, 5.0, "it has ended")


def test_who_hangs_and_was_never_seen_well_is_left_alone(nodes: Nodes, make: Make) -> None:
    node = make()
    register(node.uri)
    node.stop()
    found = nodes.find(FindNode(NAME, True, TOPIC))
    assert found.where is Where.UNKNOWN and "never seen well" in found.detail
    assert "failed" in ended(nodes) and node.runs


def test_an_address_of_the_master_is_no_reason_to_end_it(
    nodes: Nodes, master: "subprocess.Popen[bytes]"
) -> None:
    register(os.environ["ROS_MASTER_URI"])
    assert nodes.learn(NAME, TOPIC) is None
    assert nodes.find(FindNode(NAME, True, TOPIC)) == (Where.ANOTHER, "it is the master")
    assert "failed" in ended(nodes) and master.poll() is None


def test_an_address_of_another_node_is_no_reason_to_end_that(nodes: Nodes, make: Make) -> None:
    innocent = make("/temperature")
    register(innocent.uri)
    assert nodes.learn(NAME, TOPIC) is None
    found = nodes.find(FindNode(NAME, True, TOPIC))
    assert found.where is Where.ANOTHER and "does not publish /speed" in found.detail
    assert "failed" in ended(nodes) and "failed" in asked(nodes) and innocent.runs


def test_an_address_of_another_program_is_no_reason_to_end_that(nodes: Nodes) -> None:
    program = "import socket; s = socket.create_server(('127.0.0.1', 0)); "
    program += "print(s.getsockname()[1], flush=True); input()"
    with subprocess.Popen(
        ["/usr/bin/python3", "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        register(f"http://{HOST}:{int(process.stdout.readline())}/")
        assert nodes.learn(NAME, TOPIC) is None
        assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.UNKNOWN
        assert "failed" in ended(nodes) and process.poll() is None
        process.kill()


def test_who_is_not_listed_for_the_failed_topic_is_another(nodes: Nodes, make: Make) -> None:
    node = make("/temperature")
    register(node.uri, topic="/temperature")
    found = nodes.find(FindNode(NAME, True, TOPIC))
    assert found == (Where.ANOTHER, "the master does not list it as a publisher of /speed")
    assert nodes.learn(NAME, "/temperature") is not None
    assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.ANOTHER and node.runs


def test_a_registration_in_the_name_of_a_node_that_was_seen_well_proves_nothing(
    nodes: Nodes, make: Make
) -> None:
    innocent = make("/temperature")
    register(innocent.uri, topic="/temperature")
    assert nodes.learn(NAME, "/temperature") is not None
    register(innocent.uri)
    found = nodes.find(FindNode(NAME, True, TOPIC))
    assert found.where is Where.ANOTHER and "does not publish /speed" in found.detail


@ROOT
def test_a_process_of_somebody_else_is_neither_learned_nor_ended(nodes: Nodes, make: Make) -> None:
    node = make(user="nobody")
    register(node.uri)
    assert nodes.learn(NAME, TOPIC) is None
    assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.HERE
    told = ended(nodes)
    assert "belongs to nobody" in told["failed"] and node.runs
    assert asked(nodes) == {"left": ""}  # that it may do itself


@ROOT
def test_the_number_of_a_process_is_not_believed(nodes: Nodes, make: Make) -> None:
    """A process of another user says that it is an innocent one of ours."""
    innocent = make()
    node = make(kind=f"pid {innocent.process.pid}", user="nobody")
    register(node.uri)
    known = nodes.look(NAME)
    assert known is not None and known.process is not None
    assert known.process.pid == node.process.pid
    assert nodes.learn(NAME, TOPIC) is None
    assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.HERE
    assert "failed" in ended(nodes) and innocent.runs


@IPV6
def test_who_answers_in_another_address_family_has_nobody_ended(nodes: Nodes, make: Make) -> None:
    """A stranger listens at [::1], on the port that an innocent process of ours has elsewhere."""
    innocent = make("/temperature")
    rows = value([1, "", [[TOPIC, KIND]]])
    answers = {"getPid": value([1, "", innocent.process.pid]), "getPublications": rows}
    stranger = StrangeNode(value([1, "", 0]), innocent.port, host="::1", **answers)
    names = {"/evil": "localhost", "/evil_4": HOST, "/evil_6": "[::1]"}
    for name, host in names.items():
        register(f"http://{host}:{innocent.port}/", name)
        assert nodes.learn(name, TOPIC) is None
        assert nodes.find(FindNode(name, True, TOPIC)).where is not Where.HERE
        assert "failed" in ended(nodes, name) and innocent.runs
    stranger.end()


def test_a_process_that_was_not_heard_is_another_than_the_one_that_failed(
    nodes: Nodes, make: Make
) -> None:
    """Who had its name before sent the bad messages, from another address."""
    fake, node = make(), make()
    register(node.uri)
    assert nodes.learn(NAME, TOPIC) is not None
    found = nodes.find(FindNode(NAME, True, TOPIC, uri=fake.uri))
    assert found.where is Where.ANOTHER and f"the one that failed is at {fake.uri}" in found.detail
    assert nodes.find(FindNode(NAME, True, TOPIC, uri=node.uri)).where is Where.HERE
    nodes.adopt(NAME, psutil.Process(node.process.pid))
    assert nodes.find(FindNode(NAME, True, TOPIC, uri=fake.uri)).where is Where.ANOTHER
    fake.end()  # then ours was started in its place
    assert nodes.find(FindNode(NAME, True, TOPIC, uri=fake.uri)).where is Where.HERE


def test_a_process_that_closes_its_address_before_it_ends_is_dead(nodes: Nodes, make: Make) -> None:
    """As with `rosnode kill`: nobody listens at the address of the one that failed any more."""
    gone, node = make(), make()
    register(node.uri)
    assert nodes.learn(NAME, TOPIC) is not None
    gone.end()
    ends = threading.Timer(0.1, node.end)
    ends.start()
    assert nodes.find(FindNode(NAME, True, TOPIC, uri=gone.uri)).where is Where.DEAD
    ends.join()


def test_no_part_of_healing_or_of_ros_is_ended_under_another_name(
    nodes: Nodes, make: Make, tmp_path: pathlib.Path
) -> None:
    for name in ("shsa_core/monitor", "shsa_core/agent", "shsa_core/substitute", "bin/roslaunch"):
        program = tmp_path / name
        program.parent.mkdir(exist_ok=True)
        program.write_text(pathlib.Path(plain_node.__file__).read_text("utf-8"))
        part = make(program=str(program))
        register(part.uri)
        found = Nodes()
        assert found.learn(NAME, TOPIC) is None
        there = found.find(FindNode(NAME, True, TOPIC))
        assert there.where is Where.ANOTHER and "it belongs to" in there.detail
        assert "failed" in ended(found) and part.runs


def test_an_address_that_somebody_else_has_by_now_is_not_called(nodes: Nodes, make: Make) -> None:
    node = make()
    register(node.uri)
    assert nodes.learn(NAME, TOPIC) is not None
    node.end()
    innocent = make(port=node.port)
    assert asked(nodes) == {"left": ""}
    assert pid(located(innocent.uri)) == innocent.process.pid, "it was not asked"
    assert nodes.find(FindNode(NAME, True, TOPIC)) == (Where.DEAD, "")
    assert "left" in ended(nodes) and innocent.runs


def test_a_dead_node_of_ours_is_certainly_dead(nodes: Nodes, make: Make) -> None:
    node = make()
    register(node.uri)
    node.end()
    assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.DEAD
    assert Nodes().find(FindNode("/nobody", True, TOPIC)).where is Where.NOWHERE


def test_a_node_elsewhere_that_refuses_is_not_certainly_gone(
    nodes: Nodes, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shsa_core.ros.processes.nodes.is_local", lambda uri: False)
    node = make()
    register(node.uri)
    assert nodes.learn(NAME, TOPIC) is not None
    assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.ELSEWHERE
    node.end()
    assert "cannot be verified" in asked(nodes)["failed"]
    assert "cannot be verified" in Nodes().find(FindNode(NAME, True, TOPIC)).detail


def test_a_node_elsewhere_that_has_left_the_master_and_listens_no_more_is_gone(
    nodes: Nodes, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shsa_core.ros.processes.nodes.is_local", lambda uri: False)
    node = make()
    register(node.uri)
    assert nodes.learn(NAME, TOPIC) is not None
    rosgraph.Master(NAME).unregisterPublisher(TOPIC, node.uri)
    node.end()
    assert asked(nodes) == {"left": ""}


def test_a_node_elsewhere_that_answers_and_goes_is_gone(
    nodes: Nodes, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("shsa_core.ros.processes.nodes.is_local", lambda uri: False)
    node = make()
    register(node.uri)
    assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.ELSEWHERE
    assert asked(nodes) == {"left": ""}


def test_a_master_that_does_not_answer_proves_nothing(
    make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", f"http://{HOST}:1")
    found = Nodes().find(FindNode(NAME, True, TOPIC))
    assert found.where is Where.UNKNOWN and "the master does not answer" in found.detail


def test_nothing_is_cleared_of_a_node_that_the_master_does_not_know(nodes: Nodes) -> None:
    assert ending.clear(nodes, "/nobody")


def test_a_substitute_of_ours_is_ended_without_further_proof(nodes: Nodes, make: Make) -> None:
    node = make("/anything")
    nodes.adopt(NAME, psutil.Process(node.process.pid))
    assert nodes.find(FindNode(NAME)).where is Where.HERE
    assert ended(nodes) == {"left": ""}


def test_a_process_that_has_the_number_of_a_dead_one_is_not_killed(make: Make) -> None:
    node = make()
    learned = psutil.Process(node.process.pid)
    learned._ident = (learned.pid, learned.create_time() - 1.0)
    with pytest.raises(ProcessLookupError):
        kernel.kill(learned)
    assert node.runs
    kernel.kill(psutil.Process(node.process.pid))
    assert node.process.wait(5.0) == -signal.SIGKILL


@pytest.mark.parametrize("pid", [1, os.getppid(), os.getpid()], ids=["init", "parent", "we"])
def test_neither_ourselves_nor_who_started_us_is_ever_ended(master: object, pid: int) -> None:
    assert kernel.never_to_end(psutil.Process(pid))


@pytest.mark.parametrize("name", ["shsa_core/monitor", "shsa_gate/gate", "shsa_view/view"])
def test_a_node_of_healing_is_not_ended(master: object, tmp_path: pathlib.Path, name: str) -> None:
    program = tmp_path / name
    program.parent.mkdir()
    program.write_text("#!/bin/sh\nread line\n")
    program.chmod(0o755)
    with subprocess.Popen([str(program)], stdin=subprocess.PIPE) as process:
        why = lambda: kernel.never_to_end(psutil.Process(process.pid))
        wait_until(lambda: "belongs to healing" in why(), 10.0, "the kernel tells what it runs")


def test_who_registers_nonsense_is_nobody(nodes: Nodes) -> None:
    for uri in ("http://", "nonsense", "http://host:99999/"):
        try:
            register(uri)
        except (rosgraph.MasterException, xmlrpc.client.Error):
            continue
        assert nodes.learn(NAME, TOPIC) is None
        assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.UNKNOWN


@pytest.fixture
def child() -> Iterator[psutil.Process]:
    """A process that we have started, as a roslaunch starts a node."""
    with subprocess.Popen(["sleep", "60"]) as process:
        yield psutil.Process(process.pid)
        process.kill()


@pytest.mark.parametrize("answer", [[1, "", [["driver-1"], []]], [1, "", 7], ["x"], {"a": 1}])
def test_a_launch_that_answers_nonsense_protects_nobody(
    nodes: Nodes, child: psutil.Process, answer: Any
) -> None:
    launch = StrangeNode(value(answer))
    rosgraph.Master("/test").setParam(URIS, {"launch": launch.uri})
    assert protection(NAME, child, ()) == ""
    assert launch.calls
    launch.end()
    rosgraph.Master("/test").deleteParam(URIS)


def test_the_launch_that_has_started_a_node_protects_it_and_no_other(
    nodes: Nodes, child: psutil.Process, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Anybody may say at /roslaunch/uris that he has, or that nobody has."""
    for process, why in ((child, 'its launch file says required="true"'), (psutil.Process(), "")):
        told = value([1, "", {"pid": process.pid, "required": True}])
        listed = value([1, "", [[["driver-1", 1]], []]])
        launch = StrangeNode(value(7), list_processes=listed, process_info=told)
        monkeypatch.setattr(kernel, "started_by_launch", lambda pid, own=child.pid: pid == own)
        rosgraph.Master("/test").setParam(URIS, {} if why else {"stranger": launch.uri})
        assert protection(NAME, process, ()) == why
        launch.end()
    rosgraph.Master("/test").deleteParam(URIS)


def test_who_was_never_learned_and_is_protected_is_ended_only_by_name(
    nodes: Nodes, make: Make, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As a second publisher is not that the SOM does not name."""
    node = make()
    register(node.uri)
    monkeypatch.setattr("shsa_core.ros.processes.nodes._is_required", lambda name, process: True)
    found = nodes.find(FindNode(NAME, True, TOPIC))
    assert found == (Where.PROTECTED, 'its launch file says required="true"')
    assert nodes.find(FindNode(NAME, True, TOPIC, spares=False)).where is Where.HERE
    assert nodes.learn(NAME, TOPIC) is not None
    assert nodes.find(FindNode(NAME, True, TOPIC)).where is Where.HERE, "that was decided before"


@pytest.mark.parametrize("uris", [None, 7, {"a": 7}, {"other": "http://127.0.0.1:9/"}])
def test_a_parent_that_is_no_launch_is_not_called(
    nodes: Nodes, child: psutil.Process, uris: Any
) -> None:
    """What listens in it may be anything, as rospy's server for consumers: a call blocks that."""
    parent = StrangeNode(value(7))
    if uris is not None:
        rosgraph.Master("/test").setParam(URIS, uris)
    assert protection(NAME, child, ()) == ""
    assert not parent.calls
    parent.end()
    if uris is not None:
        rosgraph.Master("/test").deleteParam(URIS)
