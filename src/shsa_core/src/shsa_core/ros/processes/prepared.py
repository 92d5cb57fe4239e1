"""A prepared process: it has imported what a substitute needs, and forks one whenever it is told.

It has one thread and no ROS node. Its standard input is a socket to its parent; it ends with
that. Each order comes with a connection of its own, on which the fork says that it is there and
waits for leave to begin: without leave it ends, so that no order is carried out twice.
"""
import array
import gc
import json
import os
import select
import signal
import socket
import sys
from typing import Any, Dict, List, Optional, Tuple

import rospy

from shsa_core.errors import ShsaError
from shsa_core.message_types import message_class

OPTION = "--prepared"
LARGEST_ORDER_B = 200_000
SPACE = 4000
"""Characters of our command line, over which a fork writes its own."""
READY, GO = b"ready", b"go"
VARIABLES = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
"""numpy starts threads when it is imported, unless it is told so."""


def arguments() -> List[str]:
    """Return the words that make an executable a prepared process."""
    return [OPTION, " " * SPACE]


def serve() -> None:
    """Fork at each order; returns in each fork, whose `sys.argv` and environment are the order's.

    Ends the process once nobody can give orders any more.
    """
    try:
        line = socket.socket(fileno=os.dup(0))
    except OSError:
        raise SystemExit(f"{OPTION} is for healing alone: it takes orders on a socket") from None
    line.setblocking(True)
    woken, wake = socket.socketpair()
    for each in (woken, wake):
        each.setblocking(False)
    signal.signal(signal.SIGCHLD, lambda number, frame: None)
    signal.set_wakeup_fd(wake.fileno(), warn_on_full_buffer=False)
    _freeze()
    _rename(sys.argv[:2])  # raises OSError here and not in each fork
    line.send(json.dumps({"ready": os.getpid()}).encode())
    while True:
        readable, _, _ = select.select([line, woken], [], [])
        if woken in readable:
            woken.recv(4096)
            _tell_ended(line)
        if line not in readable:
            continue
        order, connection = _receive(line)
        if order is None:
            os._exit(0)
        if "types" in order:
            _load(order["types"])
        elif connection is not None and _fork(order):
            for each in (line, woken, wake):
                each.close()
            _begin(order, connection)
            return
        if connection is not None:
            connection.close()


def _freeze() -> None:
    """Have nothing of what is here by now moved or written to by a collection in a fork."""
    gc.collect()
    gc.freeze()


def _load(types: List[str]) -> None:
    """Import message types that substitutes will need; a fork says what is wrong with one."""
    for name in types:
        try:
            message_class(name)
        except ShsaError:
            continue
    _freeze()


def _receive(line: socket.socket) -> Tuple[Optional[Dict[str, Any]], Optional[socket.socket]]:
    """Return an order and its connection; None: there will be no more."""
    try:
        data, extra, _, _ = line.recvmsg(LARGEST_ORDER_B, socket.CMSG_SPACE(4))
    except ConnectionError:
        return None, None
    if not data:
        return None, None
    connection = None
    for level, kind, content in extra:
        if level == socket.SOL_SOCKET and kind == socket.SCM_RIGHTS:
            connection = socket.socket(fileno=array.array("i", content[:4])[0])
            connection.setblocking(True)  # in a ROS node, which has made it, none waits
    order: Dict[str, Any] = json.loads(data)
    return order, connection


def _fork(order: Dict[str, Any]) -> bool:
    """Fork; return whether this is the fork."""
    try:
        return os.fork() == 0
    except OSError as error:
        print(f"{order['words'][-1]} cannot be forked: {error}", file=sys.stderr, flush=True)
        return False


def _begin(order: Dict[str, Any], connection: socket.socket) -> None:
    """Become what the order wants: as if it had been started, by itself and in its own session."""
    signal.set_wakeup_fd(-1)
    signal.signal(signal.SIGCHLD, signal.SIG_DFL)
    os.setsid()
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    os.environ.update(order["variables"])
    sys.argv = order["words"]
    _rename(sys.argv)
    rospy.names.reload_mappings(sys.argv)
    try:
        connection.send(READY)
        leave = connection.recv(len(GO)) == GO
    except OSError:
        leave = False
    connection.close()
    if not leave:
        os._exit(0)


def _rename(words: List[str]) -> None:
    """Show these words as our command line, the last one first: that is the name of the node.

    By them others know us once our parent is gone. Raises OSError if they do not fit.
    """
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


def _tell_ended(line: socket.socket) -> None:
    """Tell the exit statuses of forks that have ended; then they are gone from the system."""
    while True:
        try:
            ended = os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        except ChildProcessError:
            return
        if ended is None:
            return
        status = ended.si_status if ended.si_code == os.CLD_EXITED else -ended.si_status
        try:
            message = json.dumps({"pid": ended.si_pid, "status": status}).encode()
            line.send(message, socket.MSG_DONTWAIT)
        except OSError:
            pass  # nobody listens: that it has ended is seen without us
        os.waitpid(ended.si_pid, 0)
