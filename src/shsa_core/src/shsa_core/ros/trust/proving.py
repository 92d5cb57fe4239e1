"""Asks nodes to prove that they hold the secret, and answers who asks us.

The node that is asked gets a nonce that nobody has seen before. The question is one more call of a
node's own XML-RPC interface: no socket, port or thread is needed for it.
"""
import re
import secrets
import socket
import time
from dataclasses import dataclass
from typing import Any, Callable, Sequence, Tuple

from rospy.impl.masterslave import ROSHandler

from shsa_core.errors import ShsaError
from shsa_core.ros.master.node_api import FAILURES, Answer, address, ask_timed, master_api
from shsa_core.ros.trust.places import master_seen
from shsa_core.text import shown
from shsa_core.trust.boots import Met, NoAnswer
from shsa_core.trust.proof import Place, Proof, WrongSecret, read, written

METHOD = "proveSecret"
NONCE_B = 16
NONCE = re.compile(f"[0-9a-f]{{{2 * NONCE_B}}}")


@dataclass
class Challenger:
    """Asks nodes to prove that they hold the secret and use our master.

    `find`: a lookup of a node's address. `call`: a call of a method with a nonce at a URI. Both
    raise one of FAILURES. `ours`: our master. `wall`: the wall clock at a time of the monotonic
    one, in ns.
    """

    secret: bytes
    find: Callable[[str], str] = lambda node: str(master_api().lookupNode(node))
    call: Callable[[str, str, str], Answer] = ask_timed
    ours: Callable[[], Place] = master_seen
    wall: Callable[[int], int] = lambda at: time.time_ns() + at - time.monotonic_ns()

    def ask(self, node: str) -> Met:
        """Ask a node. Raises NoAnswer; WrongSecret or ShsaError if what it answers is no proof."""
        asked = secrets.token_hex(NONCE_B)
        try:
            uri = self.find(node)
            where = shown(address(uri).host, 100)
            answer = self.call(uri, METHOD, asked)
        except FAILURES as error:
            raise NoAnswer("its sender does not prove where it is: no answer") from error
        try:
            found = read(self.secret, asked, answer.value)
        except WrongSecret as error:
            raise WrongSecret(f"{shown(node, 100)} on {where}: {error}") from error
        ours = self.ours()
        if not found.master.is_same(ours):
            raise ShsaError(f"it is of another robot: its ROS master is {found.master}, not {ours}")
        ahead = found.wall - self.wall((answer.asked + answer.answered) // 2)
        times = found.clock, ahead, answer.asked, answer.answered
        return Met(found.boot, shown(found.host, 100), where, *times)


def serve(secret: bytes, boot: bytes) -> None:
    """Have this process prove from now on that it holds the secret, as what signs with `boot`."""

    def prove(handler: Any, caller_id: object, asked: object) -> Tuple[int, str, Sequence[str]]:
        if not isinstance(asked, str) or not NONCE.fullmatch(asked):
            return -1, "a nonce is needed", []
        clocks = time.monotonic_ns(), time.time_ns()
        told = Proof(boot, socket.gethostname(), master_seen(), *clocks)
        return 1, "", written(secret, asked, told)

    setattr(ROSHandler, METHOD, prove)
