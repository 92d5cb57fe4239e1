"""The faults of rospy that are mended here: as soon as one of these fails, its patch can go."""
import errno
import io
import socket
import struct
import threading
import time
from types import SimpleNamespace
from typing import Any, List

import pytest
import rospy
from rosgraph.network import read_ros_handshake_header
from rosgraph.xmlrpc import ThreadingXMLRPCServer
from rospy.impl import registration, rosout, simtime
from rospy.impl.registration import RegManager
from rospy.impl.tcpros_base import TCPROSServer, TCPServer
from rospy.impl.tcpros_pubsub import TCPROSSub
from std_msgs.msg import Header, String

from shsa_core.ros import settings
from shsa_core.ros.rospy_patches import log_queue
from shsa_core.ros.rospy_patches.publishing import as_written
from shsa_core.ros.rospy_patches.standing import keep_rospys_threads
from shsa_testing.waiting import wait_until

HUGE = struct.pack("<I", 0xFFFFFFFF)


def mend(monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep rospy's threads until the end of the test."""
    for where in (TCPServer, RegManager, rospy.Timer):
        monkeypatch.setattr(where, "run", where.run)
    monkeypatch.setattr(registration, "is_shutdown", registration.is_shutdown)
    keep_rospys_threads()


def test_subscribing_a_header_may_claim_any_length() -> None:
    class Enough(Exception):
        """More was read than a header can need."""

    came: List[int] = []

    def recv(size: int) -> bytes:
        came.append(size)
        if sum(came) > 2 * settings.LARGEST_HEADER_B:
            raise Enough
        return HUGE + bytes(size - 4) if len(came) == 1 else bytes(size)

    endless: Any = SimpleNamespace(recv=recv)
    with pytest.raises(Enough):
        read_ros_handshake_header(endless, io.BytesIO(), 65536)


def test_subscribing_a_message_may_claim_any_length() -> None:
    buffer = io.BytesIO()
    buffer.write(HUGE + bytes(1000))
    TCPROSSub("/topic", String).read_messages(buffer, [], None)  # it waits for the rest


def test_publishing_a_message_is_numbered_whoever_has_written_it() -> None:
    buffer = io.BytesIO()
    rospy.msg.serialize_message(buffer, 7, Header())
    rospy.msg.serialize_message(buffer, 7, as_written(Header)(b"as it is"))
    assert buffer.getvalue().endswith(b"as it is")


def test_inbound_who_says_nothing_keeps_others_out() -> None:
    served: List[Any] = []
    server = TCPROSServer()
    server.topic_connection_handler = lambda *told: served.append(told)
    server.start_server()
    address = "127.0.0.1", server.get_address()[1]
    header = struct.pack("<I", 10) + b"topic=/abc"
    with socket.create_connection(address) as silent, socket.create_connection(address) as client:
        client.sendall(struct.pack("<I", len(header)) + header)
        time.sleep(0.3)
        assert served == []
        silent.close()
        wait_until(lambda: len(served) == 1, 5.0, "the one who speaks is served")
    server.shutdown()


def test_inbound_each_silent_call_takes_a_thread_and_no_length_is_refused() -> None:
    server = ThreadingXMLRPCServer(("127.0.0.1", 0), 0)
    threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
    before = {*threading.enumerate()}
    many = settings.MOST_API_CONNECTIONS + 1
    silent = [socket.create_connection(server.server_address) for _ in range(many)]
    new = lambda: {*threading.enumerate()} - before
    wait_until(lambda: len(new()) >= many, 10.0, "a thread for each")
    post = f"POST /RPC2 HTTP/1.1\r\nContent-Length: {settings.LARGEST_CALL_B + 1}\r\n\r\n"
    silent[0].sendall(post.encode())
    silent[0].settimeout(0.2)
    with pytest.raises(socket.timeout):
        silent[0].recv(1)  # it waits for the rest
    for each in silent:
        each.close()
    server.shutdown()
    server.server_close()


def test_standing_a_server_ends_at_the_first_lack_of_a_descriptor() -> None:
    def accept() -> None:
        raise OSError(errno.EMFILE, "too many open files")

    server: Any = SimpleNamespace(server_sock=SimpleNamespace(accept=accept), is_shutdown=False)
    with pytest.raises(OSError):
        TCPServer.run(server)


def test_standing_whoever_hears_of_publishers_ends_at_the_first_lack_of_a_thread(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def start(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    manager = RegManager(SimpleNamespace(done=False))
    manager.updates = [("/topic", ["http://node:1/"])]
    monkeypatch.setattr("rospy.impl.registration.is_shutdown", lambda: False)
    monkeypatch.setattr(threading.Thread, "start", start)
    with pytest.raises(RuntimeError):
        manager.run()


def test_standing_who_hears_of_publishers_is_woken_before_it_can_see_the_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def waits() -> List[float]:
        waited: List[float] = []
        monkeypatch.setattr(rospy.core, "_in_shutdown", False)
        monkeypatch.setattr(rospy.core, "_shutdown_flag", False)

        def wait(seconds: float) -> None:
            waited.append(seconds)
            seen = "_shutdown_flag" if rospy.core.is_shutdown_requested() else "_in_shutdown"
            monkeypatch.setattr(rospy.core, seen, True)

        manager = RegManager(SimpleNamespace(done=False))
        monkeypatch.setattr(manager.cond, "wait", wait)
        manager.run()
        return waited

    assert waits() == [0.5, 0.5]
    mend(monkeypatch)
    assert waits() == [0.5]


def test_standing_a_timer_ends_as_time_jumps_back_or_its_topic_is_closed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def jump(_: object) -> None:
        raise rospy.exceptions.ROSTimeMovedBackwardsException(1.0)

    def publish(_: object) -> None:
        raise rospy.ROSException("publish() to a closed topic")

    rung: List[object] = []

    def ring(event: object) -> None:
        rung.append(event)
        if len(rung) == 3:
            timer.shutdown()

    rospy.rostime.set_rostime_initialized(True)
    monkeypatch.setattr(rospy.timer, "sleep", jump)
    monkeypatch.setattr(rospy.Timer, "start", lambda _: None)
    monkeypatch.setattr(rospy.core, "_shutdown_flag", False)
    timer = rospy.Timer(rospy.Duration(0.1), ring)
    with pytest.raises(rospy.exceptions.ROSTimeMovedBackwardsException):
        timer.run()
    unmended = rospy.Timer.run
    mend(monkeypatch)
    timer.run()
    assert len(rung) == 3
    closed = rospy.Timer(rospy.Duration(0.1), publish)
    with pytest.raises(rospy.ROSException):
        closed.run()
    monkeypatch.setattr(rospy.core, "_in_shutdown", True)
    closed.run()
    with pytest.raises(rospy.ROSException):
        unmended(closed)


def test_log_queue_the_master_is_asked_at_each_line(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: List[str] = []
    monkeypatch.setattr(rospy, "get_param_cached", lambda name, _: asked.append(name))
    monkeypatch.setattr(rosout, "_rosout_pub", SimpleNamespace(publish=lambda _: None))
    rospy.rostime.set_rostime_initialized(True)
    for _ in range(3):
        rosout._rosout(rosout.Log.INFO, "a line", "file", 1, "function")
    assert asked == [log_queue.ROSOUT] * 3


def test_wall_time_a_parameter_counts_for_every_node(monkeypatch: pytest.MonkeyPatch) -> None:
    master = SimpleNamespace(getParam=lambda caller, name: (1, "", True))
    monkeypatch.setattr(rospy.core, "xmlrpcapi", lambda uri: master)
    assert simtime._is_use_simtime()
