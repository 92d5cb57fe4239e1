"""Backtests on a robot of which the truth is known."""
import json
from pathlib import Path
from typing import Any, Dict, List, Tuple

import numpy as np
import pytest
from scipy import stats
from std_msgs.msg import Float64

from recordings import BEGIN_S, BagWriter, write_csv
from shsa_core.cli.main import main

ONTOLOGY = """
properties:
  speed: {unit: m/s}
  half: {unit: m/s}
  path: {unit: m}
  door: {unit: ""}
constants:
  two: {value: 2.0, unit: ""}
relations:
  double:
    speed: {function: two * half, error: {rms: 0.4, p95: 0.8}, quality: 0.9}
  guarded:
    speed: {function: 2 * half, constraint: half > 0, quality: 0.8, error: 0.4}
  slope:
    speed: {function: derivative(path), quality: 0.95, error: 0.01}
  sum:
    path: {function: integral(speed), quality: 0.5}
  unknown:
    speed: {not_executable: a law that nobody knows, inputs: [half], quality: 0.7}
"""


def som_text(services: Dict[str, Tuple[str, float]], needed: str = "speed") -> str:
    """Return a SOM of services: the property and the period of each."""
    lines = ["services:"]
    for name, (prop, period) in services.items():
        lines.append(
            f"  {name}: {{topic: /{name}, type: std_msgs/Float64, node: /{name}_node, "
            f"period: {period}, needed: {str(name == needed).lower()}, "
            f"provides: {{{prop}: {{field: data}}}}}}"
        )
    return "\n".join(lines) + "\n"


SERVICES = {
    "speed": ("speed", 0.05),
    "twin": ("speed", 0.1),
    "half": ("half", 0.05),
    "path": ("path", 0.05),
}


class Drive:
    """A drive whose speed is known at any time, and what its sensors say of it."""

    def __init__(self, folder: Path, seconds: float = 200.0, seed: int = 0) -> None:
        self.folder = folder
        self.seconds = seconds
        self.random = np.random.RandomState(seed)
        (folder / "o.yaml").write_text(ONTOLOGY)
        (folder / "s.yaml").write_text(som_text(SERVICES))
        self.files: Dict[str, str] = {}

    def speed(self, time: np.ndarray) -> np.ndarray:
        found: np.ndarray = np.sin(0.9 * time) + 0.5 * np.sin(2.3 * time + 1.0)
        return found

    def path(self, time: np.ndarray) -> np.ndarray:
        found: np.ndarray = -np.cos(0.9 * time) / 0.9 - 0.5 * np.cos(2.3 * time + 1.0) / 2.3
        return found

    def time(self, period: float, begin: float = 0.0) -> np.ndarray:
        return np.arange(begin, self.seconds, period)

    def write(self, name: str, prop: str, time: np.ndarray, values: np.ndarray) -> None:
        """Write a source's file."""
        rows = np.stack([time, values], axis=1).tolist()
        self.files[name] = write_csv(self.folder / f"{name}.csv", ["time", prop], rows)

    def noise(self, time: np.ndarray, rms: float) -> np.ndarray:
        found: np.ndarray = rms * self.random.randn(len(time))
        return found

    def measure(self, rms: float = 0.3, bias: float = 0.0, late: float = 0.0) -> None:
        """Half the speed, with an error in what is derived from it; and the speed as it is."""
        time = self.time(0.05)
        self.write("speed", "speed", time, self.speed(time))
        half = 0.5 * (self.speed(time - late) + self.noise(time, rms) + bias)
        self.write("half", "half", time, half)

    def run(self, *more: str) -> int:
        models = ["--ontology", str(self.folder / "o.yaml"), "--som", str(self.folder / "s.yaml")]
        return main(["backtest", *more, *models, "--data", *self.files.values()])

    def answer(self, capsys: Any, *more: str, status: int = 0) -> Dict[str, Any]:
        """Return the document of --json."""
        assert self.run("--json", *more) == status
        found: Dict[str, Any] = json.loads(capsys.readouterr().out)
        return found


@pytest.fixture
def drive(tmp_path: Path) -> Drive:
    return Drive(tmp_path)


def by(answer: Dict[str, Any], *relations: str, place: int = 0) -> Dict[str, Any]:
    """Return the derivation by some relations."""
    derivations: List[Dict[str, Any]] = answer["properties"][place]["derivations"]
    return next(each for each in derivations if each["relations"] == list(relations))


