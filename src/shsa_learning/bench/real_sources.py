"""Real recordings that others published: where each is from, and how its file becomes a CSV file.

Those in `bench/recordings` are columns of what pvlib (BSD) ships, measured by NOAA and NREL. The
others stay where they are: who has the files in a folder, as `recordings/SHA256SUMS` has them, can
measure them all. Nothing is fetched here.
"""
import csv
from contextlib import suppress
from datetime import datetime
from pathlib import Path
from typing import (
    Any,
    Callable,
    Dict,
    Iterable,
    List,
    Mapping,
    NamedTuple,
    Optional,
    Sequence,
    Tuple,
)

import numpy as np

CUTS = Path(__file__).resolve().parent / "recordings"
Columns = Mapping[str, np.ndarray]


class Source(NamedTuple):
    """A recording. `file`: in its `origin`, a repository or a package, as of `sha256`.

    `target` is learned from `inputs`; `convert` makes columns of the file, the first the time in s.
    None: a cut is in the repository.
    """

    name: str
    origin: str
    file: str
    target: str
    inputs: Tuple[str, ...]
    convert: Optional[Callable[[Path], Columns]] = None
    cut: str = ""


def table(
    path: Path,
    time: Callable[[Mapping[str, str], int], float],
    names: Mapping[str, str],
    delimiter: str = ",",
    skip: int = 0,
) -> Columns:
    """Return columns of a text file by the names that they get; what is no number is NaN."""
    with open(path, encoding="latin-1", newline="") as file:
        for _ in range(skip):
            next(file)
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


def ride(names: Sequence[str]) -> Callable[[Path], Columns]:
    """Return what reads the records of a FIT file (by `fitdecode`)."""

    def convert(path: Path) -> Columns:
        import fitdecode

        rows: List[Dict[str, float]] = []
        with fitdecode.FitReader(str(path), error_handling=fitdecode.ErrorHandling.IGNORE) as file:
            with suppress(fitdecode.FitError):  # a file may be cut off
                for frame in file:
                    if isinstance(frame, fitdecode.FitDataMessage) and frame.name == "record":
                        found = {field.name: field.value for field in frame.fields}
                        if isinstance(found.get("timestamp"), datetime):
                            found["time"] = found["timestamp"].timestamp()
                            rows.append(found)
        return _columns(rows, ("time", *names))

    return convert


def _columns(rows: Iterable[Mapping[str, object]], names: Sequence[str]) -> Columns:
    """Return a column a name, which is written in words without spaces."""
    kept = list(rows)
    found = {}
    for name in names:
        values = [row.get(name) for row in kept]
        numbers = [float(v) if isinstance(v, (int, float)) else np.nan for v in values]
        found[name.lower().replace(" ", "_")] = np.array(numbers)
    found["time"] = found["time"] - found["time"][0]
    return found


def flight(fields: Mapping[str, str], base: str) -> Callable[[Path], Columns]:
    """Return what reads a ULog file (by `pyulog`) at the times of a topic, `base`.

    `fields` by name: `topic.field`, or `topic:1.field` of a second instance. Values are held.
    """

    def convert(path: Path) -> Columns:
        from pyulog import ULog

        topics = {f"{d.name}:{d.multi_id}": d.data for d in ULog(str(path)).data_list}
        time = topics[f"{base}:0"]["timestamp"] / 1e6
        found = {"time": time}
        for name, where in fields.items():
            topic, field = where.split(".", 1)
            data = topics[topic if ":" in topic else f"{topic}:0"]
            found[name] = held(data["timestamp"] / 1e6, data[field].astype(float), time)
        return found

    return convert


def dataflash(fields: Mapping[str, str], base: str) -> Callable[[Path], Columns]:
    """Return what reads a log of ArduPilot (by `pymavlink`) at the times of a message, `base`."""

    def convert(path: Path) -> Columns:
        from pymavlink.DFReader import DFReader_binary

        reader = DFReader_binary(str(path), zero_time_base=True)
        wanted = {base, *(where.split(".")[0] for where in fields.values())}
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
        result = {"time": times[base]}
        for name, where in fields.items():
            kind, field = where.split(".")
            values = np.array([float(getattr(each, field)) for each in kept[kind]])
            result[name] = held(times[kind], values, times[base])
        return result

    return convert


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


def bag(fields: Mapping[str, str], base: str) -> Callable[[Path], Columns]:
    """Return what reads a bag at the times of a topic, `base`; `fields` by name: `topic:field`."""

    def convert(path: Path) -> Columns:
        import rosbag

        series: Dict[str, List[Tuple[float, float]]] = {name: [] for name in fields}
        times: List[float] = []
        with rosbag.Bag(str(path)) as file:
            for topic, message, stamp in file.read_messages():
                if topic == base:
                    times.append(stamp.to_sec())
                for name, where in fields.items():
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

    return convert


