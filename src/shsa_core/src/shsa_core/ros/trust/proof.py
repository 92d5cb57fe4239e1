"""How a computer proves to another that it holds the same secret, and tells its clocks.

The other one sends a nonce that nobody has seen before. The proof is text, signed together with
the nonce; it is read only if the signature is right.
"""
import hmac
import json
import secrets
from typing import Any, NamedTuple, Sequence

from shsa_core.errors import ShsaError
from shsa_core.ros.trust.places import Place

NONCE_B = 16
LONGEST = 1 << 16
"""Characters of a proof."""


class WrongSecret(ShsaError):
    """Who answers has another secret than we have, or none."""


class Proof(NamedTuple):
    """What a computer says of itself at the moment it is asked."""

    boot: bytes
    """The one that its messages name."""
    host: str
    master: Place
    clock: int
    """Its monotonic clock, in ns."""
    wall: int
    """Its wall clock, in ns since 1970."""


def nonce() -> str:
    """A new one."""
    return secrets.token_hex(NONCE_B)


def is_nonce(text: object) -> bool:
    """Whether somebody asks with a nonce."""
    digits = set("0123456789abcdef")
    return isinstance(text, str) and len(text) == 2 * NONCE_B and digits.issuperset(text)


def written(secret: bytes, asked: str, proof: Proof) -> Sequence[str]:
    """The proof that answers a nonce: its text, and the signature."""
    fields: Any = proof._asdict()
    fields["boot"] = proof.boot.hex()
    fields["master"] = proof.master.network, sorted(proof.master.addresses), proof.master.port
    text = json.dumps(fields)
    return [text, _signature(secret, asked, text)]


def read(secret: bytes, asked: str, answer: object) -> Proof:
    """The proof in an answer. Raises ShsaError if it is none, WrongSecret if its signature is not
    by our secret.
    """
    pair = answer if isinstance(answer, (list, tuple)) else ()
    if len(pair) != 2 or not all(isinstance(each, str) and len(each) < LONGEST for each in pair):
        raise ShsaError("what it answers is no proof")
    text, signature = pair
    if not hmac.compare_digest(signature.encode(), _signature(secret, asked, text).encode()):
        raise WrongSecret("its secret is another than ours")
    try:
        fields = json.loads(text)
        network, addresses, port = fields["master"]
        fields["master"] = Place(network, frozenset(addresses), port)
        fields["boot"] = bytes.fromhex(fields["boot"])
        return Proof(**fields)
    except (ValueError, TypeError, KeyError) as error:
        raise ShsaError("its proof is of another version") from error


def _signature(secret: bytes, asked: str, text: str) -> str:
    key = hmac.digest(secret, b"proof", "sha256")
    return hmac.digest(key, (asked + text).encode(), "sha256").hex()