def test_the_injected_error_is_found(drive: Drive, capsys: Any) -> None:
    drive.measure(rms=0.3, bias=0.2)
    answer = drive.answer(capsys, "speed")
    real = by(answer, "double")["real"]
    assert real["rms"] == pytest.approx(np.hypot(0.3, 0.2), rel=0.05)
    assert real["bias"] == pytest.approx(0.2, rel=0.05)
    inside = np.abs(0.2 + 0.3 * np.random.RandomState(1).randn(1_000_000))
    assert real["p95"] == pytest.approx(np.quantile(inside, 0.95), rel=0.05)
    assert real["n"] == 4000 and by(answer, "double")["share"] == 1.0
    assert real["delay"] == pytest.approx(0.0, abs=0.05)
    speed = drive.speed(drive.time(0.05))
    assert real["baseline"] == pytest.approx(np.std(speed), rel=1e-6)
    assert real["nrmse"] == pytest.approx(real["rms"] / np.ptp(speed), rel=1e-6)


@pytest.mark.parametrize("late", [0.0, 0.15, 0.65, -0.2])
def test_the_injected_delay_is_found_within_a_sample(
    drive: Drive, capsys: Any, late: float
) -> None:
    drive.measure(rms=0.05, late=late)
    real = by(drive.answer(capsys, "speed"), "double")["real"]
    assert real["delay"] == pytest.approx(late, abs=0.0501)
    assert real["delay_resolution"] == pytest.approx(0.05, rel=1e-6)


def test_what_follows_nothing_has_no_delay(drive: Drive, capsys: Any) -> None:
    time = drive.time(0.05)
    drive.write("speed", "speed", time, drive.speed(time))
    drive.write("half", "half", time, drive.noise(time, 1.0))
    real = by(drive.answer(capsys, "speed"), "double")["real"]
    assert real["delay"] is None and real["delay_resolution"] is None


def test_predicted_and_real_errors_stand_side_by_side(drive: Drive, capsys: Any) -> None:
    drive.measure(rms=0.3)
    answer = drive.answer(capsys, "speed")
    double = by(answer, "double")
    assert double["predicted"]["rms"] == pytest.approx(0.4)
    assert double["covered"] == pytest.approx(0.992, abs=0.006)  # 0.8 is 2.67 sigma


def test_no_output_is_counted_and_not_compared(drive: Drive, capsys: Any) -> None:
    drive.measure(rms=0.05)
    answer = drive.answer(capsys, "speed")
    time = drive.time(0.05)
    share = by(answer, "guarded")["share"]
    assert share == pytest.approx(np.mean(drive.speed(time) > 0.0), abs=0.03)
    assert by(answer, "guarded")["real"]["n"] == round(share * len(time))


def test_the_best_is_told_and_what_would_have_been_chosen(drive: Drive, capsys: Any) -> None:
    """The slope of a rough path promises most, and keeps least."""
    drive.measure(rms=0.1)
    time = drive.time(0.05)
    drive.write("path", "path", time, drive.path(time) + drive.noise(time, 0.2))
    (tested,) = drive.answer(capsys, "speed")["properties"]
    ranked = [each["relations"] for each in tested["derivations"]]
    assert ranked[0] == ["double"] and tested["best"] == 0
    assert tested["derivations"][tested["chosen"]]["relations"] == ["slope"]
    assert tested["derivations"][tested["chosen"]]["place"] == 0
    errors = [each["real"]["charged"] for each in tested["derivations"]]
    assert errors == sorted(errors)
    assert drive.run("speed") == 0
    text = capsys.readouterr().out
    assert "Healing would choose slope, which errs 5" in text
    assert "It should choose double, which errs 0.09" in text
    assert "Not executable: unknown" in text


def test_what_seldom_has_a_value_is_ranked_behind_what_has_one(drive: Drive, capsys: Any) -> None:
    time = drive.time(0.05)
    drive.write("speed", "speed", time, drive.speed(time))
    wrong = np.where(drive.speed(time) > 0.0, 0.0, -0.15)
    drive.write("half", "half", time, 0.5 * (drive.speed(time) + wrong))
    answer = drive.answer(capsys, "speed")
    assert by(answer, "guarded")["real"]["rms"] < 1e-9 < by(answer, "double")["real"]["rms"]
    assert answer["properties"][0]["derivations"][0]["relations"] == ["double"]


