"""Recorded data: rosbags by a SOM, and what of them is left out."""
import math
import resource
from pathlib import Path
from typing import Any, List, Sequence, Tuple

import numpy as np
import psutil
import pytest
import rosbag
import rospy
from genpy.dynamic import generate_dynamic
from nav_msgs.msg import Odometry
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64, String

from recordings import BEGIN_S, CURRENT, SPEED, BagWriter, only, som_of, told, write_csv
from shsa_core.errors import ShsaError
from shsa_core.ros.wire import names
from shsa_learning.explain.bag import read_healing
from shsa_learning.recordings import bags
from shsa_learning.recordings.bags import read_bag
from shsa_learning.recordings.data import read
from shsa_learning.recordings.recording import Recording, Series
from shsa_learning.ros.survey_bag import survey_bag
from shsa_msgs.msg import Float64Stamped, Incident, Substitution, Substitutions


def odometry(speed: float, stamp: float) -> Odometry:
    message = Odometry()
    message.twist.twist.linear.x = speed
    message.header.stamp = rospy.Time.from_sec(stamp)
    return message


def ramp(n: int, step: float = 0.1, begin: float = BEGIN_S) -> Tuple[Tuple[float, float], ...]:
    return tuple((begin + step * k, float(k)) for k in range(n))


def bag(tmp_path: Path) -> Path:
    return tmp_path / "drive.bag"