def _seconds(
    heading: str, form: str, scale: float = 1.0
) -> Callable[[Mapping[str, str], int], float]:
    """Return what reads the time of a row: a date of a form, or a number."""

    def time(row: Mapping[str, str], number: int) -> float:
        text = row[heading]
        return datetime.strptime(text, form).timestamp() if form else scale * float(text)

    return time


def text(
    time: Callable[[Mapping[str, str], int], float], names: str, delimiter: str = ","
) -> Callable[[Path], Columns]:
    """Return what reads columns of a text file: `name=heading; name=heading`."""
    headings = dict(pair.strip().split("=", 1) for pair in names.split(";"))
    return lambda path: table(path, time, headings, delimiter)


PVLIB = "pvlib 0.16.1"
LOCALIZATION, EVO = "cra-ros-pkg/robot_localization", "MichaelGrupp/evo"
FITDECODE, FITPARSE = "polyvertex/fitdecode", "dtcooper/python-fitparse"
CHEETAH, ERLE, SKAB = "GoldenCheetah/GoldenCheetah", "erlerobot/logs", "waico/SKAB"
IMU = {
    f"{name}_{axis}": f"/imu/data:{field}.{axis}"
    for name, field in (("gyro", "angular_velocity"), ("acceleration", "linear_acceleration"))
    for axis in "xyz"
}
RIDING = ("cadence", "speed", "heart_rate", "altitude", "temperature")
MOTORS = {f"motor_{n}": f"RCOU.Ch{n}" for n in (1, 2, 3, 4)}
INERTIAL = {
    **{f"gyro_{axis.lower()}": f"IMU.Gyr{axis}" for axis in "XYZ"},
    **{f"acceleration_{axis.lower()}": f"IMU.Acc{axis}" for axis in "XYZ"},
}


def _ride(name: str, origin: str, file: str, target: str, inputs: str) -> Source:
    """Return a ride or a run with a sports watch: a FIT file."""
    fields = [each.strip() for each in f"{target},{inputs}".split(",")]
    names = [each.lower().replace(" ", "_") for each in fields]
    return Source(name, origin, file, target.lower(), tuple(names[1:]), ride(fields))


