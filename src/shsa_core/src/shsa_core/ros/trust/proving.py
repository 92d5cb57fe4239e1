"""Asks nodes to prove that they hold the secret, and answers who asks us.

The node that is asked gets a nonce that nobody has seen before. The question is one more call of a
node's own XML-RPC interface: no socket, port or thread is needed for it.
"""
import re
import secrets
import socket
import threading
import time
from collections import OrderedDict
from typing import Any, Callable, List, Sequence, Tuple

from rospy.impl.masterslave import ROSHandler

from shsa_core.errors import ShsaError
from shsa_core.ros.master.node_api import FAILURES, Answer, address, ask_timed, master_api
from shsa_core.ros.trust.places import master_seen
from shsa_core.text import shown
from shsa_core.trust.computers import MOST, Met, NoAnswer
from shsa_core.trust.proof import Place, Proof, WrongSecret, read, written

METHOD = "proveSecret"
NONCE_B = 16
NONCE = re.compile(f"[0-9a-f]{{{2 * NONCE_B}}}")
MOST_SECRETS = 8
"""So many different ones of a process are proved, the newest."""


class Challenger:
    """Asks nodes to prove that they hold the secret and use our master.

    `find`: a lookup of a node's address. `call`: a call of a method with a nonce at a URI. Both
    raise one of FAILURES. `ours`: our master. `wall`: the wall clock at a time of the monotonic
    one, in ns.
    """

    def __init__(
        self,
        secret: bytes,
        find: Callable[[str], str] = lambda node: str(master_api().lookupNode(node)),
        call: Callable[[str, str, str], Answer] = ask_timed,
        ours: Callable[[], Place] = master_seen,
        wall: Callable[[int], int] = lambda at: time.time_ns() + at - time.monotonic_ns(),
    ) -> None:
        self._secret, self._find, self._call, self._ours = secret, find, call, ours
        self._wall = wall
        self._uris: "OrderedDict[str, str]" = OrderedDict()

    def ask(self, node: str) -> Met:
        """Ask a node. Raises NoAnswer; WrongSecret or ShsaError if what it answers is no proof."""
        asked = secrets.token_hex(NONCE_B)
        try:
            uri = self._locate(node)
            where = shown(address(uri).host, 100)
            answer = self._call(uri, METHOD, asked)
        except FAILURES as error:
            raise NoAnswer("its sender does not prove where it is: no answer") from error
        try:
            found = self._read(asked, answer.value)
        except WrongSecret as error:
            raise WrongSecret(f"{shown(node, 100)} on {where}: {error}") from error
        ours = self._ours()
        if not found.master.is_same(ours):
            raise ShsaError(f"it is of another robot: its ROS master is {found.master}, not {ours}")
        self._uris[node] = uri
        if len(self._uris) > MOST:
            self._uris.popitem(last=False)
        ahead = found.wall - self._wall((answer.asked + answer.answered) // 2)
        times = found.clock, ahead, answer.asked, answer.answered
        return Met(found.boot, shown(found.host, 100), where, *times)

    def _locate(self, node: str) -> str:
        """Return where a node is; without the master, where it was when it last proved itself."""
        try:
            return self._find(node)
        except FAILURES:
            if node not in self._uris:
                raise
            return self._uris[node]

    def _read(self, asked: str, answers: object) -> Proof:
        """Return the proof by our secret: a process may hold several."""
        problem = ShsaError("what its sender answers is no proof")
        for answer in (answers if isinstance(answers, list) else [])[:MOST_SECRETS]:
            try:
                return read(self._secret, asked, answer)
            except ShsaError as error:
                problem = error
        raise problem


_served: "OrderedDict[Tuple[bytes, bytes], None]" = OrderedDict()
_lock = threading.Lock()


def serve(secret: bytes, boot: bytes) -> None:
    """Have this process prove from now on that it holds the secret, as what signs with `boot`."""
    with _lock:
        _served[secret, boot] = None
        if len(_served) > MOST_SECRETS:
            _served.popitem(last=False)
        setattr(ROSHandler, METHOD, _prove)


def _prove(handler: Any, caller_id: object, asked: object) -> Tuple[int, str, List[Sequence[str]]]:
    """Answer the call, as rospy makes it."""
    if not isinstance(asked, str) or not NONCE.fullmatch(asked):
        return -1, "a nonce is needed", []
    with _lock:
        held = list(_served)
    return 1, "", [_proof(secret, boot, asked) for secret, boot in held]


def _proof(secret: bytes, boot: bytes, asked: str) -> Sequence[str]:
    clocks = time.monotonic_ns(), time.time_ns()
    told = Proof(boot, socket.gethostname(), master_seen(), *clocks)
    return written(secret, asked, told)
