"""The install space runs the rover, and heals it."""
import json
import os
import signal
import socket
import subprocess
import time
from pathlib import Path
from typing import Any, Dict, Iterator, List

import pytest

from terminals import typed_once_shown

from shsa_testing.thorough import LONG

ROOT = Path(__file__).resolve().parent.parent
OURS = ("ROS_PACKAGE_PATH", "CMAKE_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "PKG_CONFIG_PATH")


def installed(folder: Path) -> Path:
    """Install the workspace into `folder`, in the long form built anew by plain cmake; where."""
    if not LONG:
        run(["cmake", "-P", str(ROOT / "build" / "cmake_install.cmake")], DESTDIR=str(folder))
        return Path(f"{folder}{ROOT}") / "install"
    install = folder / "install"
    configure = ["cmake", "-S", str(ROOT), "-B", str(folder / "build")]
    configure += ["-DPYTHON_EXECUTABLE=/usr/bin/python3", "-DCATKIN_ENABLE_TESTING=OFF"]
    configure += [f"-DCMAKE_INSTALL_PREFIX={install}", f"-DCATKIN_DEVEL_PREFIX={folder / 'devel'}"]
    run(configure)
    run(["make", "-C", str(folder / "build"), "-j2", "install"])
    return install


def run(command: List[str], **environment: str) -> None:
    """Run a step of the installation; fail with what it prints."""
    done = subprocess.run(
        command,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    assert done.returncode == 0, done.stdout[-4000:]


def environment_of(install: Path, port: int) -> Dict[str, str]:
    """Return the environment after `source install/setup.bash`, without the devel space."""
    devel = str(ROOT / "devel")
    clean = dict(os.environ, ROS_MASTER_URI=f"http://localhost:{port}")
    for name in OURS:
        parts = [part for part in clean.get(name, "").split(":") if part and devel not in part]
        clean[name] = ":".join(part for part in parts if not part.startswith(str(ROOT)))
    told = subprocess.run(
        ["bash", "-c", f"source {install}/setup.bash && env -0"],
        env=clean,
        stdout=subprocess.PIPE,
        check=True,
    ).stdout.decode()
    return dict(item.split("=", 1) for item in told.split("\0") if "=" in item)


@pytest.fixture(scope="module")
def environment(tmp_path_factory: Any) -> Dict[str, str]:
    with socket.socket() as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    return environment_of(installed(tmp_path_factory.mktemp("installed")), port)


@pytest.fixture
def rover(environment: Dict[str, str]) -> Iterator[None]:
    port = environment["ROS_MASTER_URI"].rsplit(":", 1)[1]
    command = ["roslaunch", "-p", port, "shsa_rover", "rover.launch"]
    with subprocess.Popen(command, env=environment) as roslaunch:
        yield
        roslaunch.send_signal(signal.SIGINT)


def ask(environment: Dict[str, str], wanted: str, *command: str) -> None:
    """Repeat a command of ROS until it prints what is wanted."""
    deadline = time.monotonic() + 60.0
    printed = ""
    while wanted not in printed:
        assert time.monotonic() < deadline, f"{command} printed: {printed}"
        try:
            printed = subprocess.run(
                command,
                env=environment,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                universal_newlines=True,
                timeout=15.0,
            ).stdout
        except subprocess.TimeoutExpired:
            printed = "nothing"


@pytest.mark.parametrize(
    "name",
    [
        *("shsa_core", "shsa_gate", "shsa_learning", "shsa_injection", "shsa_view", "shsa_rqt"),
        "diff_drive_example",
    ],
)
def test_packages_are_found_where_they_are_installed(
    environment: Dict[str, str], name: str
) -> None:
    found = subprocess.run(
        ["rospack", "find", name], env=environment, stdout=subprocess.PIPE, check=True
    ).stdout.decode()
    assert found.strip().endswith(f"/install/share/{name}"), found


def test_an_example_starts_from_where_it_is_installed(environment: Dict[str, str]) -> None:
    command = ["roslaunch", "--files", "diff_drive_example", "two_robots.launch"]
    told = subprocess.run(command, env=environment, stdout=subprocess.PIPE, check=True).stdout
    files = told.decode().split()
    assert len(files) == 3 and all("/install/share/" in name for name in files), files
    nodes = ["roslaunch", "--args", "/robot1/reconfigurator", "diff_drive_example"]
    told = subprocess.run(
        [*nodes, "two_robots.launch"], env=environment, stdout=subprocess.PIPE, check=True
    ).stdout
    given = [word for word in told.decode().split() if word.endswith(".yaml")]
    assert len(given) == 2 and all(Path(name).is_file() for name in given), given


@pytest.mark.skipif(not LONG, reason="make test-long; test_tutorials heals it where it is built")
def test_the_rover_is_healed(environment: Dict[str, str], rover: None) -> None:
    ask(environment, "percentage", "rostopic", "echo", "-n1", "/battery_state")
    ask(environment, "/amperemeter", "rostopic", "info", "/battery_current")
    ask(
        environment,
        "True",
        "rosservice",
        "call",
        "/shsa/find_substitute",
        "topic: /battery_current",
    )
    ask(environment, "killed", "rosnode", "kill", "/amperemeter")
    ask(environment, "/substitute_", "rostopic", "info", "/battery_current")
    ask(environment, "data:", "rostopic", "echo", "-n1", "/battery_current")
    shows_at_a_glance(environment)


def shows_at_a_glance(environment: Dict[str, str]) -> None:
    """`shsa top` of a rover whose amperemeter has a substitute: in a terminal, and elsewhere."""
    top = ["rosrun", "shsa_core", "shsa", "top"]
    run: Dict[str, Any] = {"env": environment, "stdout": subprocess.PIPE, "timeout": 60.0}
    (row,) = [
        line.split()
        for line in subprocess.run(top, check=True, **run).stdout.decode().splitlines()
        if line.startswith("amperemeter ")
    ]
    assert row[1] == "substituted" and any(word.startswith("/substitute_") for word in row)
    document = json.loads(subprocess.run([*top, "--json"], check=True, **run).stdout)
    assert document["services"]["amperemeter"]["state"] == "substituted"
    shown, status = typed_once_shown(
        top, environment, [("SUBSTITUTED", b"s"), ("sorted by name", b"q")]
    )
    assert status == 0 and shown.endswith("\x1b[?1049l")
