"""Recorded data in CSV files: columns, times, and the services that they are of."""
import math
from pathlib import Path
from typing import Any, List, Tuple

import numpy as np
import pytest

from recordings import CURRENT, SPEED, only, som_of, told, write_csv
from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.som import Som
from shsa_learning.recordings import csv_files
from shsa_learning.recordings.csv_files import read_csv
from shsa_learning.recordings.data import read
from shsa_learning.recordings.recording import Recording

GPS = ("/gps", "std_msgs/Float64", "/gps", {"speed": "data"})
IMU = ("/imu", "sensor_msgs/Imu", "/imu", {"turn": "angular_velocity.z", "speed": "x"})


def test_csv_columns_are_properties_and_empty_cells_no_samples(tmp_path: Path) -> None:
    path = tmp_path / "wheels.csv"
    path.write_text("\ufefftime, speed ,turn_rate\r\n0,1.5,\r\n0.1,2.5,nan\r\n\r\n0.2,,-1e-3\r\n")
    (speed, turn), notes = read_csv(str(path))
    assert (speed.property, speed.source, speed.node) == ("speed", str(path), "")
    np.testing.assert_array_equal(speed.time, [0.0, 0.1])
    np.testing.assert_array_equal(turn.values, [math.nan, -0.001])
    assert not notes


@pytest.mark.parametrize(
    "text, line, says",
    [
        ("", "", "holds no samples"),
        ("time,speed\n", "", "holds no samples"),
        ("t,speed\n0,1\n", ":1", "the first column must be time .s., not 't'"),
        ("time\n0\n", ":1", "there is no column beside the time"),
        ("time,wheel speed\n0,1\n", ":1", "'wheel speed' cannot be a property"),
        ("time,v,v\n0,1,1\n", ":1", "the column v stands here a second time"),
        ("time,v\n0,1\n1,2,3\n", ":3", "3 cells, but there are 2 columns"),
        ("time,v\n0,1\n1;2\n", ":3", "1 cells"),
        ("time,v\n0,1\n1,fast\n", ":3", "v must be a number or empty, not 'fast'"),
        ("time,v\n0,1\n,2\n", ":3", "time must be a finite number"),
        ("time,v\n0,1\nnan,2\n", ":3", "time must be a finite number"),
        ("time,v\n0,1\n9,2\n\n3,2\n", ":5", "the time goes back from 9 to 3 s"),
        ("time,v\n9,1\n8.4,2\n7.8,2\n", ":4", "the time goes back from 9 to 7.8 s"),
        ('time,v\n0,"1\n', ":2", "is not valid CSV"),
        ("time,v\n0,\n", "", "holds no value of v"),
        ("time,v\n0,\x00\n", ":2", "holds a zero byte"),
    ],
)
def test_a_wrong_csv_file_is_refused_with_its_line(
    tmp_path: Path, text: str, line: str, says: str
) -> None:
    path = tmp_path / "v.csv"
    path.write_text(text)
    with pytest.raises(ShsaError, match=f"v.csv{line}: {says}"):
        read([str(path)])


def test_csv_times_out_of_order_are_sorted(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "v.csv", ["time", "v"], [[0, 0], [0.2, 2], [0.1, 1], [0.2, 3]])
    (recording,) = read([path])
    assert list(only(recording).values) == [0.0, 1.0, 3.0]
    assert told(recording, "out of order") and told(recording, "the time of another")


