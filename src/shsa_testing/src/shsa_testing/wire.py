"""A slow and lossy wire between two TAP interfaces, for kernels without `tc netem`.

`wire.py NEAR FAR LOSS DELAY` makes the two interfaces and passes packets between them, both ways,
each later by DELAY s, save the part LOSS. It says `ready`, and ends when its input does.
"""
import fcntl
import os
import random
import select
import struct
import sys
import time
from collections import deque
from typing import Deque, Tuple

TUNSETIFF = 0x400454CA
IFF_TAP, IFF_NO_PI = 0x0002, 0x1000
LARGEST = 65536
QUEUE = 1000  # packets on the way, as in netem; what comes when it is full is lost


def tap(name: str) -> int:
    """Return the descriptor of a new TAP interface. Raises OSError."""
    descriptor = os.open("/dev/net/tun", os.O_RDWR)
    fcntl.ioctl(descriptor, TUNSETIFF, struct.pack("16sH", name.encode(), IFF_TAP | IFF_NO_PI))
    os.set_blocking(descriptor, False)
    return descriptor


def carry(near: int, far: int, loss: float, delay: float) -> None:
    """Pass packets on until our input ends."""
    other = {near: far, far: near}
    way: Deque[Tuple[float, int, bytes]] = deque()  # when due, to whom, what; the delay is constant
    while True:
        wait = max(0.0, way[0][0] - time.monotonic()) if way else None
        readable, _, _ = select.select([sys.stdin, near, far], [], [], wait)
        if sys.stdin in readable:
            return
        for end in readable:
            packet = os.read(end, LARGEST)
            if random.random() >= loss and len(way) < QUEUE:
                way.append((time.monotonic() + delay, other[end], packet))
        while way and way[0][0] <= time.monotonic():
            _, end, packet = way.popleft()
            _send(end, packet)


def _send(end: int, packet: bytes) -> None:
    try:
        os.write(end, packet)
    except OSError:
        return  # its interface is down, or its queue full: the packet is lost


def main() -> None:
    """Run the wire."""
    near, far, loss, delay = sys.argv[1:]
    ends = tap(near), tap(far)
    print("ready", flush=True)
    carry(*ends, float(loss), float(delay))


if __name__ == "__main__":
    main()
