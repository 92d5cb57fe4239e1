"""Asks the kernel whose a TCP socket of this computer is: nobody on the graph can forge that."""
import math
import os
import socket
import struct
import time
from typing import Any, Dict, List, NamedTuple, Optional, Tuple

import psutil
import rosgraph.network

from shsa_core.ros import settings
from shsa_core.ros.master.node_api import Address, BadAnswer, family, resolved

ESTABLISHED, LISTENING = "01", "0A"
_tables: Dict[str, Tuple[float, str]] = {}
"""The kernel's tables by name, and when each was read last."""


class Owned(NamedTuple):
    """A socket by its inode, and the user that it is of."""

    inode: int
    user: int


def is_local(uri: str) -> bool:
    """Return whether a node's address is one of this computer."""
    try:
        return _is_own(resolved(uri).host)
    except (BadAnswer, OSError):
        return False


def _is_own(host: str) -> bool:
    """Return whether a numeric address is one of this computer: only to such a socket is bound."""
    try:
        with socket.socket(family(host), socket.SOCK_DGRAM) as bound:
            bound.bind((host, 0))
    except OSError:
        return False
    return True


def listening(at: Address, fresh: bool = True) -> Optional[Owned]:
    """Return the socket that answers at a numeric address; None: there is none, or several.

    The very address counts before the wildcard of its family, as the kernel has it.
    """
    wildcards = ["::" if ":" in at.host else "0.0.0.0"]
    if rosgraph.network.use_ipv6():
        wildcards.append("::")  # nodes listen there for both families
    for host in (at.host, *wildcards):
        nobody = Address("::" if ":" in host else "0.0.0.0", 0)
        found = _sockets(LISTENING, Address(host, at.port), nobody, fresh)
        if found:
            return found[0] if len(found) == 1 else None
    return None


def listens(user: int, at: Address) -> bool:
    """Return whether the socket that answers at a numeric address is of a user."""
    found = (listening(at, fresh) for fresh in (False, True))
    return any(owned is not None and owned.user == user for owned in found)


def listener(at: Address, hint: int = 0) -> Optional[psutil.Process]:
    """Return the process that answers at an address; None: none here, several, or one we can't see.

    `hint`: it may be this one. Looks twice: rows that come and go may hide another in the table.
    """
    owned = listening(at) or listening(at)
    if owned is None:
        return None
    name = f"socket:[{owned.inode}]"
    hinted = hint > 0 and _holds(hint, name)
    pids = [hint] if hinted else [pid for pid in psutil.pids() if _holds(pid, name)]
    try:
        return psutil.Process(pids[0]) if len(pids) == 1 else None
    except psutil.NoSuchProcess:
        return None


def speaker(connected: socket.socket) -> Optional[int]:
    """Return the user at the other end of a connection; None: that is on another computer.

    Raises OSError if the connection has ended.
    """
    here, there = _plain(connected.getsockname()), _plain(connected.getpeername())
    if not _is_own(there.host):
        return None
    for fresh in (False, True):
        for head in ("", "::ffff:"):  # one end may be of IPv6 where the other is not
            if not head or "." in here.host:
                one, other = (Address(head + each.host, each.port) for each in (there, here))
                for found in _sockets(ESTABLISHED, one, other, fresh):
                    return found.user
    raise ConnectionResetError(f"nobody is at {there.host}:{there.port} any more")


def _plain(name: Tuple[Any, ...]) -> Address:
    return Address(name[0].split("%")[0].replace("::ffff:", ""), name[1])


def _sockets(state: str, here: Address, there: Address, fresh: bool) -> List[Owned]:
    """Return sockets of the kernel's table, see proc(5); if not `fresh`, as of CALL_S ago."""
    name = "/proc/net/tcp6" if ":" in here.host else "/proc/net/tcp"
    key = f" {_written(here)} {_written(there)} {state} "
    rows = [rest.split(None, 6) for rest in _table(name, fresh).split(key)[1:]]
    return [Owned(int(inode), int(user)) for _, _, _, user, _, inode, *_ in rows]


def _table(name: str, fresh: bool) -> str:
    """Return a table: one look does for many connections, as a robot has hundreds at once."""
    looked, text = _tables.get(name, (-math.inf, ""))
    if fresh or time.monotonic() - looked > settings.CALL_S:
        looked = time.monotonic()
        with open(name, encoding="ascii") as file:
            text = file.read()
        _tables[name] = looked, text
    return text


def _written(at: Address) -> str:
    packed = socket.inet_pton(family(at.host), at.host)
    words = struct.unpack(f"={len(packed) // 4}I", packed)
    return "".join(f"{word:08X}" for word in words) + f":{at.port:04X}"


def _holds(pid: int, name: str) -> bool:
    try:
        with os.scandir(f"/proc/{pid}/fd") as opened:
            return any(_link(each.path) == name for each in opened)
    except OSError:
        return False  # it has ended, or is somebody else's


def _link(path: str) -> str:
    try:
        return os.readlink(path)
    except OSError:
        return ""  # it was closed meanwhile