FLIGHT = dataflash(
    {
        "current": "CURR.Curr",
        **MOTORS,
        **INERTIAL,
        "voltage": "CURR.Volt",
        "throttle": "CTUN.ThrOut",
        "altitude": "BARO.Alt",
    },
    "CURR",
)
SOURCES: Sequence[Source] = (
    # In the repository: cuts of what packages ship.
    Source(
        "radiation by three instruments, a day",
        PVLIB,
        "tests/data/surfrad-slv16001.dat",
        "global_radiation",
        ("direct", "diffuse", "infrared", "temperature", "humidity", "wind", "cosine_of_zenith"),
        None,
        "surfrad.csv",
    ),
    Source(
        "two pyranometers, a day",
        PVLIB,
        "tests/data/midc_raw_20181018.txt",
        "global_radiation",
        ("global_platform", "direct", "diffuse", "air_temperature", "humidity", "wind"),
        None,
        "radiometers.csv",
    ),
    Source(
        "voltage of a logger's battery",
        PVLIB,
        "tests/data/midc_raw_20181018.txt",
        "battery_voltage",
        ("logger_temperature", "air_temperature", "global_radiation", "humidity"),
        None,
        "radiometers.csv",
    ),
    Source(
        "temperature of a tower",
        PVLIB,
        "tests/data/midc_20181014.txt",
        "temperature_50m",
        ("temperature_2m", "temperature_80m", "radiation"),
        None,
        "tower.csv",
    ),
    # In a folder of who has them.
    Source(
        "Husky: wheels by IMU",
        LOCALIZATION,
        "test/test1.bag",
        "angular_velocity",
        tuple(IMU),
        bag(
            {"angular_velocity": "/husky_velocity_controller/odom:twist.twist.angular.z", **IMU},
            "/husky_velocity_controller/odom",
        ),
    ),
    Source(
        "Husky: speed by IMU",
        LOCALIZATION,
        "test/test1.bag",
        "linear_velocity",
        tuple(IMU),
        bag(
            {"linear_velocity": "/husky_velocity_controller/odom:twist.twist.linear.x", **IMU},
            "/husky_velocity_controller/odom",
        ),
    ),
    Source(
        "Jackal: wheels by IMU",
        LOCALIZATION,
        "test/test2.bag",
        "angular_velocity",
        tuple(IMU),
        bag(
            {"angular_velocity": "/jackal_velocity_controller/odom:twist.twist.angular.z", **IMU},
            "/jackal_velocity_controller/odom",
        ),
    ),
    Source(
        "KITTI: place by SLAM",
        EVO,
        "test/data/ROS_example.bag",
        "x",
        ("slam_x", "slam_y", "slam_z"),
        bag(
            {
                "x": "groundtruth:pose.position.x",
                "slam_x": "ORB-SLAM:pose.position.x",
                "slam_y": "ORB-SLAM:pose.position.y",
                "slam_z": "ORB-SLAM:pose.position.z",
            },
            "groundtruth",
        ),
    ),
    Source(
        "EuRoC V1_02: speed by place",
        EVO,
        "test/data/V102_groundtruth.csv",
        "speed_x",
        ("x", "y", "z"),
        text(
            _seconds("#timestamp", "", 1e-9),
            "speed_x=v_RS_R_x [m s^-1];x=p_RS_R_x [m];y=p_RS_R_y [m];z=p_RS_R_z [m]",
        ),
    ),
    Source(
        "pump: current",
        SKAB,
        "data/anomaly-free/anomaly-free.csv",
        "current",
        (
            "vibration_1",
            "vibration_2",
            "pressure",
            "temperature",
            "thermocouple",
            "voltage",
            "flow",
        ),
        text(
            _seconds("datetime", "%Y-%m-%d %H:%M:%S"),
            "current=Current;vibration_1=Accelerometer1RMS;vibration_2=Accelerometer2RMS;"
            "pressure=Pressure;temperature=Temperature;thermocouple=Thermocouple;"
            "voltage=Voltage;flow=Volume Flow RateRMS",
            ";",
        ),
    ),
    Source(
        "pump, a valve closes: flow",
        SKAB,
        "data/valve1/6.csv",
        "flow",
        (
            "vibration_1",
            "vibration_2",
            "pressure",
            "temperature",
            "thermocouple",
            "voltage",
            "current",
        ),
        text(
            _seconds("datetime", "%Y-%m-%d %H:%M:%S"),
            "flow=Volume Flow RateRMS;vibration_1=Accelerometer1RMS;"
            "vibration_2=Accelerometer2RMS;pressure=Pressure;temperature=Temperature;"
            "thermocouple=Thermocouple;voltage=Voltage;current=Current",
            ";",
        ),
    ),
    Source(
        "hand-held IMU: accelerometer",
        "xioTechnologies/Fusion",
        "Examples/Python/sensor_data.csv",
        "acceleration_x",
        ("gyro_x", "gyro_y", "gyro_z", "magnetic_x", "magnetic_y", "magnetic_z"),
        text(
            _seconds("Time (s)", ""),
            "acceleration_x=Accelerometer X (g);gyro_x=Gyroscope X (deg/s);"
            "gyro_y=Gyroscope Y (deg/s);gyro_z=Gyroscope Z (deg/s);"
            "magnetic_x=Magnetometer X (uT);magnetic_y=Magnetometer Y (uT);"
            "magnetic_z=Magnetometer Z (uT)",
        ),
    ),
    _ride(
        "ride of 4 h: power",
        FITDECODE,
        "tests/files/2019-02-17-062644-ELEMNT-297E-195-0.fit",
        "power",
        "cadence,speed,heart_rate,grade,altitude,temperature",
    ),
    _ride(
        "ride: power",
        FITDECODE,
        "tests/files/Edge810-Vector-2013-08-16-15-35-10.fit",
        "power",
        "cadence,speed,heart_rate,altitude,temperature",
    ),
    _ride(
        "ride: heart rate",
        FITPARSE,
        "tests/files/nick.fit",
        "heart_rate",
        "power,cadence,speed,temperature",
    ),
    _ride(
        "ride: power, with gaps",
        CHEETAH,
        "test/rides/20130717_143733.fit",
        "power",
        "cadence,speed,heart_rate,grade,temperature",
    ),
    _ride(
        "ride: speed by power",
        CHEETAH,
        "test/rides/Karoo-Botley_BW_Swanmore_Wickham-2025-05-09-1238.fit",
        "speed",
        "power,cadence,grade,heart_rate,altitude",
    ),
    _ride(
        "run: power by a foot pod",
        FITDECODE,
        "tests/files/developer-types-sample.fit",
        "power",
        "speed,cadence,heart_rate,vertical_oscillation,stance_time",
    ),
    _ride(
        "run: stance time",
        CHEETAH,
        "test/roundtrip/Fr955v19.28andStryd.fit",
        "stance_time",
        "Ground Time,Cadence,Power,Vertical Oscillation,heart_rate",
    ),
    _ride(
        "rowing: power",
        FITDECODE,
        "tests/files/20170518-191602-1740899583.fit",
        "Power",
        "Stroke Rate,Speed,Heart Rate",
    ),
    _ride(
        "home trainer: power",
        FITDECODE,
        "tests/files/sample-activity-indoor-trainer.fit",
        "power",
        "cadence,heart_rate,temperature",
    ),
    Source(
        "quadcopter: current",
        ERLE,
        "pxf/copter/test/MS5611_SPI.BIN",
        "current",
        (*MOTORS, *INERTIAL, "voltage", "throttle", "altitude"),
        FLIGHT,
    ),
    Source(
        "quadcopter: current, a longer flight",
        ERLE,
        "pxf/copter/PXFv2.0b+Rpi.BIN",
        "current",
        (*MOTORS, *INERTIAL, "voltage", "throttle", "altitude"),
        FLIGHT,
    ),
    Source(
        "quadcopter: acceleration by motors",
        ERLE,
        "pxf/copter/5-12-2014/218.BIN",
        "acceleration_z",
        tuple(MOTORS),
        dataflash({"acceleration_z": "IMU.AccZ", **MOTORS}, "RCOU"),
    ),
    Source(
        "rover: turn rate by commands",
        ERLE,
        "pxf/rover/25-8-2014/61.BIN",
        "gyro_z",
        ("steering", "throttle", "acceleration_y"),
        dataflash(
            {
                "gyro_z": "IMU.GyrZ",
                "acceleration_y": "IMU.AccY",
                "steering": "RCOU.Ch1",
                "throttle": "RCOU.Ch3",
            },
            "RCOU",
        ),
    ),
    Source(
        "plane: climb by attitude",
        ERLE,
        "pxf/plane/5-12-2014/05_12_2014_E.BIN",
        "climb",
        ("pitch", "roll", "speed", "gyro_y", "acceleration_z"),
        dataflash(
            {
                "climb": "GPS.VZ",
                "speed": "GPS.Spd",
                "pitch": "ATT.Pitch",
                "roll": "ATT.Roll",
                "gyro_y": "IMU.GyrY",
                "acceleration_z": "IMU.AccZ",
            },
            "ATT",
        ),
    ),
    Source(
        "quadcopter: turn rate by controls",
        "PX4/pyulog",
        "test/sample.ulg",
        "roll_rate",
        (
            "roll_control",
            "pitch_control",
            "yaw_control",
            "acceleration_x",
            "acceleration_y",
            "acceleration_z",
        ),
        flight(
            {
                "roll_rate": "vehicle_attitude.rollspeed",
                **{
                    f"{n}_control": f"actuator_controls_0.control[{i}]"
                    for i, n in enumerate(("roll", "pitch", "yaw"))
                },
                **{
                    f"acceleration_{a}": f"sensor_combined.accelerometer_m_s2[{i}]"
                    for i, a in enumerate("xyz")
                },
            },
            "actuator_controls_0",
        ),
    ),
    Source(
        "transformer: oil temperature, two years",
        "zhouhaoyi/ETDataset",
        "ETT-small/ETTh1.csv",
        "oil",
        (
            "high_useful",
            "high_useless",
            "middle_useful",
            "middle_useless",
            "low_useful",
            "low_useless",
        ),
        text(
            _seconds("date", "%Y-%m-%d %H:%M:%S"),
            "oil=OT;high_useful=HUFL;high_useless=HULL;middle_useful=MUFL;"
            "middle_useless=MULL;low_useful=LUFL;low_useless=LULL",
        ),
    ),
    Source(
        "house: temperature of a room",
        "LuisM78/Appliances-energy-prediction-data",
        "testing.csv",
        "t2",
        ("t1", "t3", "t4", "t5", "t6", "outside"),
        text(
            _seconds("date", "%Y-%m-%d %H:%M:%S"),
            "t2=T2;t1=T1;t3=T3;t4=T4;t5=T5;t6=T6;outside=T_out",
        ),
    ),
    Source(
        "Crazyflie: battery by place",
        "RaresCraciun/Crazyflie-2.0-battery-data",
        "Real_path/Real_path_47.csv",
        "voltage",
        ("x", "y", "z"),
        text(
            lambda row, number: 0.01 * number,
            "voltage=battery_voltage;x=x_estimate;y=y_estimate;z=z_estimate",
        ),
    ),
)
"""Those that are measured."""
