"""`shsa init` on recordings: what it writes, what it refuses, and how it answers."""
import json
import math
import os
import random
from pathlib import Path
from typing import Any, Callable, Dict, List

import pytest
import rosbag
from geometry_msgs.msg import Twist
from nav_msgs.msg import Odometry
from sensor_msgs.msg import BatteryState, Imu, JointState, LaserScan, Range
from std_msgs.msg import Float64, String

from recordings import BagWriter
from shsa_core import message_types
from shsa_core.cli.main import main
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.kinds import Contain
from shsa_core.model.som import Som
from shsa_learning.check import check_files
from shsa_learning.init.prospects import obstacles
from shsa_testing.models import law, ontology, som_of, source
from shsa_testing.thorough import many

END_S = 10.0
Make = Callable[[float], Any]


def odometry(t: float) -> Odometry:
    message = Odometry()
    message.twist.twist.linear.x = 0.4 * math.sin(t)
    message.pose.pose.orientation.w = math.cos(t / 5)
    message.pose.pose.orientation.z = math.sin(t / 5)
    return message


def imu(t: float) -> Imu:
    message = Imu()
    message.angular_velocity.z = math.cos(t)
    message.orientation_covariance[0] = -1.0
    return message


def scan(t: float) -> LaserScan:
    return LaserScan(range_max=12.0, ranges=[1.0 + 0.5 * math.sin(t), math.inf, math.nan] * 100)


def joints(t: float) -> JointState:
    return JointState(name=["left_wheel", "a joint"], position=[t, t], velocity=[math.sin(t)] * 2)


def battery(t: float) -> BatteryState:
    return BatteryState(voltage=12.0 - 0.1 * t, current=math.nan, cell_voltage=[4.0 - 0.03 * t] * 3)


def twist(t: float) -> Twist:
    message = Twist()
    message.linear.x = math.sin(t)
    return message


def record(
    bag: BagWriter, topic: str, node: str, hz: float, make: Make, end: float = END_S
) -> None:
    """Have a node publish until `end` s."""
    for k in range(int(end * hz)):
        bag.write(topic, make(k / hz), 1000.0 + k / hz, node)


@pytest.fixture(scope="module")
def turtle(tmp_path_factory: Any) -> str:
    """The recording of a small wheeled robot."""
    path = tmp_path_factory.mktemp("bag") / "turtle.bag"
    with BagWriter(path) as bag:
        record(bag, "/odom", "/base", 30.0, odometry)
        record(bag, "/imu/data", "/imu", 100.0, imu)
        record(bag, "/scan", "/lidar", 10.0, scan)
        record(bag, "/joint_states", "/base", 20.0, joints)
        record(bag, "/battery", "/base", 1.0, battery)
        record(bag, "/sonar/left", "/sonars", 10.0, lambda t: Range(range=1.0 + math.sin(t)))
        record(bag, "/cmd_vel", "/teleop", 10.0, twist, 2.0)
        record(bag, "/cmd_vel", "/navigation", 10.0, twist)
        record(bag, "/words", "/talker", 10.0, lambda _: String("word"))
        record(bag, "/nobodys", "", 10.0, lambda t: Float64(math.sin(t)))
    return str(path)


@pytest.fixture
def init(tmp_path: Path, capsys: Any) -> "Init":
    return Init(tmp_path, capsys)


class Init:
    """Calls the command."""

    def __init__(self, folder: Path, capsys: Any) -> None:
        self.som, self.ontology = str(folder / "som.yaml"), str(folder / "ontology.yaml")
        self._capsys = capsys
        self.said = self.complained = ""

    def __call__(self, *words: str) -> int:
        status = main(["init", *words])
        self.said, self.complained = self._capsys.readouterr()
        return status

    def drafts(self, bag: str) -> Som:
        """Return the SOM of a recording, once it is checked with its ontology."""
        assert self("--bag", bag, "--som", self.som, "--ontology", self.ontology) == 0
        assert check_files(self.ontology, self.som, message_types) == []
        return read_som(self.som)


