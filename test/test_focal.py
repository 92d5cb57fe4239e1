"""The unit tests of the core by Python 3.8, with the libraries of Ubuntu 20.04."""
import subprocess
from pathlib import Path

import pytest

from shsa_testing.thorough import LONG

FOCAL = Path(__file__).resolve().parent.parent / "tools" / "focal"
LACKS = 3


@pytest.mark.skipif(not LONG, reason="make test-long: it takes minutes")
def test_the_core_does_as_well_with_the_libraries_of_ubuntu_20_04() -> None:
    done = subprocess.run(
        [str(FOCAL)], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True
    )
    if done.returncode == LACKS:
        pytest.skip(done.stdout.splitlines()[-1])
    assert done.returncode == 0, done.stdout[-10_000:]
