"""A live robot is attacked as another user: the short form of `make redteam`, in the long tests."""
import sys
from pathlib import Path

import pytest
from tools_run import run_tool

from shsa_testing.thorough import LONG

ROOT = Path(__file__).resolve().parent.parent
for package in ("shsa_injection", "shsa_core"):
    sys.path.insert(0, str(ROOT / "src" / package / "bench"))

from redteam import refusal  # noqa: E402

TIMEOUT_S = 240.0


@pytest.mark.skipif(not LONG, reason="make test-long: it takes a robot of its own")
@pytest.mark.skipif(bool(refusal()), reason=refusal())
def test_short_form() -> None:
    done = run_tool(str(ROOT / "tools" / "redteam"), "--short", timeout=TIMEOUT_S)
    assert done.returncode == 0, done.stdout