def test_a_recording_of_a_wheeled_robot(init: Init, turtle: str) -> None:
    services = init.drafts(turtle).services
    assert {name: service.period for name, service in services.items()} == {
        "battery": 1.0,
        "cmd_vel_navigation": 0.1,
        "cmd_vel_teleop": None,
        "imu": 0.01,
        "joint_states": 0.05,
        "nobodys": 0.1,
        "odom": 0.033,
        "scan": 0.1,
        "sonar_left": 0.1,
    }
    assert services["odom"].node == "/base" and services["nobodys"].node == "/unknown"
    fields = {p.property: p.field for s in services.values() for p in s.provides}
    assert fields["odom_yaw"] == "yaw(pose.pose.orientation)"
    assert fields["scan_nearest_distance"] == "min(ranges)"
    assert fields["joint_states_left_wheel_velocity"] == "velocity[name=left_wheel]"
    assert fields["battery_cell_voltage_0"] == "cell_voltage[0]"
    assert "a joint" in Path(init.som).read_text()
    assert "9 services" in init.said and "shsa check" in init.said
    assert "\nNothing can be healed by this yet. In the way:\n  battery: no relation " in init.said


def test_a_second_recording_widens_what_the_first_drafted(
    init: Init, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def speeds(most: float, hz: float) -> str:
        path = tmp_path / f"{most}.bag"
        with BagWriter(path) as bag:
            for topic in ("/left", "/right"):
                record(bag, topic, "/wheels", hz, lambda t: Float64(most * math.sin(t)))
            record(bag, "/slow", "/slow", hz, lambda t: Float64(math.sin(t)))
            if most > 1.0:
                record(bag, "/tf", "/slow", hz, lambda _: String("frames"))
        return str(path)

    init.drafts(speeds(1.0, 10.0))
    som = Path(init.som)
    text = som.read_text().replace("usual: [-3.0, 3.0]", "usual: [-9.0, 9.0]", 1)
    som.write_text(text.replace("\nservices:", "\n# mine\nact: true\nservices:"))
    assert init("--again", "--bag", speeds(2.0, 8.0), "--som", init.som) == 0
    services = read_som(init.som).services
    assert {name: (s.period, s.provides[0].usual) for name, s in services.items()} == {
        "left": (0.125, (-9.0, 9.0)),
        "right": (0.125, (-6.0, 6.0)),
        "slow": (0.125, (-3.0, 3.0)),
    }
    assert "# mine\nact: true" in som.read_text() and read_som(init.som).act
    assert "left: usual of left stays [-9.0, 9.0], as somebody wrote" in init.said
    assert "right: usual of right is [-6.0, 6.0], it was [-3.0, 3.0]" in init.said
    assert "slow: contain is none, it was unsaid" in init.said
    assert services["slow"].contain is Contain.NONE and services["left"].contain is None
    assert init("--again", "--bag", speeds(1.0, 8.0), "--som", init.som) == 1
    assert init.said == "nothing new was seen\n"


def test_again_says_which_file_is_not_there(init: Init, turtle: str) -> None:
    init.drafts(turtle)
    renamed = Path(init.som).rename(Path(init.som).with_name("renamed.yaml"))
    assert init("--again", "--bag", turtle, "--som", str(renamed)) == 2
    drafted = renamed.with_name("renamed.drafted.yaml")
    told = f"shsa: {drafted}: is not there: {renamed} as `shsa init` drafted it"
    assert init.complained.startswith(told)


def test_the_survey_as_a_document(init: Init, turtle: str) -> None:
    assert init("--bag", turtle, "--json") == 0
    document: Dict[str, Any] = json.loads(init.said)
    odom = next(each for each in document["facts"] if each["publisher"]["topic"] == "/odom")
    assert odom["period"] == 0.033 and odom["rhythm"]["count"] == 300
    speed = next(f for f in odom["fields"] if f["number"]["field"] == "twist.twist.linear.x")
    assert speed["spread"]["highest"] == pytest.approx(0.4, abs=1e-3)
    assert document["services"] == 9 and document["som"] is None
    assert [each["topic"] for each in document["refused"]] == []


def test_without_a_file_the_som_is_printed(init: Init, turtle: str, tmp_path: Path) -> None:
    assert init("--bag", turtle) == 0
    (tmp_path / "printed.yaml").write_text(init.said)
    assert len(read_som(str(tmp_path / "printed.yaml"))) == 9
    assert "# Nothing can be healed by this yet. In the way:\n#   battery: " in init.said


def test_what_is_in_the_way_is_told_where_nothing_can_be_healed() -> None:
    parts = [source(name, "/odom", "/base") for name in ("speed", "turn")] + [source("wheel")]
    laws = ontology(law("rolling", "speed", "wheel"), law("turning", "turn", "gyro"))
    assert obstacles(laws, som_of(parts)) == [
        "Nothing can be healed by this yet. In the way:",
        "  odom_of_base: no relation yields turn",
        "  wheel_of_node_of_wheel: no relation yields wheel",
    ]
    assert obstacles(laws, som_of([*parts, source("gyro")])) == []


def test_files_that_are_there_are_kept_unless_forced(init: Init, turtle: str) -> None:
    Path(init.som).write_text("mine")
    assert init("--bag", turtle, "--som", init.som) == 2
    assert "--force" in init.complained and Path(init.som).read_text() == "mine"
    assert init("--bag", turtle, "--som", init.som, "--force") == 0
    assert len(read_som(init.som)) == 9


@pytest.mark.parametrize(
    "words, why",
    [
        (["--som", "{}/no/som.yaml"], "no such folder"),
        (["--som", "{}/a", "--ontology", "{}/a"], "a file each"),
        (["--som", "{}"], "is there already"),
        (["--som", "{}", "--force"], "is there already"),
    ],
)
def test_what_cannot_be_written_is_told_first(
    init: Init, tmp_path: Path, words: List[str], why: str
) -> None:
    given = [word.format(tmp_path) for word in words]
    assert init("--bag", "is not read", *given) == 2
    assert why in init.complained


def test_a_recording_without_numbers_is_no_model(init: Init, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "words.bag") as bag:
        record(bag, "/words", "/talker", 10.0, lambda _: String("word"))
    assert init("--bag", str(tmp_path / "words.bag")) == 1
    assert "services:" not in init.said and "/words" in init.said
    assert "nobody published a number in " in init.complained


def test_an_empty_recording_is_no_draft_to_correct(init: Init, tmp_path: Path) -> None:
    bag = str(tmp_path / "empty.bag")
    rosbag.Bag(bag, "w").close()
    assert init("--bag", bag, "--som", init.som, "--ontology", init.ontology) == 1
    assert init.said == "" and not os.path.exists(init.som) and not os.path.exists(init.ontology)
    assert "nobody published a number in 0 s of empty.bag" in init.complained


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.9, 0.999])
def test_a_recording_that_was_cut_off_is_refused(
    init: Init, turtle: str, tmp_path: Path, share: float
) -> None:
    data = Path(turtle).read_bytes()
    (tmp_path / "cut.bag").write_bytes(data[: int(share * len(data))])
    assert init("--bag", str(tmp_path / "cut.bag")) == 2
    assert "cut.bag" in init.complained and init.complained.count("\n") == 1


