"""`shsa find` where errors are known."""
import json
import pathlib
from typing import Any, Callable, Dict, Tuple

import pytest

from shsa_core.cli.main import main
from shsa_core.codegen.generator import fuse, generate
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.calibration import Calibration, CalibrationRow
from shsa_core.model.error import Error
from shsa_core.planning.planner import Calibrations
from shsa_core.search.derivation import Derivation
from shsa_learning.cli import find
from shsa_learning.substitutes import substitutes

ONTOLOGY = """\
properties: {y: {unit: A, usual: [0, 5]}, w: {usual: [0, 1]}, x: {usual: [0, 1]}, z: }
relations:
  high:
    y: {function: 2*z, quality: 0.9, error: {rms: 0.5, p95: 0.8, source: a drive}}
  low:
    y: {function: 3*x, quality: 0.5, error: 0.2}
  share:
    w: 2*x
"""
SERVICE = "  {0}: {{topic: /{0}, type: p/T, period: 0.1, node: /{0}, {2}provides: {{{1}}}}}\n"
SOM = "services:\n" + "".join(
    SERVICE.format(*each)
    for each in (
        ("odom", "y: {field: y}, w: {field: w}", "needed: true, "),
        ("z", "z: {field: d}", ""),
        ("x", "x: {field: d, error: {rms: 0.05, bias: 0.03}}", ""),
    )
)

Shsa = Callable[..., Any]


@pytest.fixture
def shsa(tmp_path: pathlib.Path, capsys: Any) -> Shsa:
    """Runs a command that is to succeed; returns what it prints, read if it is JSON."""
    (tmp_path / "o.yaml").write_text(ONTOLOGY)
    (tmp_path / "s.yaml").write_text(SOM)
    models = ["--ontology", str(tmp_path / "o.yaml"), "--som", str(tmp_path / "s.yaml")]

    def run(*arguments: str) -> Any:
        assert main([*arguments, *models]) == 0
        printed = capsys.readouterr().out
        return json.loads(printed) if "--json" in arguments else printed

    return run


LOW: Dict[str, Any] = {"rms": 0.2, "bias": 0.0, "p95": 0.391993, "delay": 0.0, "source": ""}


def close(error: Dict[str, Any]) -> Any:
    return pytest.approx(error, abs=1e-6)


def numbers(error: Dict[str, Any]) -> Dict[str, Any]:
    return {key: value for key, value in error.items() if key != "source"}


def test_find_says_what_error_is_expected(shsa: Shsa) -> None:
    answer = shsa("find", "y", "--json")
    assert answer["relations"] == ["low"] and answer["proven_best"]
    assert numbers(answer["error"]) == close(numbers(LOW))
    (service,) = answer["services"]
    assert service["relations"] == ["low", "share"]
    expected = {"rms": 0.1, "bias": 0.06, "p95": 0.195996, "delay": 0.0}
    assert numbers(service["errors"]["w"]) == close(expected)
    assert service["errors"]["w"]["source"] == "predicted"
    text = shsa("find", "y")
    assert "quality 0.5, error 0.2 (95 %: 0.392) by low from /x/d" in text
    assert ", y error 0.2 (95 %: 0.392), w error 0.1 (95 %: 0.196) by low, share" in text


def test_all_substitutes_and_alternatives_come_by_their_errors(shsa: Shsa) -> None:
    answer = shsa("find", "y", "--method", "all", "--explain", "--json")
    assert [each["relations"] for each in answer["substitutes"]] == [["low"], ["high"]]
    assert [each["proven_best"] for each in answer["substitutes"]] == [True, False]
    assert answer["substitutes"][1]["error"] == dict(LOW, rms=0.5, p95=0.8, source="a drive")
    assert [each["error"]["rms"] for each in answer["alternatives"]] == [0.5]
    assert answer["derivation"] == [
        "y  low: 3*x  (quality 0.5, error 0.2)",
        "  x  measured by /x at /x/d  (quality 1, error 0.05)",
    ]


