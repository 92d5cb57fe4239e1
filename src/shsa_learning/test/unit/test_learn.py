"""`shsa learn`: relations that are found again in recorded data, and data that is refused."""
import json
import re
from pathlib import Path
from typing import Any, Callable, Dict, List

import numpy as np
import pytest
from learning_data import World, recorded, save
from recordings import BEGIN_S, BagWriter

from shsa_core.cli.main import main
from shsa_core.files.ontology_file import read_ontology
from shsa_learning.learn import models
from shsa_learning.learn.evaluation import evaluate
from shsa_learning.learn.learner import learn
from shsa_learning.learn.refusal import follows
from shsa_learning.learn.relation import relation_of
from shsa_learning.learn.rows import gather
from shsa_learning.recordings.data import read
from shsa_testing.thorough import some


def linear(world: World) -> np.ndarray:
    return 3.0 + 2.0 * world["u"] - 1.2 * world["v"]


def ask(capsys: Any, *words: str, target: str = "y") -> Dict[str, Any]:
    """Run `shsa learn --json`; return its document and its exit status."""
    status = main(["learn", target, "--json", *words])
    answer: Dict[str, Any] = json.loads(capsys.readouterr().out)
    answer["status"] = status
    return answer


def services(names: str) -> str:
    """Return a SOM file: a node and a topic for each name."""
    lines = (
        f"  {name}: {{topic: /{name}, type: std_msgs/Float64, node: /n_{name}, period: 0.05, "
        f"needed: {str(name == 'y').lower()}, provides: {{{name}: {{field: data}}}}}}\n"
        for name in names
    )
    return "services:\n" + "".join(lines)


def one_file(folder: Path, columns: Dict[str, np.ndarray]) -> str:
    """Return all that was recorded in one table, 10 lines a second."""
    path = folder / "drive.csv"
    rows = np.column_stack(list(columns.values()))[::10]
    time = np.arange(len(rows)) * 0.1
    header = ",".join(["time", *columns])
    table = np.column_stack([time, rows])
    np.savetxt(str(path), table, delimiter=",", header=header, comments="", fmt="%.7g")
    return str(path)


def coefficients(function: str) -> Dict[str, float]:
    """Return the coefficients of a linear function by input; '' stands for the constant."""
    sum_ = function.split("; ")[-1].replace("- ", "-").replace("+ ", "")
    parts = (part.partition("*") for part in sum_.split())
    return {name.replace("past_", ""): float(value) for value, _, name in parts}


DRIFTING = (21, 32)
"""Seeds of random walks that seem to tell each other."""


@pytest.mark.parametrize("seed", some(range(4)))
def test_known_coefficients_are_found_again(tmp_path: Path, capsys: Any, seed: int) -> None:
    files = recorded(tmp_path, linear, seed)
    answer = ask(capsys, "--data", *files, "--model", "linear")
    assert answer["accepted"] and answer["status"] == 0, answer["reason"]
    found = coefficients(answer["function"])
    # Inputs are up to 0.04 s old, and both they and the target have noise.
    assert found[""] == pytest.approx(3.0, abs=0.03)
    assert found["u"] == pytest.approx(2.0, abs=0.04)
    assert found["v"] == pytest.approx(-1.2, abs=0.04)
    assert set(answer["inputs"]) == {"u", "v"}


def test_the_document_has_all_figures(tmp_path: Path, capsys: Any) -> None:
    answer = ask(capsys, "--data", *recorded(tmp_path, linear), "--model", "linear")
    assert answer["model"] == "linear" and answer["reason"] == ""
    assert answer["blocks"] == 6
    assert 0.01 < answer["rms"] < 0.15
    assert 0.0 < answer["nrmse"] <= answer["worst_block_nrmse"] < answer["baseline_nrmse"]
    assert abs(answer["bias"]) < answer["rms"] < answer["p95"] < 4.0 * answer["rms"]


