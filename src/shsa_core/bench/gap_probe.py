"""An independent consumer: plain sockets, no rospy; notes every pause of a topic's messages.

Usage: gap_probe.py LEAST_S TOPIC...: writes one line a pause of at least LEAST_S to its output,
`pause TOPIC BEGIN END`, and `late BEGIN END` where it was not scheduled itself; s, monotonic.
"""
import select
import socket
import struct
import sys
import time
import xmlrpc.client
import os
from typing import Dict, List, NamedTuple
from urllib.parse import urlparse

CALLER = "/gap_probe"
TURN_S = 0.01


class Stream(NamedTuple):
    """A connection to a publisher."""

    topic: str
    socket: socket.socket
    buffer: bytearray
    last: List[float]


def connect(topic: str) -> Stream:
    """Connect to the first publisher of a topic."""
    master = xmlrpc.client.ServerProxy(os.environ["ROS_MASTER_URI"])
    publishing = dict(master.getSystemState(CALLER)[2][0])  # type: ignore[index,arg-type]
    uri = master.lookupNode(CALLER, publishing[topic][0])[2]  # type: ignore[index]
    node = xmlrpc.client.ServerProxy(str(uri))
    _, host, port = node.requestTopic(CALLER, topic, [["TCPROS"]])[2]  # type: ignore[index,misc]
    made = socket.create_connection((urlparse(str(uri)).hostname or str(host), int(str(port))))
    fields = {"callerid": CALLER, "topic": topic, "md5sum": "*", "type": "*", "tcp_nodelay": "1"}
    lines = [f"{key}={value}".encode() for key, value in fields.items()]
    header = b"".join(struct.pack("<I", len(line)) + line for line in lines)
    made.sendall(struct.pack("<I", len(header)) + header)
    size = struct.unpack("<I", made.recv(4, socket.MSG_WAITALL))[0]
    made.recv(size, socket.MSG_WAITALL)
    return Stream(topic, made, bytearray(), [time.monotonic()])


def complete(buffer: bytearray) -> bool:
    """Remove the messages that are complete; return whether there was one."""
    found, start = False, 0
    while len(buffer) >= start + 4:
        end = start + 4 + struct.unpack_from("<I", buffer, start)[0]
        if len(buffer) < end:
            break
        found, start = True, end
    del buffer[:start]
    return found


def main(least: float, topics: List[str]) -> None:
    """Listen until every connection is lost, or this process is ended."""
    streams: Dict[int, Stream] = {}
    poll = select.epoll()
    for topic in topics:
        stream = connect(topic)
        streams[stream.socket.fileno()] = stream
        poll.register(stream.socket.fileno(), select.EPOLLIN)
    begun = time.monotonic()
    for stream in streams.values():
        stream.last[0] = begun
    print(f"listening {begun}", flush=True)
    while streams:
        before = time.monotonic()
        ready = poll.poll(TURN_S)
        now = time.monotonic()
        if now - before > 5 * TURN_S:
            print(f"late {before} {now}", flush=True)
        for descriptor, _ in ready:
            stream = streams[descriptor]
            data = stream.socket.recv(65536)
            if not data:
                print(f"lost {stream.topic} {now}", flush=True)
                poll.unregister(descriptor)
                del streams[descriptor]
                continue
            stream.buffer.extend(data)
            if complete(stream.buffer):
                if now - stream.last[0] >= least:
                    print(f"pause {stream.topic} {stream.last[0]} {now}", flush=True)
                stream.last[0] = now


main(float(sys.argv[1]), sys.argv[2:])
