"""The confinement of a substitute's process: looked at in a real one."""
import json
import os
import resource
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, List

import pytest
from rospkg import RosPack

from shsa_core.errors import ShsaError
from shsa_core.healing.events import StartSubstitute
from shsa_core.ros.processes import starting
from shsa_core.ros.processes.starting import Substitutes, Setup
from shsa_testing.waiting import wait_until

LOOK = """
import json, os, resource, sys
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
limits = [resource.getrlimit(n) for n in (resource.RLIMIT_CORE, resource.RLIMIT_DATA)]
found = {"status": status, "limits": limits, "environment": dict(os.environ)}
path = os.environ["SHSA_FOUND"]
json.dump(found, open(path + "_", "w"))
os.rename(path + "_", path)
"""
NODE = "/substitute_a_7"


@pytest.fixture
def looked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the file into which a substitute writes what it finds out about itself."""
    script = tmp_path / "standby"
    script.write_text(f"#!{sys.executable}\n{LOOK}")
    script.chmod(0o755)
    bin_folder = tmp_path / "bin"
    bin_folder.mkdir()
    rosrun = bin_folder / "rosrun"
    rosrun.write_text(f"#!/bin/sh\nexec {script}\n")
    rosrun.chmod(0o755)
    monkeypatch.setenv("PATH", f"{bin_folder}:{os.environ['PATH']}")
    monkeypatch.setenv("SHSA_FOUND", str(tmp_path / "found"))
    monkeypatch.setattr(starting, "find_node", lambda *_: [str(script)])
    monkeypatch.setattr(RosPack, "get_path", lambda *_: str(tmp_path))
    return tmp_path / "found"


def start(found: Path, sandbox: List[str]) -> Dict[str, Any]:
    ended: List[str] = []
    ours = Substitutes(
        lambda node, detail: ended.append(detail), lambda node: None, Setup("/", sandbox=sandbox)
    )
    ours.start(StartSubstitute(NODE, None))
    wait_until(lambda: ended and found.exists(), 20.0, "it has looked")
    result: Dict[str, Any] = json.loads(found.read_text())
    return result


def test_a_substitute_has_limits_and_no_new_rights(
    looked: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    monkeypatch.setenv("LD_PRELOAD", "")
    monkeypatch.setenv("LC_ALL", "C.UTF-8")
    monkeypatch.setenv("ROS_IP", "127.0.0.1")
    found = start(looked, [])
    assert found["status"]["NoNewPrivs"].strip() == "1"
    assert found["limits"][0] == [0, 0]
    assert found["limits"][1][1] <= starting.LIMITS["data"][1]
    environment = found["environment"]
    assert "AWS_SECRET_ACCESS_KEY" not in environment and "LD_PRELOAD" not in environment
    assert (environment["LC_ALL"], environment["ROS_IP"]) == ("C.UTF-8", "127.0.0.1")
    assert environment["ROS_NAMESPACE"] == "/"


def test_a_limit_is_never_raised() -> None:
    program = "import resource; from shsa_core.ros.processes.starting import wrapper; "
    program += "resource.setrlimit(resource.RLIMIT_NOFILE, (100, 100)); print(wrapper([]))"
    told = subprocess.check_output([sys.executable, "-c", program]).decode()
    assert "--nofile=100'" in told
    hard = resource.getrlimit(resource.RLIMIT_CORE)[1]
    assert resource.getrlimit(resource.RLIMIT_CORE)[1] == hard  # ours are as they were


def test_a_sandbox_goes_round_it(looked: Path) -> None:
    found = start(looked, ["env", "SHSA_SANDBOX=here"])
    assert found["environment"]["SHSA_SANDBOX"] == "here"


def test_a_sandbox_that_is_not_there_is_told_at_once(looked: Path) -> None:
    with pytest.raises(ShsaError, match="no program no_such_program to run the substitutes in"):
        Substitutes(
            lambda node, detail: None, lambda node: None, Setup("/", sandbox=["no_such_program"])
        )