def test_the_stated_error_is_that_of_another_drive(tmp_path: Path, capsys: Any) -> None:
    files = recorded(tmp_path / "one", linear, seed=1)
    stated = ask(capsys, "--data", *files, "--model", "linear")
    data = gather(read(files), "y")
    relation = relation_of(learn(data, "linear"))
    unseen = gather(read(recorded(tmp_path / "two", linear, seed=2)), "y").table
    off = evaluate(relation, {}, unseen) - unseen.target
    off = off[np.isfinite(off)]
    assert np.sqrt(np.mean(off**2)) == pytest.approx(stated["rms"], rel=0.3)
    assert np.mean(np.abs(off) <= stated["p95"]) == pytest.approx(0.95, abs=0.03)


LAWS: Dict[str, Callable[[World], np.ndarray]] = {
    "linear": linear,
    "products": lambda world: 1.0 + 2.0 * world["u"] * world["v"] + 1.5 * np.abs(world["u"]),
    "divided": lambda world: (5.0 + 3.0 * np.abs(world["u"])) / (3.0 + 0.6 * np.tanh(world["v"])),
}


@pytest.mark.parametrize("form", some(["products", "linear"]))
def test_the_form_is_found_as_well(tmp_path: Path, capsys: Any, form: str) -> None:
    answer = ask(capsys, "--data", *recorded(tmp_path, LAWS[form], seconds=80.0))
    assert answer["accepted"], answer["reason"]
    assert answer["model"] == {"linear": "inputs", "products": "terms"}[form]
    for term in {"linear": ("*u", "*v"), "products": ("*v*u", "*abs(u)")}[form]:
        assert term in answer["function"]
    assert answer["nrmse"] < 0.05


@pytest.mark.parametrize("choice", ["linear", "polynomial", "svr", "mlp"])
def test_what_is_generated_is_what_was_fitted(tmp_path: Path, choice: str) -> None:
    law = LAWS["products"] if choice == "polynomial" else linear
    data = gather(read(recorded(tmp_path, law, seconds=80.0)), "y")
    learned = learn(data, choice)
    assert learned.accepted, learned.reasons
    relation = relation_of(learned)
    assert learned.model is not None
    fitted = learned.model.predict(data.table)
    generated = evaluate(relation, {}, data.table)
    both = np.isfinite(fitted) & np.isfinite(generated)
    assert both.mean() > 0.9
    assert np.max(np.abs(generated[both] - fitted[both])) <= 1e-9


def test_the_same_seed_gives_the_same(tmp_path: Path, monkeypatch: Any) -> None:
    monkeypatch.setattr(models, "NETWORK_STEPS", 20)
    data = gather(read(recorded(tmp_path, LAWS["products"], seconds=80.0)), "y")
    one, other = (learn(data, "mlp", seed=3).model for _ in "ab")
    assert one is not None and other is not None
    assert one.function == other.function


def test_a_filter_of_an_input_is_found(tmp_path: Path, capsys: Any) -> None:
    world = World(5)
    slow = np.copy(world["u"])
    for row in range(1, len(slow)):
        slow[row] = slow[row - 1] + (world["u"][row] - slow[row - 1]) * 0.01 / 0.4
    files = save(
        tmp_path,
        y=world.sensor(2.0 * slow + world["v"]),
        u=world.sensor(world["u"], rate=50.0),
        v=world.sensor(world["v"], rate=50.0),
    )
    answer = ask(capsys, "--data", *files, "--model", "linear")
    assert "lowpass(u, 0.4)" in answer["function"] and "(v" not in answer["function"]
    assert answer["nrmse"] < 0.02