def test_of_a_large_file_stretches_of_all_kinds_are_kept(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(csv_files, "CHUNK_BYTES", 5000)
    time = np.arange(20000) * 0.1
    fast = (time > 900.0) & (time < 990.0)  # hardly ever
    speed = np.where(fast, 5.0, np.sin(time / 50.0) * 0.1)
    path = tmp_path / "drive.csv"
    np.savetxt(str(path), np.column_stack([time, speed]), "%.6g", ",", header="time,v", comments="")
    read_bytes: List[int] = []
    (series,), notes = read_csv(str(path), True, read_bytes.append, 2000)
    assert sum(read_bytes) == path.stat().st_size
    assert len(series) <= 2000 and "of 20000 rows are kept" in notes[0]
    assert np.mean(series.values > 4.0) > 2.0 * np.mean(fast)
    steps = np.diff(series.time)
    assert np.mean(np.abs(steps - 0.1) < 1e-6) > 0.98  # neighbours stay together
    again, _ = read_csv(str(path), most=2000)
    np.testing.assert_array_equal(again[0].time, series.time)


def test_of_large_files_of_one_drive_the_same_stretches_are_kept(tmp_path: Path) -> None:
    time = np.arange(10000) * 0.1
    kept = []
    for name, values in (("v", np.sin(time)), ("w", np.where(time > 300.0, 7.0, 0.0))):
        path = tmp_path / f"{name}.csv"
        table = np.column_stack([time, values])
        np.savetxt(str(path), table, "%.6g", ",", header=f"time,{name}", comments="")
        (series,), _ = read_csv(str(path), False, most=2000)
        kept.append(series.time)
    np.testing.assert_array_equal(kept[0], kept[1])


@pytest.mark.parametrize("size", [30, 64, 10_000])
def test_chunks_make_no_difference(tmp_path: Path, monkeypatch: Any, size: int) -> None:
    monkeypatch.setattr(csv_files, "CHUNK_BYTES", size)
    path = tmp_path / "v.csv"
    path.write_bytes(b"\n time , v,w\r\n0,1,\r\n\n0.5,nan,-2e1\n1,,3\n1.5, 4,5\n2,6,7")
    (v, w), _ = read_csv(str(path))
    np.testing.assert_array_equal(v.time, [0.0, 0.5, 1.5, 2.0])
    np.testing.assert_array_equal(v.values, [1.0, np.nan, 4.0, 6.0])
    np.testing.assert_array_equal(w.values, [-20.0, 3.0, 5.0, 7.0])
    for line, what in (("3,1", "2 cells, but"), ("3,x,1", "v must be"), ("0.2,1,1", "goes back")):
        path.write_text("time,v,w\n" + "1,1,1\n2,2,2\n" * 1 + line + "\n4,4,4\n")
        with pytest.raises(ShsaError, match=f"v.csv:4: .*{what}"):
            read_csv(str(path))


def test_a_folder_stands_for_the_recordings_in_it(tmp_path: Path) -> None:
    write_csv(tmp_path / "v.csv", ["time", "v"], [[0, 1], [1, 2]])
    write_csv(tmp_path / "w.csv", ["time", "w"], [[0, 1], [1, 2]])
    (tmp_path / "notes.txt").write_text("no recording")
    (recording,) = read([str(tmp_path)])
    assert recording.properties == ("v", "w")
    (tmp_path / "empty").mkdir()
    with pytest.raises(ShsaError, match="is a folder without any .bag or .csv file"):
        read([str(tmp_path / "empty")])


def test_csv_files_are_sources_of_one_recording(tmp_path: Path) -> None:
    paths = [
        write_csv(tmp_path / "a" / "wheels.csv", ["time", "v"], [[0, 1], [1, 2]]),
        write_csv(tmp_path / "b" / "imu.csv", ["time", "a"], [[0.5, 1], [2, 2]]),
    ]
    (recording,) = read(paths)
    assert [series.source for series in recording.series] == paths
    assert (recording.begin, recording.end) == (0.0, 2.0)


def test_csv_files_of_one_name_are_recordings_by_their_folders(tmp_path: Path) -> None:
    paths = [
        write_csv(tmp_path / drive / name, ["time", name[0]], [[0, 1], [1, 2]])
        for drive in ("monday", "friday")
        for name in ("v.csv", "a.csv")
    ]
    monday, friday = read(paths)
    assert [series.source for series in friday.series] == paths[2:]
    assert (monday.name, friday.name) == (str(tmp_path / "monday"), str(tmp_path / "friday"))


def test_csv_files_that_do_not_overlap_are_recordings_apart(tmp_path: Path) -> None:
    late = write_csv(tmp_path / "late.csv", ["time", "v"], [[1e6, 1], [1e6 + 1, 2]])
    early = write_csv(tmp_path / "early.csv", ["time", "a"], [[0, 1], [1, 2]])
    first, second = read([late, early])
    assert (first.properties, second.properties) == (("a",), ("v",))
    assert told(second, "is a recording apart: no overlap in time")


def services(tmp_path: Path, som: Som, **columns: str) -> Tuple[List[str], Recording]:
    """Return the services that are found for the columns of files."""
    paths = [
        write_csv(
            tmp_path / f"{name}.csv", ["time", *text.split()], [[0.0] * (1 + len(text.split()))]
        )
        for name, text in columns.items()
    ]
    (recording,) = read(paths, som)
    return [series.service for series in recording.series], recording


def test_a_csv_file_is_of_the_service_that_it_is_named_after(tmp_path: Path) -> None:
    som = som_of(odom=SPEED, gps=GPS, amps=CURRENT)
    found, recording = services(tmp_path, som, gps="speed current")
    assert found == ["gps", "amps"] and recording.series[1].node == "/amperemeter"
    assert not recording.notes


def test_a_csv_file_is_of_the_only_service_that_provides_its_columns(tmp_path: Path) -> None:
    som = som_of(odom=SPEED, imu=IMU)
    assert services(tmp_path, som, x="turn speed")[0] == ["imu", "imu"]


def test_where_several_services_could_be_meant_the_first_that_is_free_counts(
    tmp_path: Path,
) -> None:
    som = som_of(odom=SPEED, gps=GPS, imu=IMU)
    found, recording = services(tmp_path, som, a="speed", odom="speed", b="speed", c="speed")
    assert found == ["gps", "odom", "imu", ""]
    assert told(recording, "speed is taken for that of gps; name the file after odom, gps, imu")
    assert told(recording, "c.csv: speed is of none of odom, gps, imu")
    found, recording = services(tmp_path, som, odom="speed unheard_of")
    assert found == ["odom", ""]
    assert told(recording, "unheard_of is provided by no service of the SOM")


def test_a_column_that_is_no_property_is_told(tmp_path: Path) -> None:
    path = write_csv(tmp_path / "v.csv", ["time", "spede", "speed"], [[0, 1, 2], [1, 2, 3]])
    ontology = Ontology({"speed": Property("speed")}, {}, ())
    (recording,) = read([path], None, ontology)
    assert recording.notes == (
        f"{path}: spede is no property of the ontology; did you mean speed?",
    )
    assert recording.properties == ("spede", "speed")