def test_a_bag_is_read_by_the_som_and_by_header_stamps(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        for time, value in ramp(50):
            out.write("/odom", odometry(value, time - 0.03), time, "/wheels")
            out.write("/unknown", String("not in the SOM"), time, "/somebody")
        out.floats("/current", ramp(10), "/amperemeter")
    recording = read_bag(str(bag(tmp_path)), som_of(odom=SPEED, amps=CURRENT))
    assert recording.properties == ("speed", "current")
    speed = recording.only("speed")
    assert (speed.source, speed.node, speed.service) == (
        "/odom/twist/twist/linear/x",
        "/wheels",
        "odom",
    )
    np.testing.assert_allclose(speed.time, [time - 0.03 for time, _ in ramp(50)], atol=1e-6)
    np.testing.assert_array_equal(speed.values, np.arange(50.0))
    np.testing.assert_allclose(recording.only("current").time, [t for t, _ in ramp(10)])
    assert recording.duration == pytest.approx(4.9, abs=1e-5)
    assert not recording.notes


def test_a_topic_that_was_not_recorded_is_named(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        out.floats("/current", ramp(3), "/amperemeter")
    recording = read_bag(str(bag(tmp_path)), som_of(odom=SPEED, amps=CURRENT))
    assert recording.notes == ("nothing of /odom",)
    with pytest.raises(ShsaError, match="drive.bag: has no speed; recorded were current"):
        recording.only("speed")


def test_values_of_arrays_and_of_messages_in_messages_are_read(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        for time, value in ramp(5):
            out.write("/battery", JointState(position=[1.0, value]), time, "/bms")
    fields = {"volts": "position[1]", "most": "max(position)"}
    som = som_of(battery=("/battery", "sensor_msgs/JointState", "/bms", fields))
    recording = read_bag(str(bag(tmp_path)), som)
    assert [list(series.values) for series in recording.series] == [
        [0.0, 1.0, 2.0, 3.0, 4.0],
        [1.0, 1.0, 2.0, 3.0, 4.0],
    ]
    wrong = som_of(battery=("/battery", "sensor_msgs/JointState", "/bms", {"volts": "inner.volts"}))
    with pytest.raises(ShsaError, match="drive.bag: /battery: .* has no field inner.volts"):
        read_bag(str(bag(tmp_path)), wrong)
    other = som_of(battery=("/battery", "std_msgs/Float64", "/bms", {"volts": "data"}))
    with pytest.raises(ShsaError, match="is a sensor_msgs/JointState; the SOM says std_msgs/Float"):
        read_bag(str(bag(tmp_path)), other)


HOSTILE = "float64 data\nint8 __import__('os').mkdir('{}').x=1\n"
"""The definition of a message, as Python once genpy has made a module of it."""


@pytest.mark.parametrize(
    "kind, md5sum, told",
    [
        ("std_msgs/Float64", Float64._md5sum, ""),
        ("std_msgs/Float64", "0" * 32, "std_msgs/Float64 is another version there"),
        ("nowhere_msgs/Float64", "1" * 32, "message type nowhere_msgs/Float64 is not known here"),
    ],
)
def test_no_definition_of_a_bag_is_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kind: str, md5sum: str, told: str
) -> None:
    made = tmp_path / "made"
    text = HOSTILE.format(made)
    with pytest.raises(AttributeError):
        generate_dynamic("x/Y", text)
    made.rmdir()  # so the bag is hostile
    own = dict(_type=kind, _md5sum=md5sum, _full_text=text)
    hostile = type("Float64", (Float64,), own)
    topics = "/current", "/shsa/incidents", "/shsa/failures", "/shsa/substitutions"
    with BagWriter(bag(tmp_path)) as out:
        for topic in topics[: 1 if not told else 4]:
            out.write(topic, hostile(2.5), BEGIN_S, "/amperemeter")
        out.floats("/honest", [(BEGIN_S, 3.5)], "/other")
    monkeypatch.setattr(rosbag.bag, "_message_types", {})
    som = som_of(amps=CURRENT, honest=("/honest", "std_msgs/Float64", "/other", {"a": "data"}))
    recording = read_bag(str(bag(tmp_path)), som)
    assert [series.property for series in recording.series] == ["a"] if told else ["current", "a"]
    notes = [*recording.notes, *read_healing(str(bag(tmp_path))).notes]
    if told:
        for topic in topics:
            assert any(f"{topic} is left out: {told}" in note for note in notes), topic
    survey_bag(str(bag(tmp_path)))
    if told:
        with pytest.raises(ShsaError, match=told), bags.opened(str(bag(tmp_path))) as opened:
            list(opened.read_messages())
    assert not made.exists()


def test_a_bag_takes_half_of_the_free_memory_at_most(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = psutil.virtual_memory()._replace(available=100 << 20)
    monkeypatch.setattr(psutil, "virtual_memory", lambda: free)
    limits = resource.getrlimit(resource.RLIMIT_DATA)
    with rosbag.Bag(str(bag(tmp_path)), "w", compression="bz2") as out:
        out.write("/current", String("x" * (150 << 20)))
    with pytest.raises(ShsaError, match="drive.bag: cannot be read as a rosbag"):
        read_bag(str(bag(tmp_path)), som_of(amps=CURRENT))
    assert resource.getrlimit(resource.RLIMIT_DATA) == limits


def test_messages_of_substitutes_are_left_out_by_their_publisher(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        out.floats("/current", ramp(20), "/amperemeter")
        wrong = [(time, -1.0) for time, _ in ramp(15, begin=BEGIN_S + 2.0)]
        out.floats("/current", wrong, "/substitute_current_1")
    recording = read_bag(str(bag(tmp_path)), som_of(amps=CURRENT))
    np.testing.assert_array_equal(only(recording).values, np.arange(20.0))
    assert recording.notes == (
        "15 messages left out: /current by the substitute /substitute_current_1",
    )


def test_a_substitute_of_any_name_is_known_by_the_table_that_healing_recorded(
    tmp_path: Path,
) -> None:
    with BagWriter(bag(tmp_path)) as out:
        row = Substitution(node="/stand_in", service="amps")
        out.write("/robot/shsa/substitutions", Substitutions(substitutions=[row]), BEGIN_S)
        out.floats("/current", ramp(20), "/amperemeter")
        out.floats("/current", ramp(15, begin=BEGIN_S + 2.0), "/stand_in")
    recording = read_bag(str(bag(tmp_path)), som_of(amps=CURRENT))
    assert len(only(recording)) == 20
    assert told(recording, "15 messages left out: /current by the substitute /stand_in")


@pytest.mark.parametrize("publisher", ["", "/amperemeter", "/play_17"])
def test_where_publishers_are_lost_or_wrong_the_recorded_incident_tells(
    tmp_path: Path, publisher: str
) -> None:
    with BagWriter(bag(tmp_path)) as out:
        incident = Incident(id=1, service="amps", topic="/current", faulty_node="/amperemeter")
        incident.last_good = rospy.Time.from_sec(BEGIN_S + 1.95)
        out.write("/shsa/incidents", incident, BEGIN_S + 2.0)
        incident.returned = rospy.Time.from_sec(BEGIN_S + 3.95)
        out.write("/shsa/incidents", incident, BEGIN_S + 4.0)
        out.floats("/current", ramp(60), publisher)
    recording = read_bag(str(bag(tmp_path)), som_of(amps=CURRENT))
    assert list(only(recording).values) == [*range(20), *range(40, 60)]
    assert told(recording, "20 messages left out: /current while /amperemeter had failed")


def test_names_of_healings_topics_are_those_that_it_uses() -> None:
    assert bags.SUBSTITUTIONS == "/" + names.SUBSTITUTIONS
    assert bags.INCIDENTS == "/" + names.INCIDENTS


def test_two_services_of_a_topic_are_told_apart_by_their_nodes(tmp_path: Path) -> None:
    def joints(name: str, value: float) -> JointState:
        return JointState(name=[name], velocity=[value])

    with BagWriter(bag(tmp_path)) as out:
        for time, value in ramp(10):
            out.write("/joint_states", joints("left", value), time, "/base")
            out.write("/joint_states", joints("left", -value), time + 0.05, "/arm")
            out.write("/joint_states", joints("left", 99.0), time + 0.07, "/third")
    kind = "sensor_msgs/JointState"
    som = som_of(
        base=("/joint_states", kind, "/base", {"wheel": "velocity[name=left]"}),
        arm=("/joint_states", kind, "/arm", {"elbow": "velocity[name=left]"}),
    )
    recording = read_bag(str(bag(tmp_path)), som)
    np.testing.assert_array_equal(recording.only("wheel").values, np.arange(10.0))
    np.testing.assert_array_equal(recording.only("elbow").values, -np.arange(10.0))
    assert told(recording, "10 messages left out: /joint_states by /third")


def test_a_value_that_a_message_does_not_name_is_no_sample(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        for time, value in ramp(10):
            name = "left" if value % 2 else "right"
            out.write("/joint_states", JointState(name=[name], velocity=[value]), time, "/base")
    fields = {"left": "velocity[name=left]", "top": "velocity[name=top]"}
    som = som_of(base=("/joint_states", "sensor_msgs/JointState", "/base", fields))
    recording = read_bag(str(bag(tmp_path)), som)
    assert list(only(recording).values) == [1.0, 3.0, 5.0, 7.0, 9.0]
    assert told(recording, "never names velocity[name=top]")


def test_the_services_own_node_counts_where_a_stranger_publishes_too(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        out.floats("/current", ramp(10), "/amperemeter")
        out.floats("/current", [(time, -5.0) for time, _ in ramp(4)], "/rostopic_pub")
    recording = read_bag(str(bag(tmp_path)), som_of(amps=CURRENT))
    np.testing.assert_array_equal(only(recording).values, np.arange(10.0))
    assert told(recording, "4 messages left out: /current by /rostopic_pub")


def test_a_publisher_of_another_name_stands_for_the_only_service(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        out.floats("/current", ramp(10), "/amperemeter_1234")
    assert len(only(read_bag(str(bag(tmp_path)), som_of(amps=CURRENT)))) == 10


def stamped(tmp_path: Path, samples: Any) -> Recording:
    """Return a recording of values with stamps and times of recording."""
    with BagWriter(bag(tmp_path)) as out:
        for value, stamp, time in samples:
            message = Float64Stamped(data=value)
            message.header.stamp = rospy.Time.from_sec(stamp)
            out.write("/current", message, time, "/amperemeter")
    type_ = "shsa_msgs/Float64Stamped"
    return read_bag(
        str(bag(tmp_path)), som_of(amps=("/current", type_, "/amperemeter", {"current": "data"}))
    )


def test_stamps_out_of_order_are_sorted_and_double_ones_counted_once(tmp_path: Path) -> None:
    stamps = [0.0, 0.2, 0.1, 0.3, 0.3, 0.4]
    samples = [(float(k), BEGIN_S + s, BEGIN_S + 0.1 * k) for k, s in enumerate(stamps)]
    recording = stamped(tmp_path, samples)
    assert list(only(recording).values) == [0.0, 2.0, 1.0, 4.0, 5.0]
    np.testing.assert_allclose(only(recording).time - BEGIN_S, [0.0, 0.1, 0.2, 0.3, 0.4], atol=1e-6)
    assert told(recording, "1 sample out of order") and told(recording, "1 sample with the time")


def test_a_clock_that_is_off_by_a_constant_is_moved(tmp_path: Path) -> None:
    samples = [
        (float(k), 5000.0 + 0.1 * k, t + 0.01 * (k % 3)) for k, (t, _) in enumerate(ramp(60))
    ]
    recording = stamped(tmp_path, samples)
    np.testing.assert_allclose(np.diff(only(recording).time), 0.1, atol=1e-6)
    assert only(recording).begin == pytest.approx(BEGIN_S, abs=0.02)
    assert told(recording, "off by 3999.99 s")


@pytest.mark.parametrize("stamp", [lambda k: 0.0, lambda k: 1.0 + 7.0 * (k % 5)])
def test_stamps_that_say_nothing_do_not_count(tmp_path: Path, stamp: Any) -> None:
    samples = [(float(k), stamp(k), time) for k, (time, _) in enumerate(ramp(30))]
    np.testing.assert_allclose(only(stamped(tmp_path, samples)).time, [t for t, _ in ramp(30)])


def test_a_latched_message_from_before_the_recording_holds_from_its_begin(tmp_path: Path) -> None:
    samples = [(1.0, 3.0, BEGIN_S)] + [(2.0 + k, BEGIN_S + k, BEGIN_S + k) for k in range(1, 40)]
    series = only(stamped(tmp_path, samples))
    assert len(series) == 40 and BEGIN_S - 2.5 < series.begin <= BEGIN_S


def test_what_is_beyond_its_range_is_no_value(tmp_path: Path) -> None:
    provides = {"current": {"field": "data", "range": [-1.0, 3.0]}}
    given = {"topic": "/current", "type": "std_msgs/Float64", "node": "/n", "provides": provides}
    with BagWriter(bag(tmp_path)) as out:
        out.floats("/current", [*ramp(6), (BEGIN_S + 0.6, math.nan)], "/n")
    recording = read_bag(str(bag(tmp_path)), som_of(amps=given))
    np.testing.assert_array_equal(only(recording).values, [0.0, 1.0, 2.0, 3.0] + 3 * [math.nan])
    assert told(recording, "2 values of current beyond its range")


@pytest.mark.parametrize(
    "content, says",
    [
        (b"", "cannot be read as a rosbag"),
        (b"nonsense", "cannot be read as a rosbag"),
        (b"#ROSBAG V2.0\n", "has no index"),
        (b"#ROSBAG V2.0\n" + bytes(4096), "has no index"),
    ],
    ids=["empty", "nonsense", "short", "zeros"],
)
def test_what_is_no_bag_is_refused(tmp_path: Path, content: bytes, says: str) -> None:
    bag(tmp_path).write_bytes(content)
    with pytest.raises(ShsaError, match=f"drive.bag: {says}"):
        read([str(bag(tmp_path))], som_of(amps=CURRENT))


def test_a_bag_that_was_cut_off_is_refused(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        out.floats("/current", ramp(100), "/amperemeter")
    whole = bag(tmp_path).read_bytes()
    for size in (100, 5000, len(whole) // 2, len(whole) - 10):
        bag(tmp_path).write_bytes(whole[:size])
        with pytest.raises(ShsaError, match="drive.bag"):
            read([str(bag(tmp_path))], som_of(amps=CURRENT))


def test_a_bag_needs_a_som(tmp_path: Path) -> None:
    with BagWriter(bag(tmp_path)) as out:
        out.floats("/current", ramp(3), "/amperemeter")
    with pytest.raises(ShsaError, match="drive.bag: is a rosbag: a SOM"):
        read([str(bag(tmp_path))])


FLEET_SOM = som_of(
    v=("/v", "std_msgs/Float64", "/node", {"speed": "data"}),
    w=("/w", "std_msgs/Float64", "/node", {"turn": "data"}),
)


def fleet(folder: Path, bags: int, rows: int) -> List[str]:
    """Write bags of two topics of 10 Hz."""
    paths = [folder / f"drive_{number}.bag" for number in range(bags)]
    for number, path in enumerate(paths):
        with BagWriter(path) as bag:
            for row in range(rows):
                bag.floats("/v", [(BEGIN_S + 0.1 * row, float(number))])
                bag.floats("/w", [(BEGIN_S + 0.1 * row + 0.01, 0.5 * row)])
    return [str(path) for path in paths]


def test_of_a_large_bag_the_same_stretches_of_all_topics_are_kept(tmp_path: Path) -> None:
    (path,) = fleet(tmp_path, 1, 4000)
    read_bytes: List[int] = []
    (recording,) = read([path], FLEET_SOM, step=read_bytes.append, most=1500)
    assert sum(read_bytes) == Path(path).stat().st_size and len(read_bytes) > 5
    speed, turn = recording.series
    assert 1000 <= len(speed) <= 1500 and told(recording, "has 4000 messages: ")
    np.testing.assert_allclose(turn.time, speed.time + 0.01)
    np.testing.assert_allclose(turn.values, 5.0 * (speed.time - BEGIN_S), atol=1e-4)
    (whole,) = read([path], FLEET_SOM, most=4000)
    assert [len(each) for each in whole.series] == [4000, 4000]


def check_fleet(recordings: Sequence[Recording], paths: Sequence[str]) -> None:
    assert [each.name for each in recordings] == paths
    for number, recording in enumerate(recordings):
        assert set(recording.only("speed").values) == {float(number)}
        assert len(recording.only("turn")) == 30


def test_the_bags_of_a_fleet_are_read_side_by_side(tmp_path: Path) -> None:
    paths = fleet(tmp_path, 5, 30)
    read_bytes: List[int] = []
    check_fleet(read(paths, FLEET_SOM, step=read_bytes.append), paths)
    assert sum(read_bytes) == sum(Path(path).stat().st_size for path in paths)
    Path(paths[3]).write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(ShsaError, match="drive_3.bag: has no index"):
        read(paths, FLEET_SOM)


def test_the_workers_of_dask_read_the_bags_of_a_fleet(tmp_path: Path, monkeypatch: Any) -> None:
    distributed = pytest.importorskip("distributed")
    paths = fleet(tmp_path, 5, 30)
    own = {"dashboard_address": None, "local_directory": str(tmp_path)}
    with distributed.LocalCluster(2, threads_per_worker=1, **own) as cluster:
        check_fleet(read(paths, FLEET_SOM, dask=cluster.scheduler_address), paths)
    monkeypatch.setattr("shsa_learning.recordings.fleet.ANSWER_S", 0.5)
    with pytest.raises(ShsaError, match="--dask: no scheduler answers at tcp://127.0.0.1:1"):
        read(paths, FLEET_SOM, dask="tcp://127.0.0.1:1")


def test_files_are_told_apart_by_what_they_hold(tmp_path: Path) -> None:
    named = tmp_path / "drive.data"
    with BagWriter(named) as out:
        out.floats("/current", ramp(3), "/amperemeter")
    table = write_csv(tmp_path / "current.txt", ["time", "current"], [[0, 1]])
    recordings = read([str(named), table], som_of(amps=CURRENT))
    assert [only(each).source for each in recordings] == ["/current/data", table]
    with pytest.raises(ShsaError, match="is given twice"):
        read([table, table])
    with pytest.raises(ShsaError, match="no file is given"):
        read([])
    with pytest.raises(ShsaError, match="No such file"):
        read([str(tmp_path / "nothing.csv")])


def test_a_series_is_what_it_says() -> None:
    for time, values in (
        ([], []),
        ([0.0, 1.0], [1.0]),
        ([0.0, 0.0], [1.0, 2.0]),
        ([math.nan], [1.0]),
    ):
        with pytest.raises(ShsaError, match="v of s: "):
            Series("v", "s", "", np.array(time), np.array(values))
    assert Series("v", "s", "", np.array([3.0]), np.array([1.0])).interval == 0.0
    assert str(Float64(1.0)) == "data: 1.0"