def test_a_relation_is_written_and_found(tmp_path: Path, capsys: Any) -> None:
    ontology = tmp_path / "o.yaml"
    ontology.write_text(
        "properties:\n  y: {unit: A}  # the current\n  u: {unit: m/s}\n  v: {unit: V}\n"
        "relations:\n  old:\n    y: {function: 20.3*u, quality: 0.1}  # rough\n"
    )
    som = tmp_path / "som.yaml"
    som.write_text(services("yuv"))
    files = recorded(tmp_path, linear)
    words = ("--data", *files, "--model", "linear", "--ontology", str(ontology))
    answer = ask(capsys, *words, "--write", "--som", str(som))
    assert answer["accepted"], answer["reason"]
    text = ontology.read_text()
    assert "# the current" in text and "# rough" in text and "learned_y:" in text
    (function,) = [f for f in read_ontology(str(ontology)).functions if f.relation != "old"]
    assert function.error is not None and function.error.rms == pytest.approx(answer["rms"], 1e-3)
    assert "y.csv" in function.error.source and "seed 0" in function.error.source
    assert function.constraint is not None and "< u <" in function.constraint.text
    assert main(["check", str(ontology), "--som", str(som)]) == 0
    capsys.readouterr()
    assert main(["find", "y", "--ontology", str(ontology), "--som", str(som), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["relations"] == ["learned_y"]
    # Once more: it is replaced.
    assert ask(capsys, *words, "--write")["accepted"]
    assert ontology.read_text().count("learned_y:") == 1


def test_nothing_is_written_if_it_is_refused(tmp_path: Path, capsys: Any) -> None:
    ontology = tmp_path / "o.yaml"
    files = recorded(tmp_path, linear, seconds=40.0)
    answer = ask(capsys, "--data", *files, "--ontology", str(ontology), "--write")
    assert answer["status"] == 1 and not ontology.exists()


def test_a_law_with_known_numbers_competes(tmp_path: Path, capsys: Any) -> None:
    ontology = tmp_path / "o.yaml"
    ontology.write_text(
        "properties: {y: , u: , v: }\nconstants: {c: {value: 3}}\n"
        "relations:\n  known: {y: c + 2*u - 1.2*v}\n"
    )
    words = ("--data", *recorded(tmp_path, linear), "--ontology", str(ontology), "--write")
    answer = ask(capsys, *words, "--model", "linear")
    assert (answer["model"], answer["function"]) == ("law", "c + 2*u - 1.2*v")
    (function,) = read_ontology(str(ontology)).functions
    assert function.error is not None and function.error.rms == pytest.approx(answer["rms"], 1e-3)


def test_the_page_shows_what_was_measured(tmp_path: Path, capsys: Any) -> None:
    page = tmp_path / "page.html"
    files = recorded(tmp_path, linear)
    still = world_at_rest(tmp_path)
    ask(capsys, "--data", *files, *still, "--model", "terms", "--report", str(page))
    text = page.read_text()
    assert text.count("data:image/png;base64,") == 4 and "http" not in text
    for title in ("Measured, and predicted", "Residuals by block", "What each term gains"):
        assert title in text
    assert re.search(r"<code>u</code></td><td>[12]\.\d{2,4} ± 0\.\d{2,4}<", text)
    assert "<td>s</td><td>it is constant (4)</td>" in text and "Where it holds" in text
    assert not re.search(r"\d\.\d{8}", text)


def world_at_rest(folder: Path) -> List[str]:
    world = World(0)
    return save(folder, s=world.sensor(np.full(len(world.time), 4.0), noise=0.0))


def test_support_vectors_are_shown_with_few_digits(tmp_path: Path, capsys: Any) -> None:
    page = tmp_path / "page.html"
    files = recorded(tmp_path, linear, seconds=70.0)
    ask(capsys, "--data", *files, "--model", "svr", "--report", str(page))
    text = page.read_text()
    assert "<details>" in text and not re.search(r"\d\.\d{8}", text)


# What is refused.


def refused(capsys: Any, files: List[str], *words: str) -> str:
    answer = ask(capsys, "--data", *files, "--model", "linear", *words)
    assert not answer["accepted"] and answer["status"] == 1
    return str(answer["reason"])


def test_too_little_data(tmp_path: Path, capsys: Any) -> None:
    assert "60 s are the least" in refused(capsys, recorded(tmp_path, linear, seconds=55.0))


def test_a_constant_input(tmp_path: Path, capsys: Any) -> None:
    world = World(0)
    still = world.sensor(np.full(len(world.time), 4.0), noise=0.0)
    y, u = world.sensor(linear(world)), world.sensor(world["u"])
    answer = ask(capsys, "--data", *save(tmp_path, y=y, u=u, s=still), "--model", "linear")
    assert answer["inputs"] == ["u"] and answer["left_out"] == {"s": "it is constant (4)"}
    (tmp_path / "u.csv").unlink()
    alone = refused(capsys, save(tmp_path, y=y, s=still))
    assert "nothing to learn y from (s: it is constant (4))" in alone


def test_one_block_of_excitation(tmp_path: Path, capsys: Any) -> None:
    world = World(0, 180.0)
    world.signals["u"] = np.where(np.abs(world.time - 45.0) < 12.0, world["u"], 0.0)
    files = save(
        tmp_path, y=world.sensor(linear(world)), **{n: world.sensor(world[n]) for n in "uv"}
    )
    answer = ask(capsys, "--data", *files, "--model", "linear")
    assert re.match("it varies in [12] of 6 blocks", answer["left_out"]["u"])
    assert "worst block" in answer["reason"]


LEAKS: Dict[str, Callable[[np.ndarray, np.ndarray], np.ndarray]] = {
    "line": lambda y, v: 2.0 * y + 1.0,
    "square": lambda y, v: y * np.abs(y),
    "noise": lambda y, v: y + 0.001 * v,
    "power": lambda y, v: y * (12.0 + 0.3 * v),
}


@pytest.mark.parametrize("leak", some([*LEAKS], 2))
def test_an_input_that_is_computed_from_the_target(tmp_path: Path, capsys: Any, leak: str) -> None:
    world = World(0)
    y, v = world.sensor(linear(world)), world.sensor(world["v"])
    at = np.interp(list(y), list(v), list(v.values()))
    values = LEAKS[leak](np.array(list(y.values())), at)
    files = save(
        tmp_path,
        y=y,
        v=v,
        u=world.sensor(world["u"]),
        leak=dict(zip(y, values.tolist())),
    )
    answer = ask(capsys, "--data", *files, "--model", "linear")
    assert "leak" in answer["left_out"] or "leak" in answer["reason"]
    assert "leak" in refused(capsys, files, "--from", "u,leak")
    answer = ask(capsys, "--data", *files, "--model", "linear", "--from", "u,v")
    assert answer["accepted"], answer["reason"]


def test_a_drive_in_one_file(tmp_path: Path, capsys: Any) -> None:
    world = World(0)
    noise = world.random.normal(0.0, 0.05, (3, len(world.time)))
    u, v = world["u"] + noise[0], world["v"] + noise[1]
    y = linear(world) + noise[2]
    path = one_file(tmp_path, {"y": y, "u": u, "v": v, "leak": 2.0 * y + 0.001 * u})
    reason = refused(capsys, [path])
    assert "a file is one source, unless --from names the inputs, or --som says" in reason
    answer = ask(capsys, "--data", path, "--model", "linear", "--from", "u,v")
    assert answer["accepted"], answer["reason"]
    assert coefficients(answer["function"])["u"] == pytest.approx(2.0, abs=0.04)
    assert "leak seems to be computed from y" in refused(capsys, [path], "--from", "u,leak")
    som = tmp_path / "som.yaml"
    som.write_text(services("yuv"))
    told = ask(capsys, "--data", path, "--model", "linear", "--som", str(som), "--from", "u,v")
    assert told["function"] == answer["function"]


def test_a_rough_signal_is_no_noise(tmp_path: Path, capsys: Any) -> None:
    random = np.random.RandomState(0)
    rough = np.zeros(24000)
    for row, push in enumerate(random.normal(0.0, 0.1, len(rough) - 1)):
        rough[row + 1] = 0.995 * rough[row] + push
    y = 2.0 * rough + random.normal(0.0, 0.05, len(rough))
    path = one_file(tmp_path, {"y": y, "u": rough})
    answer = ask(capsys, "--data", path, "--model", "linear", "--from", "u")
    assert answer["accepted"], answer["reason"]


def test_coefficients_that_flip(tmp_path: Path, capsys: Any) -> None:
    world = World(0, 180.0)
    sign = np.where(world.time < 90.0, 1.0, -1.0)
    y = 3.0 * world["u"] + sign * world["v"]
    files = save(tmp_path, y=world.sensor(y), **{n: world.sensor(world[n]) for n in "uv"})
    assert "coefficient of v flips its sign" in refused(capsys, files)


def test_what_does_not_follow(tmp_path: Path, capsys: Any) -> None:
    files = recorded(tmp_path, lambda world: world["w"])
    assert "skill" in refused(capsys, files)


def test_what_only_drifts_tells_nothing(tmp_path: Path, capsys: Any) -> None:
    for seed in DRIFTING:
        random = np.random.RandomState(seed)
        walks = np.cumsum(random.normal(size=(2000, 4)), axis=0)
        time = (np.arange(2000) * 0.1).tolist()
        series = {name: dict(zip(time, walk.tolist())) for name, walk in zip("yuvw", walks.T)}
        reason = refused(capsys, save(tmp_path / str(seed), **series))
        assert "does not follow the changes" in reason


def test_a_common_trend_is_not_followed() -> None:
    random = np.random.RandomState(0)
    noise = [np.convolve(random.normal(size=3000), np.ones(50) / 7.0, "same") for _ in range(2)]
    target = np.arange(3000) / 100.0 + noise[0]
    assert follows(noise[1] - noise[0], target) < 0.0
    assert follows(0.3 * noise[1], target) > 0.3


def test_a_world_that_changes(tmp_path: Path, capsys: Any) -> None:
    files = recorded(
        tmp_path,
        lambda world: 2.0 * world["u"] + np.where(world.time > 100.0, 9.0, 0.0),
        seconds=120.0,
    )
    assert "worst block" in refused(capsys, files)


def test_a_bag_that_was_healed_half_way(tmp_path: Path, capsys: Any) -> None:
    world = World(0, 130.0)
    y = world.sensor(linear(world), rate=10.0)
    cut = 40.0
    bag, som = tmp_path / "healed.bag", tmp_path / "som.yaml"
    with BagWriter(bag) as writer:
        for name in "uv":
            samples = world.sensor(world[name], rate=20.0).items()
            writer.floats(f"/{name}", [(BEGIN_S + t, x) for t, x in samples], f"/n_{name}")
        own = [(BEGIN_S + t, x) for t, x in y.items() if t < cut]
        writer.floats("/y", own, "/n_y")
        said = [(BEGIN_S + t, 7.0) for t in y if t > cut + 0.5]
        writer.floats("/y", said, "/substitute_y_1")
    som.write_text(services("yuv"))
    reason = refused(capsys, [str(bag)], "--som", str(som))
    assert "s of data" in reason and "60 s are the least" in reason


def test_single_outliers_do_no_harm(tmp_path: Path, capsys: Any) -> None:
    world = World(0)
    y, u = world.sensor(linear(world)), world.sensor(world["u"], rate=50.0)
    for series in (y, u):
        for time in list(series)[7::90]:
            series[time] += 500.0
    files = save(tmp_path, y=y, u=u, v=world.sensor(world["v"], rate=50.0))
    answer = ask(capsys, "--data", *files, "--model", "linear")
    assert answer["accepted"], answer["reason"]
    assert coefficients(answer["function"])["u"] == pytest.approx(2.0, abs=0.05)


def test_too_many_outliers(tmp_path: Path, capsys: Any) -> None:
    world = World(0)
    y = world.sensor(linear(world))
    for time in list(y)[::10]:
        y[time] = -400.0
    files = save(tmp_path, y=y, u=world.sensor(world["u"]), v=world.sensor(world["v"]))
    assert "% of y are outliers" in refused(capsys, files)


def test_a_wrong_call(tmp_path: Path, capsys: Any) -> None:
    files = recorded(tmp_path, linear, seconds=10.0)
    for words in (
        ("learn", "q", "--data", *files),
        ("learn", "y", "--data", *files, "--from", "u,q"),
        ("learn", "y", "--data", *files, "--write"),
        ("learn", "y", "--data", str(tmp_path / "none.csv")),
    ):
        assert main(list(words)) == 2
        assert "shsa: " in capsys.readouterr().err


def test_the_target_is_no_input(tmp_path: Path, capsys: Any) -> None:
    files = recorded(tmp_path, linear, seconds=10.0)
    assert main(["learn", "y", "--data", *files, "--from", "y"]) == 2
    assert "y" in capsys.readouterr().err
