"""The number of cases: some in `make test`, all of them in `make test-long`."""
import os
from typing import List, Sequence, TypeVar

LONG = bool(os.environ.get("SHSA_LONG"))
SHARE = 5

Case = TypeVar("Case")


def many(count: int) -> int:
    """So many cases in the long form; one in SHARE of them in the short one."""
    return count if LONG else max(1, count // SHARE)


def some(cases: Sequence[Case], share: int = SHARE) -> List[Case]:
    """Return all cases in the long form; the first of each `share` of them in the short one."""
    return list(cases[:: 1 if LONG else share])
