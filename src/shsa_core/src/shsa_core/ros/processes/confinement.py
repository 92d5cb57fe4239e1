"""What a substitute's process may do: limits, no new rights, and a listed environment."""
import resource
import shutil
from typing import Dict, List, Mapping, Sequence

from shsa_core.errors import ShsaError

LIMITS = {"core": 0, "data": 8 * 1024**3, "nofile": 4096}
"""Of a process; in bytes, and open files. A thread counts 8 MiB of data, which it seldom uses."""
NUMBERS = {
    "core": resource.RLIMIT_CORE,
    "data": resource.RLIMIT_DATA,
    "nofile": resource.RLIMIT_NOFILE,
}
NAMES = (
    "CMAKE_PREFIX_PATH",
    "HOME",
    "LANG",
    "LANGUAGE",
    "LD_LIBRARY_PATH",
    "LOGNAME",
    "PATH",
    "PYTHONPATH",
    "PYTHONUNBUFFERED",
    "TMPDIR",
    "TZ",
    "USER",
)
BEGINNINGS = ("LC_", "ROS_", "ROSCONSOLE_", "SHSA_")
"""Of the names of environment variables that a ROS node of ours reads."""


def environment(ours: Mapping[str, str]) -> Dict[str, str]:
    """What of our environment a substitute inherits: nothing that it has no use for."""
    return {
        name: value for name, value in ours.items() if name in NAMES or name.startswith(BEGINNINGS)
    }


def wrapper(sandbox: Sequence[str]) -> List[str]:
    """The words that go before a substitute's command; `sandbox`: the user's own.

    Raises ShsaError if there is no such program.
    """
    if sandbox and shutil.which(sandbox[0]) is None:
        raise ShsaError(f"there is no program {sandbox[0]} to run the substitutes in")
    words: List[str] = []
    if shutil.which("prlimit"):
        words += ["prlimit", *(f"--{name}={_lowered(name)}" for name in LIMITS)]
    if shutil.which("setpriv"):
        words += ["setpriv", "--no-new-privs"]
    return [*words, *sandbox]


def _lowered(name: str) -> int:
    """A limit as we want it, or as it is if that is less: nobody may raise it."""
    hard = resource.getrlimit(NUMBERS[name])[1]
    return LIMITS[name] if hard == resource.RLIM_INFINITY else min(LIMITS[name], hard)
