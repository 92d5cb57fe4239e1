"""The number of random cases: some in `make test`, all of them in `make test-long`."""
import os

LONG = bool(os.environ.get("SHSA_LONG"))
SHARE = 5


def many(count: int) -> int:
    """So many cases in the long form; one in SHARE of them in the short one."""
    return count if LONG else max(1, count // SHARE)
