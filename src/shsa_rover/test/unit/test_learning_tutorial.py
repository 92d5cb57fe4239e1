"""The tutorial of learning, followed: its launch lines load, its commands learn and check."""
import re
import shlex
import subprocess
from pathlib import Path
from typing import Any, Callable, Dict, List

import pytest
import rosbag
import rospy
from geometry_msgs.msg import AccelStamped, Twist
from nav_msgs.msg import Odometry
from rospkg import RosPack
from sensor_msgs.msg import BatteryState, Imu
from shsa_msgs.msg import Float64Stamped

from shsa_core.files.ontology_file import read_ontology
from shsa_rover.dataset import TOPICS, Dataset, random_drive, simulate
from shsa_rover.drive import parse_drive
from shsa_testing.launches import loaded

PACKAGE = Path(__file__).resolve().parents[2]
ROOT = PACKAGE.parents[1]
TUTORIAL = ROOT / "docs" / "tutorials" / "learning.md"
DURATION_S = 25.0  # of a drive, here
TYPES: Dict[str, Callable[[], Any]] = {
    "/battery_current": Float64Stamped,
    "/battery_voltage": Float64Stamped,
    "/odom": Odometry,
    "/drivetrain/accel": AccelStamped,
    "/imu/data": Imu,
    "/battery_state": BatteryState,
    "/cmd_vel": Twist,
}


def commands(program: str) -> List[List[str]]:
    """Return the tutorial's commands that begin with `program`, as words."""
    text = TUTORIAL.read_text(encoding="utf-8").replace("$PWD/", "")
    lines = [line[4:] for line in text.splitlines() if line.startswith("    ")]
    return [shlex.split(line) for line in lines if line.startswith(program)]


def write_bag(path: Path, data: Dataset) -> None:
    """The columns as the rover's messages."""
    with rosbag.Bag(str(path), "w") as bag:
        for row, time in enumerate(data.time):
            stamp = rospy.Time.from_sec(1000.0 + float(time))
            for topic, names in TOPICS.items():
                message = TYPES[topic]()
                if message._has_header:
                    message.header.stamp = stamp
                for name in names:
                    *path_to, last = name[len(topic) + 1 :].split("/")
                    target = message
                    for part in path_to:
                        target = getattr(target, part)
                    setattr(target, last, float(data.measured[name][row]))
                bag.write(topic, message, stamp)


def run(words: List[str], folder: Path) -> str:
    """Return what the command prints; it must succeed."""
    done = subprocess.run(
        words,
        cwd=str(folder),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
        timeout=120.0,
    )
    assert done.returncode == 0, f"{words}: {done.stdout}"
    return done.stdout


def test_the_script_is_varied_and_takes_as_long_as_is_said() -> None:
    path = PACKAGE / "config" / "varied_drive.csv"
    legs = parse_drive(path.read_text(encoding="utf-8").splitlines(), str(path))
    assert sum(leg.duration for leg in legs) == pytest.approx(600.0)
    assert len({leg.velocity for leg in legs}) > 40 and len({leg.turn_rate for leg in legs}) > 60
    assert sum(leg.velocity == leg.turn_rate == 0.0 for leg in legs) > 10


@pytest.mark.parametrize("number", [1, 2, 3, 4])
def test_the_drives_of_the_tutorial_are_varied_too(number: int) -> None:
    path = PACKAGE / "config" / f"drive_{number}.csv"
    legs = parse_drive(path.read_text(encoding="utf-8").splitlines(), str(path))
    assert sum(leg.duration for leg in legs) == pytest.approx(360.0)
    assert min(leg.velocity for leg in legs) < 0.0 and len({leg.velocity for leg in legs}) > 4
    assert len({leg.turn_rate for leg in legs}) > 60
    assert sum(leg.velocity == leg.turn_rate == 0.0 for leg in legs) > 10


def test_the_launch_lines_record_the_topics_of_the_som_and_heal_nothing() -> None:
    lines = commands("roslaunch shsa_rover record.launch")
    assert len(lines) == 4
    for words in lines:
        config = loaded(PACKAGE / "launch" / words[2], *words[3:])
        nodes = {node.name: node for node in config.nodes}
        assert "rover_simulator" in nodes and not {"monitor", "reconfigurator"} & set(nodes)
        bag = next(word[len("bag:=") :] for word in words if word.startswith("bag:="))
        recorder = nodes["recorder"].args.split()
        assert f"--output-name={bag}" in recorder and "--duration=360" in recorder
        script = next(word[len("script:=") :] for word in words if word.startswith("script:="))
        assert (ROOT / script).is_file() and script in " ".join(n.args for n in nodes.values())
        assert nodes["recorder"].required
        # rosbag matches whole names.
        pattern = recorder[recorder.index("--regex") + 1]
        assert all(re.fullmatch(pattern, topic) for topic in TOPICS)
        assert not re.fullmatch(pattern, "/simulation/battery_current")


def test_what_is_recorded_is_learned_checked_and_used(tmp_path: Path) -> None:
    (tmp_path / "src").mkdir()
    (tmp_path / "src" / "shsa_rover").symlink_to(RosPack().get_path("shsa_rover"))
    for number, words in enumerate(commands("roslaunch shsa_rover record.launch")):
        arguments = dict(word.split(":=") for word in words[3:])
        seed, charge = int(arguments["seed"]), float(arguments["state_of_charge"])
        data = simulate(random_drive(20 + number), DURATION_S, seed, charge)
        write_bag(tmp_path / arguments["bag"], data)
    (copy,), (learn, check) = commands("cp "), commands("rosrun shsa_core shsa")
    run(copy, tmp_path)
    before = {function.relation for function in read_ontology(str(tmp_path / copy[2])).functions}
    # A network takes a minute: here it is the model that is the quickest.
    assert learn[learn.index("--model") + 1] == "mlp"
    learn[learn.index("--model") + 1] = "polynomial"
    said = run(learn, tmp_path)
    assert "battery_current by " in said and "learned_battery_current" in said
    after = read_ontology(str(tmp_path / copy[2]))
    assert {function.relation for function in after.functions} == before
    (learned,) = [f for f in after.functions if f.relation == "learned_battery_current"]
    assert learned.error is not None and "drive_1.bag" in str(learned.error.source)
    assert learned.error.rms is not None and learned.error.rms < 0.5
    assert "specific_force" in learned.inputs
    run(check, tmp_path)
    (use,) = commands("roslaunch shsa_rover rover.launch")
    assert use[-1] == f"ontology:={copy[2]}"
