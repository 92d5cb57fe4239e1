"""The simulated rover with its view, on a master of its own."""
import json
import os
import signal
import subprocess
import urllib.request
import uuid
from pathlib import Path
from typing import Any, Dict

from shsa_testing.processes import free_port, marked
from shsa_testing.waiting import wait_until

MARK = "SHSA_LIVE_PAGE"
START_S = 90.0
ENDING_S = 20.0


class Rover:
    """Runs until `end`."""

    def __init__(self, folder: Path) -> None:
        self._mark = uuid.uuid4().hex
        master, view = free_port(), free_port()
        self.address = f"http://127.0.0.1:{view}/"
        uri = f"http://127.0.0.1:{master}"
        self._environment = {**os.environ, MARK: self._mark, "ROS_MASTER_URI": uri}
        log = f"incident_log:={folder / 'incidents.jsonl'}"
        self._launch = self._start(
            *("roslaunch", "-p", str(master), "shsa_rover", "rover.launch", "view:=true"),
            *(f"view_port:={view}", "hold_off:=1.0", log),
        )

    def _start(self, *command: str) -> "subprocess.Popen[bytes]":
        return subprocess.Popen(
            command,
            env=self._environment,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def state(self) -> Dict[str, Any]:
        """Return the document of the view; empty while it is not served."""
        try:
            with urllib.request.urlopen(self.address + "api/state", timeout=5.0) as answer:
                return dict(json.load(answer))
        except OSError:
            return {}

    def wait_until_well(self) -> None:
        """Wait until every needed service is."""
        well = lambda: self.state().get("robot", {}).get("state") == "well"
        wait_until(well, START_S, "the rover is well")

    def kill(self, node: str) -> None:
        """Kill the process of a node."""
        named = [
            each for each in marked(MARK, self._mark) if f"__name:={node}" in each.cmdline()[1:]
        ]
        assert len(named) == 1, f"{node}: {named}"
        named[0].kill()

    def start(self, node: str) -> None:
        """Start a node again, as a person would."""
        self._start("rosrun", "shsa_rover", node, f"__name:={node}")

    def end(self) -> None:
        """End everything, as Ctrl-C does; what stays is killed."""
        try:
            self._launch.send_signal(signal.SIGINT)
            self._launch.wait(ENDING_S)
        finally:
            for process in marked(MARK, self._mark):
                process.kill()
