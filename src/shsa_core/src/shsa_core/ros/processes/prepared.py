"""A prepared process: it has imported what a substitute needs, and forks one whenever it is told.

It has one thread and no ROS node. Its standard input is a socket to its parent; it ends with that.
A fork begins once it has said there that it is there: an order that was given up is not carried
out.
"""
import gc
import json
import os
import signal
import socket
import sys
from contextlib import suppress
from typing import Any, Dict, List

import rospy

from shsa_core.errors import ShsaError
from shsa_core.message_types import message_class

OPTION = "--prepared"
"""The word that makes an executable a prepared process; SPACE blanks follow, and message types."""
LARGEST_ORDER_B = 200_000
SPACE = 4000
"""Characters of our command line, over which a fork writes its own."""
NOBODY = b"0"
"""Is said instead of a fork's number where none can be made."""
VARIABLES = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""numpy starts threads when it is imported, unless it is told so."""


def serve() -> None:
    """Fork at each order, and return in each fork as what was ordered; without orders, end."""
    try:
        line = socket.socket(fileno=os.dup(0))
    except OSError:
        raise SystemExit(f"{OPTION} is for healing alone: it takes orders on a socket") from None
    line.setblocking(True)
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the kernel forgets the forks that have ended
    for name in sys.argv[3:]:
        with suppress(ShsaError):  # a fork says what is wrong with it
            message_class(name)
    gc.collect()
    gc.freeze()  # a collection in a fork neither moves nor writes to what is here by now
    _rename(sys.argv[:2])  # raises OSError here and not in each fork
    with suppress(ConnectionError):  # who gave us orders has ended, or has given this one up
        line.send(str(os.getpid()).encode())
        for data in iter(lambda: line.recv(LARGEST_ORDER_B), b""):
            order = json.loads(data)
            if _fork(order, line):
                _begin(order)
                line.send(str(os.getpid()).encode())
                line.close()
                return
    os._exit(0)


def _fork(order: Dict[str, Any], line: socket.socket) -> bool:
    try:
        return os.fork() == 0
    except OSError as error:
        print(f"{order['words'][-1]} cannot be forked: {error}", file=sys.stderr, flush=True)
        line.send(NOBODY)
        return False


def _begin(order: Dict[str, Any]) -> None:
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.environ.update(order["variables"])
    sys.argv = order["words"]
    _rename(sys.argv)
    rospy.names.reload_mappings(sys.argv)


def _rename(words: List[str]) -> None:
    """Show words as our command line, the node's name first. Raises OSError: no room for them."""
    with open("/proc/self/stat", "rb") as stat:
        start, end = (int(each) for each in stat.read().rsplit(b")", 1)[1].split()[45:47])
    with open("/proc/self/cmdline", "rb") as file:
        interpreter = file.read().split(b"\0", 1)[0]
    head = [interpreter, os.fsencode(words[0]), *(os.fsencode(each) for each in words[:0:-1])]
    text = b"\0".join(head)[: end - start - 1]
    if len(b"\0".join(head[:3])) > len(text):
        raise OSError(f"a command line of {end - start} bytes has no room for {words[-1]}")
    with open("/proc/self/mem", "r+b", buffering=0) as memory:
        memory.seek(start)
        memory.write(text.ljust(end - start, b"\0"))