def test_a_recording_with_wrong_bytes_is_read_or_refused(
    init: Init, turtle: str, tmp_path: Path
) -> None:
    data = Path(turtle).read_bytes()
    for seed in range(many(40)):
        draw = random.Random(seed)
        broken = bytearray(data)
        for _ in range(20):
            broken[draw.randrange(len(broken))] = draw.randrange(256)
        (tmp_path / "broken.bag").write_bytes(broken)
        assert init("--bag", str(tmp_path / "broken.bag")) in (0, 1, 2)


@pytest.mark.parametrize("path", ["/dev/null", "/nowhere.bag", "."])
def test_what_is_no_recording_is_refused(init: Init, path: str) -> None:
    assert init("--bag", path) == 2
    assert path in init.complained


def test_a_pipe_keeps_nobody_waiting(init: Init, tmp_path: Path) -> None:
    os.mkfifo(str(tmp_path / "pipe"))
    assert init("--bag", str(tmp_path / "pipe")) == 2
    assert "pipe" in init.complained


def test_without_a_master_and_a_recording(init: Init, monkeypatch: Any) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://127.0.0.1:9")
    assert init("--seconds", "1") == 2
    assert "http://127.0.0.1:9" in init.complained and "--bag" in init.complained


class Unknown(Float64):
    """A type that is not built here."""

    _type = "nowhere_msgs/Thing"


