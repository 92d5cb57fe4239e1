"""The Debian packages are built, hold what a robot needs, and can be installed here."""
import shutil
import subprocess
from pathlib import Path
from typing import List

import pytest
from listings import ROOT

from shsa_testing.thorough import LONG

NEEDED = (
    *("/usr/bin/shsa", "/usr/lib/shsa_core/monitor", "/usr/share/shsa_core/launch/shsa.launch"),
    *("/usr/share/shsa_msgs/package.xml", "/usr/lib/python3/dist-packages/shsa_core/__init__.py"),
)
NOT_FOR_ALL = ("/usr/setup.sh", "/usr/.catkin", "/usr/_setup_util.py")
"""Files of a workspace, which a package must not bring."""


def told(*words: str) -> str:
    return subprocess.run(words, stdout=subprocess.PIPE, check=True, universal_newlines=True).stdout


@pytest.mark.skipif(not LONG, reason="builds for minutes; make test-long does")
@pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="no Debian")
@pytest.mark.skipif(Path("/opt/ros/noetic").is_dir(), reason="the paths are those of Debian's ROS")
def test_the_packages_are_built_and_can_be_installed(tmp_path: Path) -> None:
    built: List[str] = told(str(ROOT / "tools" / "deb"), "--output", str(tmp_path)).split()
    core, tools = built
    held = {line.split(None, 5)[5][1:] for line in told("dpkg-deb", "-c", core).splitlines()}
    assert held >= {*NEEDED} and not held & {*NOT_FOR_ALL}
    assert "/usr/lib/shsa_view/view" in told("dpkg-deb", "-c", tools)
    assert "ros-noetic-shsa-core (= " in told("dpkg-deb", "-f", tools, "Depends")
    told("apt-get", "install", "--simulate", "--no-install-recommends", core, tools)
