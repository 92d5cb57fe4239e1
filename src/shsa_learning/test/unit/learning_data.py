"""Recorded data for tests of learning: signals of a vehicle that nobody has, as CSV files."""
import csv
from pathlib import Path
from typing import Callable, Dict, List, Sequence

import numpy as np

RATE_HZ = 100.0  # of the world; sensors are slower


class World:
    """Smooth random signals of a drive: `u`, `v`, `w`, each about 1 in size, at RATE_HZ."""

    def __init__(self, seed: int, seconds: float = 120.0) -> None:
        self.random = np.random.RandomState(seed)
        self.time = np.arange(int(seconds * RATE_HZ)) / RATE_HZ
        self.signals = {name: self._smooth() for name in "uvw"}

    def __getitem__(self, name: str) -> np.ndarray:
        return self.signals[name]

    def _smooth(self) -> np.ndarray:
        noise = self.random.normal(size=len(self.time) + 400)
        window = np.hanning(200)
        smooth = np.convolve(noise, window, "same")[200:-200]
        return smooth / np.std(smooth)

    def sensor(
        self,
        values: np.ndarray,
        noise: float = 0.02,
        rate: float = 20.0,
        gaps: Sequence[float] = (),
        delay: float = 0.0,
    ) -> Dict[float, float]:
        """Sample with noise and jitter, late by `delay` s, silent for 2 s from `gaps`."""
        step = RATE_HZ / rate
        begin = self.random.uniform(0.0, step)
        places = np.arange(begin, len(values) - 1, step)
        places = np.clip(places + self.random.uniform(-0.2, 0.2, len(places)) * step, 0, None)
        rows = places.astype(int)
        said = values[rows] + self.random.normal(0.0, noise, len(rows))
        times = self.time[rows] + delay
        kept = np.ones(len(times), dtype=bool)
        for gap in gaps:
            kept &= (times < gap) | (times > gap + 2.0)
        return dict(zip(times[kept].tolist(), said[kept].tolist()))


def save(folder: Path, **series: Dict[float, float]) -> List[str]:
    """Write each series as a CSV file, a source of its own."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for name, samples in series.items():
        path = folder / f"{name}.csv"
        with open(str(path), "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["time", name])
            writer.writerows(samples.items())
        paths.append(str(path))
    return paths


def recorded(
    folder: Path,
    law: Callable[[World], np.ndarray],
    seed: int = 0,
    seconds: float = 120.0,
    names: str = "uv",
) -> List[str]:
    """Make a drive in which `y` follows a law: three sensors that differ, and have gaps."""
    world = World(seed, seconds)
    series = {"y": world.sensor(law(world), rate=10.0, gaps=(30.0,))}
    for number, name in enumerate(names):
        series[name] = world.sensor(world[name], rate=(50.0, 25.0, 40.0)[number], gaps=(50.0,))
    return save(folder, **series)
