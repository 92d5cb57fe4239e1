"""Tells in which boot of which computer a process runs, and which ROS master it uses.

A computer is here what shares a monotonic clock and a network, as a container does. The kernel says
it: nobody can choose which.
"""
import hashlib
import os
import socket
from typing import FrozenSet, Mapping, Optional, Tuple
from urllib.parse import urlparse

import psutil
import rosgraph
import rosgraph.network

from shsa_core.errors import ShsaError
from shsa_core.trust.proof import Place
from shsa_core.trust.seal import BOOT_B

BOOT_ID = "/proc/sys/kernel/random/boot_id"
NAMESPACES = "/proc/self/ns"
FAMILIES = (socket.AF_INET, socket.AF_INET6)
ELSEWHERE = ("127.", "::1", "fe80:")
"""Prefixes of addresses that are another computer's elsewhere."""


def boot() -> str:
    """Return the present boot of the computer. Raises ShsaError if it cannot be told."""
    try:
        with open(BOOT_ID, encoding="ascii") as file:
            return file.read().strip()
    except OSError as error:
        raise ShsaError(f"{BOOT_ID} cannot be read: {error.strerror}") from error


def origin() -> bytes:
    """Return what our signed messages name as their `boot`: BOOT_B bytes. Raises ShsaError."""
    parts = boot(), _namespace("time"), _namespace("net"), master_place()
    return hashlib.sha256(" ".join(parts).encode()).digest()[:BOOT_B]


def master_place(environment: Optional[Mapping[str, str]] = None) -> str:
    """Return the master of a process on this computer, or of ours, however it is spelled there."""
    host, port = _master(environment)
    if rosgraph.network.is_local_address(host):
        return f"localhost:{port}"
    return f"{min(_resolved(host), default=host)}:{port}"


def master_seen() -> Place:
    """Return our master, as it can be compared with what another computer sees."""
    host, port = _master()
    if not rosgraph.network.is_local_address(host):
        return Place("", _resolved(host), port)
    rows = (row for each in psutil.net_if_addrs().values() for row in each)
    found = (row.address for row in rows if row.family in FAMILIES)
    addresses = frozenset(each for each in found if not each.startswith(ELSEWHERE))
    network = hashlib.sha256(f"{boot()} {_namespace('net')}".encode()).hexdigest()
    return Place(network, addresses, port)


def _master(environment: Optional[Mapping[str, str]] = None) -> Tuple[str, int]:
    parts = urlparse(rosgraph.get_master_uri(environment))
    return parts.hostname or "", parts.port or 0


def _resolved(host: str) -> FrozenSet[str]:
    try:
        found = socket.getaddrinfo(host, None, proto=socket.IPPROTO_TCP)
    except (OSError, UnicodeError):
        return frozenset()
    return frozenset(str(each[4][0]) for each in found)


def _namespace(name: str) -> str:
    try:
        return os.readlink(f"{NAMESPACES}/{name}")
    except FileNotFoundError:
        return ""  # the kernel has none of that kind
    except OSError as error:
        raise ShsaError(f"{NAMESPACES}/{name} cannot be read: {error.strerror}") from error
