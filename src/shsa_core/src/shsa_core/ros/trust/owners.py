"""Asks the kernel whose a TCP socket of this computer is: nobody on the graph can forge that."""
import os
import socket
import struct
from contextlib import suppress
from typing import Any, Iterator, NamedTuple, Optional, Tuple

import psutil
import rosgraph.network

from shsa_core.ros import settings
from shsa_core.ros.master.node_api import Address, BadAnswer, family, resolved

ESTABLISHED, LISTENING = 1, 10
SOCK_DIAG, BY_FAMILY, REQUEST, MULTI, DUMP = 4, 20, 0x1, 0x2, 0x300
"""See sock_diag(7): to read /proc/net/tcp takes ms where there were many connections."""
HEADER = struct.Struct("=IHHII")
QUERY = struct.Struct("=BBBxI 2s2s16s16s4x8s")
ANSWER = struct.Struct("=BBxx 2s2s16s16s4x8s 12xII")


class Owned(NamedTuple):
    """A socket by its inode, and the user that it is of."""

    inode: int
    user: int


def is_local(uri: str) -> bool:
    """Return whether a node's address is one of this computer."""
    with suppress(BadAnswer, OSError):
        return _is_own(resolved(uri).host)
    return False


def _is_own(host: str) -> bool:
    with suppress(OSError), socket.socket(family(host), socket.SOCK_DGRAM) as bound:
        bound.bind((host, 0))  # a socket is bound to no other computer's
        return True
    return False


def listening(at: Address) -> Optional[Owned]:
    """Return the socket that answers at a numeric address; None: there is none, or several."""
    wildcards = ["::" if ":" in at.host else "0.0.0.0"]
    if rosgraph.network.use_ipv6():
        wildcards.append("::")  # nodes listen there for both families
    for host in (at.host, *wildcards):
        here = Address(host, at.port)
        nobody = Address("::" if ":" in host else "0.0.0.0", 0)
        found = [owned for each, owned in _sockets(LISTENING, here, nobody) if each == here]
        if found:
            return found[0] if len(found) == 1 else None
    return None


def answers_at(pid: int, at: Address) -> bool:
    """Return whether a process answers at a numeric address, as far as we can see."""
    owned = listening(at) or listening(at)
    return owned is not None and f"socket:[{owned.inode}]" in open_files(pid)


def listener(at: Address, hint: int = 0) -> Optional[psutil.Process]:
    """Return the process that answers at an address, maybe `hint`; None: none seen, or several."""
    owned = listening(at) or listening(at)  # rows that come and go may hide another
    if owned is None:
        return None
    name = f"socket:[{owned.inode}]"
    hinted = hint > 0 and name in open_files(hint)
    pids = [hint] if hinted else [pid for pid in psutil.pids() if name in open_files(pid)]
    with suppress(psutil.NoSuchProcess):
        return psutil.Process(pids[0]) if len(pids) == 1 else None
    return None


def speaker(connected: socket.socket) -> Optional[int]:
    """Return the user at the other end; None: on another computer. Raises OSError: it ended."""
    here, there = _plain(connected.getsockname()), _plain(connected.getpeername())
    if not _is_own(there.host):
        return None
    for _, owned in _sockets(ESTABLISHED, there, here):
        return owned.user
    raise ConnectionResetError(f"nobody is at {there.host}:{there.port} any more")


def _plain(name: Tuple[Any, ...]) -> Address:
    return Address(name[0].split("%")[0].replace("::ffff:", ""), name[1])


def _sockets(state: int, here: Address, there: Address) -> Iterator[Tuple[Address, Owned]]:
    """Return where sockets are, and whose: that of a connection, or all that listen at a port."""
    kind = family(here.host)
    flags = REQUEST if state == ESTABLISHED else REQUEST | DUMP
    ports = [struct.pack("!H", each.port) for each in (here, there)]
    hosts = [socket.inet_pton(kind, each.host) for each in (here, there)]
    query = QUERY.pack(kind, socket.IPPROTO_TCP, 0, 1 << state, *ports, *hosts, b"\xff" * 8)
    with socket.socket(socket.AF_NETLINK, socket.SOCK_RAW, SOCK_DIAG) as kernel:
        kernel.send(HEADER.pack(HEADER.size + len(query), BY_FAMILY, flags, 0, 0) + query)
        data = b""
        while True:
            data = data or kernel.recv(settings.READ_B)
            size, what, flags, *_ = HEADER.unpack_from(data)
            if what != BY_FAMILY:
                return  # there is none, or none left
            row = ANSWER.unpack_from(data, HEADER.size)
            if row[1] == state:
                host = socket.inet_ntop(kind, row[4][: len(hosts[0])])
                at = Address(host, int.from_bytes(row[2], "big"))
                yield at, Owned(inode=row[-1], user=row[-2])
            if not flags & MULTI:
                return
            data = data[size:]


def open_files(pid: int) -> Iterator[str]:
    """Yield what a process has open, by the names that the kernel gives it."""
    with suppress(OSError), os.scandir(f"/proc/{pid}/fd") as opened:  # ended, or somebody else's
        for each in opened:
            with suppress(OSError):  # it was closed meanwhile
                yield os.readlink(each.path)