def test_what_errs_too_much_is_not_used_and_it_is_said_why(
    shsa: Shsa, tmp_path: pathlib.Path, capsys: Any
) -> None:
    def run(limit: float, *arguments: str) -> Tuple[int, str]:
        strict = SOM.replace("{field: y}", f"{{field: y, fault_tolerant_error: {limit}}}")
        (tmp_path / "strict.yaml").write_text(strict)
        ontology, strict_som = str(tmp_path / "o.yaml"), str(tmp_path / "strict.yaml")
        models = ["--ontology", ontology, "--som", strict_som]
        if arguments[0] == "check":
            models = [ontology, "--som", strict_som]
        return main([*arguments, *models]), capsys.readouterr().out

    why = "y by low: its error of 0.392 (p95) is above fault_tolerant_error, 0.3"
    status, text = run(0.3, "find", "y")
    assert status == 1 and f"Nothing that can be used replaces y: {why}" in text
    status, text = run(0.3, "find", "odom", "--json")
    answer = json.loads(text)
    assert status == 1 and answer["substitute"] is None and answer["refused"] == why
    status, text = run(0.3, "check")
    assert f"there is no substitute for y, w: {why}" in text
    status, text = run(0.5, "find", "y", "--explain", "--json")
    (other,) = json.loads(text)["alternatives"]
    assert status == 0 and other["not_used"].startswith("its error of 0.8 (p95) is above")
    _, text = run(0.5, "find", "y", "--explain")
    assert "(not used: its error of 0.8 (p95) is above fault_tolerant_error, 0.5)" in text
    status, text = run(0.3, "report", "--json")
    assert why in text


def test_without_a_master_nothing_live_is_waited_for(
    shsa: Shsa, monkeypatch: Any, capsys: Any
) -> None:
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    monkeypatch.setenv("ROS_NAMESPACE", "/")  # which it sets
    with pytest.raises(AssertionError):
        shsa("find", "y", "--live")
    assert "no ROS master answers at http://localhost:1" in capsys.readouterr().err


@pytest.mark.parametrize("fuses", [False, True])
def test_explain_says_why_values_are_fused_or_not(
    shsa: Shsa, tmp_path: pathlib.Path, monkeypatch: Any, fuses: bool
) -> None:
    text = shsa("find", "y", "--explain")
    assert "fusion  none: it takes errors at the same moments, of a running robot (--live)" in text
    ontology, som = read_ontology(str(tmp_path / "o.yaml")), read_som(str(tmp_path / "s.yaml"))
    left = [each for each in som.sources if each.service.name != "odom"]
    singles = [each.derivation for each, _ in substitutes(ontology, left, "y")]
    function = fuse(singles, [(0.7, Calibration()), (0.3, Calibration(1.1, 0.5))]).function
    told = [*singles, Derivation("y", None, function, tuple(singles))][: 3 if fuses else 2]
    heard = Calibrations()
    for number, derivation in enumerate(told):
        program = generate([(derivation, "/odom/y")], ontology.constants)
        rms = 0.3 - 0.1 * number
        error = Calibration(error=Error(rms, p95=2.0 * rms, n=200))
        heard.add(CalibrationRow("odom", program, (error,)), healing=False)
    monkeypatch.setattr(find, "_measured", lambda namespace: heard)
    text = shsa("find", "y", "--explain", "--live")
    if fuses:
        assert "y: quality 0.45, error 0.1 (95 %: 0.2) by fusion 70:30, high, low from" in text
        assert "  return 0.7*i1 + 0.33*i2 +0.15\n" in text
        assert (
            "fusion  fusion 70:30 errs clearly less than each part: 0.7*first + 0.33*second" in text
        )
    else:
        assert "y: quality 0.5, error 0.2 (95 %: 0.4) by low from /x/d" in text
        assert "fusion  none: no sum of what is calibrated has erred 5 % less" in text