def test_the_rank_correlation_tells_whether_a_prediction_ranks(drive: Drive, capsys: Any) -> None:
    drive.measure(rms=0.3)
    time = drive.time(0.05)
    drive.write("path", "path", time, drive.path(time) + drive.noise(time, 0.2))
    twin = drive.time(0.1)
    drive.write("twin", "speed", twin, drive.speed(twin))
    (tested,) = drive.answer(capsys, "speed")["properties"]
    ranks = tested["rank_correlation"]
    pairs = [
        (d["predicted"]["rms"], d["real"]["rms"]) for d in tested["derivations"] if d["predicted"]
    ]
    assert len(pairs) == 3
    assert ranks["predicted"] == pytest.approx(stats.spearmanr(*zip(*pairs))[0])
    assert ranks["predicted"] < 0.0  # the slope is predicted best, and is worst
    assert -1.0 <= ranks["quality"] <= 1.0


def test_another_service_of_the_property_is_a_derivation(drive: Drive, capsys: Any) -> None:
    drive.measure()
    time = drive.time(0.1)
    drive.write("twin", "speed", time, drive.speed(time) + 0.25)
    answer = drive.answer(capsys, "speed")
    passed = by(answer)
    assert passed["inputs"] == ["/twin/data"]
    assert passed["real"]["bias"] == pytest.approx(0.25, abs=0.01)


def test_the_lost_service_and_what_is_computed_from_it_are_not_used(
    drive: Drive, capsys: Any
) -> None:
    drive.measure()
    time = drive.time(0.05)
    drive.write("path", "path", time, drive.path(time))
    text = (drive.folder / "s.yaml").read_text().splitlines()
    derived = [
        line[:-1] + ", derived_from: [/speed]}" if "  path:" in line else line for line in text
    ]
    (drive.folder / "s.yaml").write_text("\n".join(derived))
    answer = drive.answer(capsys, "speed")
    assert [each["relations"] for each in answer["properties"][0]["derivations"]] == [
        ["double"],
        ["guarded"],
    ]


def test_stale_inputs_give_no_output(drive: Drive, capsys: Any) -> None:
    """No past value is held beyond its deadline, 0.25 s here."""
    time = drive.time(0.05)
    drive.write("speed", "speed", time, drive.speed(time))
    there = (time < 50.0) | (time > 100.0)
    drive.write("half", "half", time[there], 0.5 * drive.speed(time[there]))
    double = by(drive.answer(capsys, "speed"), "double")
    assert double["share"] == pytest.approx(1.0 - 49.75 / 200.0, abs=0.001)
    assert double["real"]["rms"] < 0.15


def test_only_the_past_of_a_slow_input_counts(drive: Drive, capsys: Any) -> None:
    time, slow = drive.time(0.05), drive.time(0.2, begin=0.013)
    drive.write("speed", "speed", time, drive.speed(time))
    drive.write("half", "half", slow, 0.5 * drive.speed(slow))
    real = by(drive.answer(capsys, "speed"), "double")["real"]
    place = np.searchsorted(slow, time + 1e-9) - 1
    there = place >= 0
    wrong = drive.speed(slow[place[there]]) - drive.speed(time[there])
    assert real["rms"] == pytest.approx(np.sqrt(np.mean(wrong**2)), rel=1e-6)
    assert 0.05 <= real["delay"] <= 0.15  # half of a slow period, in the mean


def test_the_worst_minute_is_found(drive: Drive, capsys: Any) -> None:
    time = drive.time(0.05)
    drive.write("speed", "speed", time, drive.speed(time))
    wrong = np.where((time >= 90.0) & (time < 150.0), 1.0, 0.1)
    drive.write("half", "half", time, 0.5 * (drive.speed(time) + wrong))
    worst = by(drive.answer(capsys, "speed"), "double")["worst_minute"]
    assert worst["rms"] == pytest.approx(1.0, rel=1e-3)
    assert worst["begin"] == pytest.approx(90.0)


def test_an_integral_begins_where_the_target_was(drive: Drive, capsys: Any) -> None:
    time = drive.time(0.05)
    drive.write("path", "path", time, 100.0 + drive.path(time))
    drive.write("twin", "speed", time, drive.speed(time))
    real = by(drive.answer(capsys, "path"), "sum")["real"]
    assert real["rms"] < 0.05


def test_several_recordings_count_together(tmp_path: Path, capsys: Any) -> None:
    files: List[str] = []
    for seed, (name, rms) in enumerate((("monday", 0.1), ("friday", 0.5))):
        (tmp_path / name).mkdir()
        day = Drive(tmp_path / name, seed=seed)
        day.measure(rms=rms)
        files += day.files.values()
    day.files = {path: path for path in files}
    real = by(day.answer(capsys, "speed"), "double")["real"]
    assert real["n"] == 8000
    assert real["rms"] == pytest.approx(np.sqrt((0.1**2 + 0.5**2) / 2.0), rel=0.05)


