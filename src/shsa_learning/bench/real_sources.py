"""Real recordings that others published: where each is from, and how its file becomes a CSV file.

Those in `bench/recordings` are columns of what pvlib (BSD) ships, measured by NOAA and NREL. The
others stay where they are: who has the files in a folder, as `recordings/SHA256SUMS` has them, can
measure them all. Nothing is fetched here. `real_sources.yaml` is the table.
"""
import csv
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import Any, Callable, Dict, List, Mapping, NamedTuple, Sequence, Tuple

import numpy as np
import yaml  # type: ignore[import]

CUTS = Path(__file__).resolve().parent / "recordings"
TABLE = Path(__file__).with_suffix(".yaml")
Columns = Mapping[str, np.ndarray]


class Source(NamedTuple):
    """A recording, as the table has it. `target` is learned from `inputs`."""

    name: str
    origin: str
    file: str
    target: str
    inputs: Tuple[str, ...] = ()
    cut: str = ""
    kind: str = ""
    base: str = ""
    fields: Mapping[str, str] = {}
    time: Mapping[str, Any] = {}
    delimiter: str = ","

    def columns(self, folder: Path) -> Columns:
        """Return columns of its file in a folder, the first the time in s."""
        return READERS[self.kind](folder / Path(self.file).name, self)


def sources() -> List[Source]:
    """Return those that are measured."""
    found = []
    for row in yaml.safe_load(TABLE.read_text(encoding="utf-8")):
        others = [name for name in row.get("fields", ()) if name != row["target"]]
        row["inputs"] = tuple(row.get("inputs", others))
        found.append(Source(**row))
    return found


def table(
    path: Path,
    time: Callable[[Mapping[str, str], int], float],
    names: Mapping[str, str],
    delimiter: str = ",",
) -> Columns:
    """Return columns of a text file by the names that they get; what is no number is NaN."""
    with open(path, encoding="latin-1", newline="") as file:
        rows = list(csv.DictReader(file, delimiter=delimiter, skipinitialspace=True))
    found = {"time": np.array([time(row, number) for number, row in enumerate(rows)])}
    for name, heading in names.items():
        found[name] = np.array([_number(row[heading]) for row in rows])
    return found


def _number(text: str) -> float:
    try:
        return float(text)
    except (TypeError, ValueError):
        return float("nan")


def cut(path: Path) -> Columns:
    """Return the columns of a file that is as `shsa learn` reads it."""
    with open(path, newline="") as file:
        names = next(csv.reader(file))
    return table(path, lambda row, number: float(row["time"]), {name: name for name in names[1:]})


def ride(path: Path, source: Source) -> Columns:
    """Return the records of a FIT file (by `fitdecode`)."""
    import fitdecode

    rows: List[Dict[str, object]] = []
    with fitdecode.FitReader(str(path), error_handling=fitdecode.ErrorHandling.IGNORE) as file:
        with suppress(fitdecode.FitError):  # a file may be cut off
            for frame in file:
                if isinstance(frame, fitdecode.FitDataMessage) and frame.name == "record":
                    found = {field.name: field.value for field in frame.fields}
                    if isinstance(found.get("timestamp"), datetime):
                        found["time"] = found["timestamp"].timestamp()
                        rows.append(found)
    return _columns(rows, {"time": "time", **source.fields})


def _columns(rows: Sequence[Mapping[str, object]], fields: Mapping[str, str]) -> Columns:
    found = {}
    for name, field in fields.items():
        values = [row.get(field) for row in rows]
        numbers = [float(v) if isinstance(v, (int, float)) else np.nan for v in values]
        found[name] = np.array(numbers)
    found["time"] = found["time"] - found["time"][0]
    return found


def flight(path: Path, source: Source) -> Columns:
    """Return fields of a ULog file (by `pyulog`): `topic.field`, or `topic:1.field`."""
    from pyulog import ULog

    topics = {f"{d.name}:{d.multi_id}": d.data for d in ULog(str(path)).data_list}
    time = topics[f"{source.base}:0"]["timestamp"] / 1e6
    found = {"time": time}
    for name, where in source.fields.items():
        topic, field = where.split(".", 1)
        data = topics[topic if ":" in topic else f"{topic}:0"]
        found[name] = held(data["timestamp"] / 1e6, data[field].astype(float), time)
    return found


def dataflash(path: Path, source: Source) -> Columns:
    """Return fields of a log of ArduPilot (by `pymavlink`)."""
    from pymavlink.DFReader import DFReader_binary

    reader = DFReader_binary(str(path), zero_time_base=True)
    wanted = {source.base, *(where.split(".")[0] for where in source.fields.values())}
    kept: Dict[str, List[Any]] = {name: [] for name in wanted}
    while True:
        message = reader.recv_match(type=list(wanted))
        if message is None:
            break
        kept[message.get_type()].append(message)
    times = {
        kind: np.maximum.accumulate(np.array([each._timestamp for each in found], dtype=float))
        for kind, found in kept.items()
    }
    result = {"time": times[source.base]}
    for name, where in source.fields.items():
        kind, field = where.split(".")
        values = np.array([float(getattr(each, field)) for each in kept[kind]])
        result[name] = held(times[kind], values, times[source.base])
    return result


def bag(path: Path, source: Source) -> Columns:
    """Return fields of a bag: `topic:field`."""
    import rosbag

    series: Dict[str, List[Tuple[float, float]]] = {name: [] for name in source.fields}
    times: List[float] = []
    with rosbag.Bag(str(path)) as file:
        for topic, message, stamp in file.read_messages():
            if topic == source.base:
                times.append(stamp.to_sec())
            for name, where in source.fields.items():
                if where.split(":")[0] == topic:
                    value = message
                    for part in where.split(":")[1].split("."):
                        value = getattr(value, part)
                    series[name].append((stamp.to_sec(), float(value)))
    found = {"time": np.array(times)}
    for name, pairs in series.items():
        when, values = np.array(pairs).T
        found[name] = held(when, values, found["time"])
    return found


def text(path: Path, source: Source) -> Columns:
    """Return columns of a text file. `time`: a `column` of a `form` or `scale`, or a `step`."""
    column, step = source.time.get("column"), float(source.time.get("step", 0.0))
    form, scale = source.time.get("form"), float(source.time.get("scale", 1.0))

    def time(row: Mapping[str, str], number: int) -> float:
        if column is None:
            return step * number
        if form is None:
            return scale * float(row[column])
        return datetime.strptime(row[column], form).timestamp()

    return table(path, time, source.fields, source.delimiter)


READERS = {"ride": ride, "flight": flight, "dataflash": dataflash, "bag": bag, "text": text}


def held(time: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the newest value at each moment; NaN before the first."""
    place = np.searchsorted(time, at, side="right") - 1
    return np.where(place >= 0, values[np.maximum(place, 0)], np.nan)


def write(path: Path, columns: Columns) -> None:
    """Write a CSV file in the order of time; times that repeat are left out."""
    time = columns["time"] - columns["time"][0]
    kept = np.flatnonzero(time > np.maximum.accumulate(np.append(-1.0, time))[:-1])
    with open(path, "w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(["time", *(name for name in columns if name != "time")])
        for row in kept:
            cells = (values[row] for name, values in columns.items() if name != "time")
            writer.writerow(
                [
                    f"{time[row]:.6g}" if time[row] < 1e4 else f"{time[row]:.3f}",
                    *("" if np.isnan(each) else f"{each:.7g}" for each in cells),
                ]
            )
