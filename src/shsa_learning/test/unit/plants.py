"""Recorded data of plants whose law is known, each in one file of many columns."""
from pathlib import Path
from typing import Dict, Tuple

import numpy as np

RATE_HZ = 10.0


def smooth(random: np.random.RandomState, rows: int, width: int) -> np.ndarray:
    """Return noise of deviation 1 that changes within about `width` rows."""
    noise = np.convolve(random.normal(size=rows + 8 * width), np.hanning(width), "same")
    found = noise[4 * width : -4 * width]
    return found / np.std(found)


def octocopter(seconds: float = 120.0, seed: int = 0) -> Dict[str, np.ndarray]:
    """Return a flight: the current follows the cubes of eight motors, behind a filter of 0.2 s.

    Beside that there is what flight logs have: some outliers, and a place that seldom changes.
    """
    random = np.random.RandomState(seed)
    rows = int(seconds * RATE_HZ)
    time = np.arange(rows) / RATE_HZ
    hover, pitch, roll, yaw = (smooth(random, rows, width) for width in (40, 10, 10, 10))
    angles = np.arange(8) * np.pi / 4.0
    motors = 0.55 + 0.07 * hover + 0.05 * np.outer(np.cos(angles), pitch)
    motors += 0.05 * np.outer(np.sin(angles), roll) + 0.03 * np.outer((-1.0) ** np.arange(8), yaw)
    motors = np.clip(motors + 0.01 * random.normal(size=motors.shape), 0.05, 1.0)
    power = np.sum(motors**3, axis=0)
    current = np.copy(power)
    for row in range(1, rows):
        share = 1.0 - np.exp(-1.0 / RATE_HZ / 0.2)
        current[row] = current[row - 1] + (power[row] - current[row - 1]) * share
    current = 2.0 + 25.0 * current
    columns = {"time": time, "current": current + random.normal(0.0, 0.3, rows)}
    columns.update({f"motor_{number}": motor for number, motor in enumerate(motors)})
    columns["voltage"] = 16.5 - 0.02 * current - 0.004 * time + 0.05 * random.normal(size=rows)
    for axis in "xyz":
        columns[f"gyro_{axis}"] = smooth(random, rows, 8) + 0.05 * random.normal(size=rows)
    columns["x"] = np.minimum(time, seconds / 4.0) + 0.001 * random.normal(size=rows)
    columns["yaw"] = np.minimum(time, seconds / 5.0) * 0.02 + 1e-6 * random.normal(size=rows)
    for name in ("motor_3", "gyro_x"):
        columns[name][random.randint(0, rows, rows // 100)] += 400.0
    return columns


def slow_current(seed: int = 0) -> Dict[str, np.ndarray]:
    """Return 75 samples a second apart: the current follows the speed, and nothing else does."""
    random = np.random.RandomState(seed)
    speed = 0.5 + 0.3 * smooth(random, 75, 8)
    turn = smooth(random, 75, 6)
    columns = {"time": np.arange(75.0), "current": 0.4 + 1.1 * speed + 0.3 * np.abs(turn)}
    columns["current"] = columns["current"] + 0.03 * random.normal(size=75)
    columns.update(speed=speed, turn_rate=turn, x=np.cumsum(speed), heading=np.cumsum(turn) / 9.0)
    columns["y"] = np.cumsum(speed * np.sin(columns["heading"]))
    columns["lidar_distance"] = 3.0 + smooth(random, 75, 10)
    return columns


def saved(folder: Path, columns: Dict[str, np.ndarray]) -> Tuple[str, str]:
    """Write the file; return its name, and the list of all that may be an input."""
    path = folder / "drive.csv"
    table = np.column_stack(list(columns.values()))
    np.savetxt(str(path), table, "%.7g", ",", header=",".join(columns), comments="")
    return str(path), ",".join(name for name in columns if name not in ("time", "current"))
