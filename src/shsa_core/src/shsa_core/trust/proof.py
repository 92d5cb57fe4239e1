"""The proof of a node that it holds the secret, and uses a master: text, signed with a nonce."""
import hmac
from dataclasses import dataclass
from typing import FrozenSet, Sequence

from shsa_core.errors import ShsaError
from shsa_core.journal.codec import Codec
from shsa_core.trust.seal import signature

LONGEST = 1 << 16  # characters of a proof


class WrongSecret(ShsaError):
    """The answer is by another secret than ours, or by none."""


@dataclass(frozen=True)
class Place:
    """A ROS master as one computer sees it.

    `network`: that computer's, if the master is on it; else empty. `addresses`: by which others can
    reach it: all of that computer's, if the master is on it.
    """

    network: str
    addresses: FrozenSet[str]
    port: int

    def is_same(self, other: "Place") -> bool:
        """Return whether this can only be the master that the other sees."""
        if self.port != other.port:
            return False
        if self.network and other.network:
            return self.network == other.network
        return bool(self.addresses & other.addresses)

    def __str__(self) -> str:
        return f"{' or '.join(sorted(self.addresses)) or 'localhost'}, port {self.port}"


@dataclass(frozen=True)
class Proof:
    """The words of a computer about itself at the moment it is asked.

    `boot`: the one that its messages name; `clock` and `wall`: its monotonic and wall clock, in ns.
    """

    boot: bytes
    host: str
    master: Place
    clock: int
    wall: int


_CODEC = Codec(Proof)


def written(secret: bytes, asked: str, proof: Proof) -> Sequence[str]:
    """Write the proof that answers a nonce: its text, and the signature."""
    text = _CODEC.to_text(proof)
    return [text, _signature(secret, asked, text)]


def read(secret: bytes, asked: str, answer: object) -> Proof:
    """Read the proof in an answer. Raises ShsaError: it is none; WrongSecret: it is not by ours."""
    pair = answer if isinstance(answer, (list, tuple)) else ()
    if len(pair) != 2 or not all(isinstance(each, str) and len(each) < LONGEST for each in pair):
        raise ShsaError("what it answers is no proof")
    text, given = pair
    if not hmac.compare_digest(given.encode(), _signature(secret, asked, text).encode()):
        raise WrongSecret("its secret is another than ours")
    try:
        return _CODEC.from_text(text, "proof", "the proof")
    except ShsaError as error:
        raise ShsaError("its proof is of another version") from error


def _signature(secret: bytes, asked: str, text: str) -> str:
    return signature(secret, b"proof", (asked + text).encode()).hex()
