"""The command that starts a node again, of a process that runs."""
import os
import subprocess
import sys
from typing import Dict, List

from shsa_testing.waiting import wait_until
from shsa_view.ros.commands import Commands, command


def test_a_command_can_be_typed_and_has_no_name_of_a_log() -> None:
    words = ["rosrun", "a", "b c", "__name:=x", "__log:=/tmp/x.log"]
    assert command(words, {}) == "rosrun a 'b c' __name:=x"
    assert command(words, {"ROS_NAMESPACE": "/robot 1"}).startswith("ROS_NAMESPACE='/robot 1' ")
    assert command(["b"], {"ROS_NAMESPACE": "/"}) == "b"


def test_a_program_of_a_package_is_started_by_rosrun() -> None:
    there = "/ws/devel/lib/shsa_rover/amperemeter"
    assert command([there, "_rate:=5"], {}) == "rosrun shsa_rover amperemeter _rate:=5"
    assert command(["/usr/bin/python3", there], {}) == "rosrun shsa_rover amperemeter"
    for words in (["python3"], ["python3", "lib"], ["/usr/bin/env", there], ["/opt/x/y"]):
        assert command(words, {}) == " ".join(words)


def test_the_command_of_a_node_that_runs_is_found() -> None:
    uri = os.environ.get("ROS_MASTER_URI", "http://localhost:11311")
    given = {**os.environ, "ROS_MASTER_URI": uri, "ROS_NAMESPACE": "/space"}
    code = "import sys; sys.stdin.read()"
    node = [sys.executable, "-c", code, "__name:=sleeper", "__log:=/tmp/x"]
    found: List[Dict[str, str]] = []
    with subprocess.Popen(node, env=given, stdin=subprocess.PIPE) as process:
        try:
            commands = Commands(lambda told: found.append(dict(told.commands)))
            commands.look(["/space/sleeper", "/nobody"])
            commands.look(["/space/sleeper"])
            wait_until(lambda: found, 30.0, "the processes were looked at")
        finally:
            process.kill()
    ((name, typed),) = found[0].items()
    assert name == "/space/sleeper" and len(found) == 1
    assert typed.startswith("ROS_NAMESPACE=/space ") and typed.endswith(" __name:=sleeper")