def test_all_is_every_property_that_was_measured(drive: Drive, capsys: Any) -> None:
    drive.measure()
    for words in ((), ("--all",)):
        answer = drive.answer(capsys, *words)
        assert [each["property"] for each in answer["properties"]] == ["speed", "half"]
    assert answer["properties"][1]["derivations"] == []
    assert answer["properties"][1]["best"] is None
    assert any("not recorded, so that nothing is derived" in note for note in answer["notes"])
    assert "/path/data" in answer["notes"][-1]


def test_a_limit_is_kept_and_told(drive: Drive, capsys: Any) -> None:
    drive.measure()
    (tested,) = drive.answer(capsys, "speed", "--limit", "1")["properties"]
    assert len(tested["derivations"]) == 1 and tested["complete"] is False
    assert drive.run("speed", "--limit", "1") == 0
    assert "There are more derivations than were tried" in capsys.readouterr().out
    (tested,) = drive.answer(capsys, "speed")["properties"]
    assert tested["complete"] is True


def test_with_nothing_to_try_the_answer_is_no(drive: Drive, capsys: Any) -> None:
    time = drive.time(0.05)
    drive.write("speed", "speed", time, drive.speed(time))
    assert drive.answer(capsys, "speed", status=1)["properties"][0]["derivations"] == []
    answer = drive.answer(capsys, "half", status=1)
    assert answer["properties"] == []
    assert "half was not measured in the data, so nothing can be compared" in answer["notes"]


@pytest.mark.parametrize(
    "words, says",
    [
        (["spede"], "did you mean speed"),
        (["speed", "--plot", "picture.txt"], "picture.txt does not end in .png"),
    ],
)
def test_a_wrong_call_is_told(drive: Drive, capsys: Any, words: List[str], says: str) -> None:
    drive.measure()
    assert drive.run(*words) == 2
    assert says in capsys.readouterr().err


def test_a_wrong_file_is_told_with_its_line(drive: Drive, capsys: Any) -> None:
    drive.measure()
    (drive.folder / "half.csv").write_text("time,half\n0.0,1.0\n0.1,one\n")
    assert drive.run("speed") == 2
    assert "half.csv:3: half must be a number or empty, not 'one'" in capsys.readouterr().err


def test_an_error_without_bounds_is_no_number(drive: Drive, capsys: Any) -> None:
    time = drive.time(0.05)
    drive.write("speed", "speed", time, drive.speed(time))
    drive.write("half", "half", time, np.full(len(time), 8e307))
    assert by(drive.answer(capsys, "speed"), "double")["real"]["rms"] is None


def test_a_picture_is_drawn(drive: Drive, capsys: Any) -> None:
    drive.measure()
    time = drive.time(0.05)
    drive.write("path", "path", time, drive.path(time) + drive.noise(time, 0.2))
    picture = drive.folder / "picture.png"
    assert drive.run("--plot", str(picture)) == 0
    assert picture.read_bytes().startswith(b"\x89PNG") and picture.stat().st_size > 10_000


def test_a_bag_that_was_healed_half_way_is_compared_with_the_sensor_alone(
    drive: Drive, capsys: Any
) -> None:
    """Else the values of the substitute would agree with themselves, and hide the error."""
    path = drive.folder / "drive.bag"
    time = np.arange(0.0, 40.0, 0.05)
    half = 0.5 * (drive.speed(time) + 0.3)
    with BagWriter(path) as out:
        for now, speed, value in zip(time.tolist(), drive.speed(time).tolist(), half.tolist()):
            out.write("/half", Float64(value), BEGIN_S + now, "/half_node")
            if now < 20.0:
                out.write("/speed", Float64(speed), BEGIN_S + now + 0.001, "/speed_node")
            else:
                publisher = "/substitute_speed_1"
                out.write("/speed", Float64(2.0 * value), BEGIN_S + now + 0.001, publisher)
    drive.files = {"bag": str(path)}
    answer = drive.answer(capsys, "speed")
    real = by(answer, "double")["real"]
    assert (real["n"], real["rms"]) == (400, pytest.approx(0.3, rel=0.05))
    assert any("400 messages left out: /speed by the substitute" in n for n in answer["notes"])
