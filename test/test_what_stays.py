"""A rostest that leaves a process behind fails, and says who and where it is."""
import os
from pathlib import Path
from typing import Any

import pytest
import rostests

ROSTEST = """#!/usr/bin/python3
import subprocess, sys
print("it ran", flush=True)
stays = "import time; print(flush=True); time.sleep(60.0)"
subprocess.Popen([sys.executable, "-c", stays], stdout=subprocess.PIPE).stdout.readline()
"""


def test_who_stays_is_named_and_tells_where_it_is(tmp_path: Path, monkeypatch: Any) -> None:
    fake = tmp_path / "rostest"
    fake.write_text(ROSTEST)
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", f"{tmp_path}:{os.environ['PATH']}")
    monkeypatch.setattr(rostests, "LEAVING_S", 0.1)
    with pytest.raises(AssertionError) as failed:
        rostests.check(rostests.of_packages("src/shsa_core")[0])
    said = str(failed.value)
    assert said.startswith("it ran\n"), said
    assert "these had not ended:" in said and "time.sleep(60.0)" in said, said
    assert "Fatal Python error: Aborted" in said and 'File "<string>", line 1' in said, said
