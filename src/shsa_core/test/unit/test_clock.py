"""Whose word counts for the time by which healing goes."""
import subprocess
import sys

import pytest

CODE = """
import os, rospy.impl.simtime
from shsa_core.ros.rospy_patches import standing
rospy.impl.simtime._is_use_simtime = lambda: True
standing.heed_launch()
print(rospy.impl.simtime._is_use_simtime())
"""


@pytest.mark.parametrize("value, simulated", ((None, True), ("false", True), ("true", False)))
def test_a_launch_can_say_that_no_parameter_stops_the_time(
    value: str, simulated: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("SHSA_WALL_TIME", raising=False)
    if value is not None:
        monkeypatch.setenv("SHSA_WALL_TIME", value)
    told = subprocess.run([sys.executable, "-c", CODE], stdout=subprocess.PIPE, check=True)
    assert told.stdout.decode().strip() == str(simulated)