class Newer(Float64):
    """A type that has another version here."""

    _md5sum = "0" * 32


def test_types_that_are_not_here_are_told(init: Init, tmp_path: Path) -> None:
    with BagWriter(tmp_path / "strange.bag") as bag:
        record(bag, "/known", "/node", 10.0, lambda t: Float64(math.sin(t)))
        record(bag, "/thing", "/node", 10.0, lambda t: Unknown(t))
        record(bag, "/newer", "/node", 10.0, lambda t: Newer(t))
    som = init.drafts(str(tmp_path / "strange.bag"))
    assert list(som.services) == ["known"]
    told = Path(init.som).read_text()
    assert "nowhere_msgs/Thing is not known here" in told and "another version" in told


@pytest.fixture(scope="module")
def drive(tmp_path_factory: Any) -> str:
    """Two minutes of a drive: wheel speeds, the base's speed, and a sonar that knows nothing."""
    path = tmp_path_factory.mktemp("bag") / "drive.bag"
    draw = random.Random(1)

    def speed(t: float) -> float:
        return math.sin(0.7 * t) + 0.5 * math.sin(0.31 * t)

    def turn(t: float) -> float:
        return math.cos(0.5 * t) + 0.4 * math.sin(1.1 * t)

    def noisy(value: float) -> Float64:
        return Float64(value + draw.gauss(0.0, 0.02))

    with BagWriter(path) as bag:
        rows: List[Any] = [
            ("/speed", "/base", lambda t: noisy(speed(t))),
            ("/left/speed", "/left", lambda t: noisy(speed(t) - 0.2 * turn(t))),
            ("/right/speed", "/right", lambda t: noisy(speed(t) + 0.2 * turn(t))),
            ("/sonar", "/sonar", lambda t: Float64(draw.gauss(1.0, 0.1))),
            ("/warmth", "/thermometer", lambda t: noisy(20.0 + 0.05 * t)),
            ("/age", "/clock_node", lambda t: noisy(0.1 * t)),
        ]
        for topic, node, make in rows:
            record(bag, topic, node, 10.0, make, 120.0)
    return str(path)


def test_what_can_be_expressed_by_what(init: Init, drive: str) -> None:
    words = ("--bag", drive, "--som", init.som, "--ontology", init.ontology, "--learn", "--json")
    assert init(*words) == 0
    assert check_files(init.ontology, init.som, message_types) == []
    relations = {f.output: f for f in read_ontology(init.ontology).functions}
    assert set(relations["speed"].inputs) == {"left_speed", "right_speed"}
    error = relations["speed"].error
    assert error is not None and error.rms < 0.05
    learned = {each["property"]: each for each in json.loads(init.said)["learned"]}
    assert learned["speed"]["reason"] == "" and learned["speed"]["rms"] == error.rms
    for name in ("sonar", "warmth", "age"):  # noise, and two things that drift
        assert name not in relations and "nothing" in learned[name]["reason"]
    assert "shsa init" in Path(init.ontology).read_text()


@pytest.mark.parametrize("words", [["--seconds", "5"], ["--bag", "drive.bag"]])
def test_learning_needs_a_recording_and_a_file(init: Init, words: List[str]) -> None:
    assert init("--learn", *words) == 2
    assert "--bag" in init.complained
