"""The rover on three computers, and its amperemeter killed: prints what came of it, in JSON.

`where`: the address that each topic comes from, by name of the computer; `state` of the incident;
`publishers`: who published the current after it was healed; `gap`: the longest pause of the state
of charge, in s, from the kill until it has come for a second beside the substitute.
"""
import json
import os
import signal
import subprocess
import sys
import time
from typing import Dict
from urllib.parse import urlparse

import rosgraph
import rospy

from shsa_rover.hosts_demonstration import COMPUTERS, MASTER, launching, prepare
from shsa_testing.computers import Computers
from shsa_testing.healing import HealedRobot, TopicRecord
from shsa_testing.processes import end_process
from shsa_testing.waiting import wait_until

PATIENCE_S = 60.0
CURRENT, CHARGE = "/battery_current", "/battery_state"
NODES = {
    CURRENT: "/amperemeter",
    "/imu/data": "/imu",
    "/odom": "/drivetrain",
    "/battery_voltage": "/voltmeter",
    CHARGE: "/soc_estimator",
    "/cmd_vel": "/driver",
}


def measure(network: Computers) -> object:
    """Kill the amperemeter once all is well."""
    wait_until(rosgraph.is_master_online, PATIENCE_S, "the master")
    rospy.init_node("test_hosts", disable_signals=True)
    robot = HealedRobot()
    heard = {topic: TopicRecord(topic) for topic in NODES}
    for topic, node in NODES.items():
        heard[topic].await_node(node, PATIENCE_S)
    robot.await_available(CURRENT, "/odom", "/battery_voltage", seconds=PATIENCE_S)
    robot.await_verified("/amperemeter", seconds=PATIENCE_S)
    wait_until(lambda: robot.substitutions, PATIENCE_S, "a substitute at hand")
    names = {network[name].address: name for name in COMPUTERS}
    where: Dict[str, str] = {}
    for topic, node in NODES.items():
        uri = rosgraph.Master(rospy.get_name()).lookupNode(node)
        where[topic] = names[str(urlparse(uri).hostname)]
    amperemeter = [
        p for p in network["raspberry_pi"].processes() if "__name:=amperemeter" in p.cmdline()
    ]
    killed = time.monotonic()
    amperemeter[0].send_signal(signal.SIGKILL)
    state = robot.await_state(CURRENT, "healed", PATIENCE_S).state
    substitute = robot.latest(CURRENT).substitute  # type: ignore[union-attr]
    heard[CURRENT].await_node(substitute, PATIENCE_S)
    healed = time.monotonic()
    charge = heard[CHARGE]
    after = lambda: [at for at in charge.times(NODES[CHARGE]) if at > killed]
    wait_until(lambda: after() and after()[-1] > healed + 1.0, PATIENCE_S, "state of charge")
    times = [killed, *after()]
    gap = max(later - earlier for earlier, later in zip(times, times[1:]))
    publishers = sorted({who for at, who in heard[CURRENT].heard if at > healed})
    return {"where": where, "state": state, "publishers": publishers, "gap": round(gap, 3)}


def main() -> int:
    """Run the rover."""
    with Computers(*COMPUTERS, ssh=True) as network:
        prepare(network)
        os.environ["ROS_IP"] = network.here
        os.environ["ROS_MASTER_URI"] = f"http://{network[MASTER].address}:11311"
        output = network.folder / "output"
        with open(str(output), "w") as file:
            command = launching(network, "shsa_rover", "rover_distributed.launch")
            launch = subprocess.Popen(command, stdout=file, stderr=subprocess.STDOUT)
        try:
            print(json.dumps(measure(network)), flush=True)
        except AssertionError:
            print(output.read_text()[-4000:], file=sys.stderr)
            raise
        finally:
            # Later there is no master to tell that we go, and no way to it.
            rospy.signal_shutdown("the test ends")
            end_process(launch)
    return 0


if __name__ == "__main__":
    sys.exit(main())
