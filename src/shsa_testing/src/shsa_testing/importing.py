"""Imports modules in a process in which others cannot be imported."""
import subprocess
import sys
from typing import Iterable, Tuple

SCRIPT = """
import importlib, sys
sys.modules.update(dict.fromkeys(sys.argv[1].split(",")))  # importing one of them fails
for name in sys.argv[2:]:
    importlib.import_module(name)
"""


def import_without(forbidden: str, names: Iterable[str]) -> Tuple[int, str]:
    """Return the exit status and what is printed; `forbidden`: modules, comma-separated."""
    process = subprocess.run(
        [sys.executable, "-c", SCRIPT, forbidden, *names],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    return process.returncode, process.stdout
