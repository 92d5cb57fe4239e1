"""How much is tried: by `make test` some of the random cases, by `make test-long` all, and more."""
import os

LONG = bool(os.environ.get("SHSA_LONG"))
SHARE = 5


def many(count: int) -> int:
    """So many cases in the long form; one in SHARE of them in the short one."""
    return count if LONG else max(1, count // SHARE)
