"""`shsa check`: every kind of finding, with file, line and what to do."""
import json
import pathlib
from typing import Any, Callable, List, Optional, Tuple

import pytest

from shsa_core import message_types
from shsa_core.cli.main import main
from shsa_learning.check import Finding, check_files

ROOT = pathlib.Path(__file__).resolve().parents[4]

Check = Callable[..., List[Finding]]

ONTOLOGY = """\
properties:
  i: {unit: A}
  u: {unit: V}
  p: {unit: W}
  v: {unit: m/s}
  lonely: {unit: m}
constants:
  k: {value: 2, unit: V}
relations:
  ohm:
    p: u*i
    i: p/u
    u: p/i
"""
SOM = """\
services:
  amps: {topic: /i, type: std_msgs/Float64, node: /amps, period: 0.1, needed: true,
         provides: {i: {field: data, range: [-5, 60]}}}
  volts: {topic: /u, type: std_msgs/Float64, node: /volts, period: 0.1,
          provides: {u: {field: data, range: [9, 14]}}}
  watts: {topic: /p, type: std_msgs/Float64, node: /watts, period: 0.1,
          provides: {p: {field: data}}}
  wheels: {topic: /v, type: std_msgs/Float64, node: /wheels, period: 0.1, needed: true,
           provides: {v: {field: data}}}
"""


@pytest.fixture
def check(tmp_path: pathlib.Path) -> Check:
    def run(ontology: str, som: Optional[str] = None) -> List[Finding]:
        (tmp_path / "o.yaml").write_text(ontology)
        if som is None:
            return check_files(str(tmp_path / "o.yaml"))
        (tmp_path / "s.yaml").write_text(som)
        return check_files(str(tmp_path / "o.yaml"), str(tmp_path / "s.yaml"))

    return run


def brief(findings: List[Finding]) -> List[Tuple[str, str, str]]:
    return [(f.level, pathlib.Path(f.where).name, f.what) for f in findings]


def test_the_models_that_come_with_it_are_valid() -> None:
    ontology, som = str(ROOT / "ontology/rover.yaml"), str(ROOT / "ontology/rover_som.yaml")
    assert [str(f) for f in check_files(ontology, som) if f.level == "error"] == []
    assert [str(f) for f in check_files(str(ROOT / "ontology/paper.yaml"))] == []


def test_a_good_ontology_alone(check: Check) -> None:
    assert check(ONTOLOGY) == []


def test_findings_of_a_model(check: Check, tmp_path: pathlib.Path) -> None:
    findings = check(ONTOLOGY, SOM)
    assert brief(findings) == [
        (
            "warning",
            "o.yaml:6",
            "lonely cannot be reached: no service provides it, "
            "and no relation yields it from what services provide",
        ),
        (
            "warning",
            "o.yaml:13",
            "ohm for u: i can be 0 (from -5 to 60), and is divided by; there is no output then",
        ),
        (
            "warning",
            "s.yaml:8",
            "wheels is needed, but if /wheels fails there is no substitute for v: "
            "missing any relation that yields it",
        ),
    ]
    assert [f.todo for f in findings] == [
        "Add a service or a relation, or remove the property",
        "If that is too often, add a constraint, or narrow the ranges in the SOM",
        "Add a relation or a service that yields what is missing",
    ]
    assert str(findings[0]).startswith(f"{tmp_path}/o.yaml:6: warning: lonely cannot be reached")
    assert str(findings[0]).endswith(". Add a service or a relation, or remove the property.")
    assert str(Finding("error", "f:1", "what")) == "f:1: error: what"


def test_a_gate_without_a_hot_substitute_is_named(check: Check) -> None:
    gated = SOM.replace("{topic: /i,", "{topic: /i, gate: /i/raw,")
    said = "amps has a gate, but no hot substitute"
    assert any(said in each.what for each in check(ONTOLOGY, gated))
    hot = gated.replace("needed: true,", "needed: true, standby: hot,")
    assert not any(said in each.what for each in check(ONTOLOGY, hot))


def test_the_values_that_nothing_derives_are_named(check: Check) -> None:
    som = SOM.replace("range: [-5, 60]}", "range: [-5, 60]}, lonely: {field: x}")
    assert som != SOM
    ((what, todo),) = [(f.what, f.todo) for f in check(ONTOLOGY, som) if "lonely" in f.what]
    assert "lonely cannot be derived" in what and "leave lonely out of its 'provides'" in todo
    (what,) = [
        f.what for f in check(ONTOLOGY, som.replace("needed: true,", "")) if "lonely" in f.what
    ]
    assert what.startswith("amps may be needed, but if /amps fails")


def test_what_a_message_marks_as_unknown_stands_in_nobodys_way(tmp_path: pathlib.Path) -> None:
    (tmp_path / "o.yaml").write_text(ONTOLOGY)
    battery = "{topic: /i, type: sensor_msgs/BatteryState, node: /amps, period: 0.1, needed: true,"
    values = "provides: {i: {field: current}, lonely: {field: temperature}}}"
    som = SOM.splitlines()
    (tmp_path / "s.yaml").write_text("\n".join([som[0], f"  amps: {battery} {values}", *som[3:]]))
    files = str(tmp_path / "o.yaml"), str(tmp_path / "s.yaml")
    found = [f for f in check_files(*files, message_types) if f.what.startswith("amps is needed")]
    assert [each.what for each in found] == [
        "amps is needed, but if /amps fails there is a substitute for part of it: "
        "lonely is left unknown, missing any relation that yields it"
    ]
    assert found[0].todo.endswith("or leave lonely out of its 'provides'")
    (without_ros,) = [f for f in check_files(*files) if f.what.startswith("amps is needed")]
    assert "no substitute for i, lonely: lonely cannot be derived" in without_ros.what


def test_what_stands_in_the_way_of_a_substitute_is_named(check: Check) -> None:
    som = "\n".join(SOM.splitlines()[:3]) + "\n"
    what = [f.what for f in check(ONTOLOGY, som) if "is needed" in f.what]
    assert what[0].startswith(
        "amps is needed, but if /amps fails there is no substitute for i: missing"
    )


def test_everything_that_is_published_by_the_failed_node_is_lost_with_it(check: Check) -> None:
    som = SOM.replace("/volts", "/amps")
    assert any("amps is needed, but if /amps fails" in f.what for f in check(ONTOLOGY, som))


def test_errors_of_units(check: Check) -> None:
    findings = check(
        ONTOLOGY + "  wrong:\n    i: u + k\n    v: 2*p\n    p: {function: u*i, constraint: u > i}\n"
    )
    assert brief(findings) == [
        ("error", "o.yaml:15", "units of wrong for i: the function gives V, its property is in A"),
        ("error", "o.yaml:17", "units of wrong for p: V is compared with A"),
        (
            "warning",
            "o.yaml:16",
            "units of wrong for v: the function gives W, its property is in m*s^-1",
        ),
    ]
    assert findings[0].todo == "Correct the function or the units"
    assert "give the number that carries a unit a name in 'constants'" in findings[2].todo


def test_units_that_are_none(check: Check) -> None:
    findings = check(
        "properties:\n  a: {unit: foo}\n  b: {unit: m**9**9}\n"
        "constants:\n  k: {value: 1, unit: x9}\nrelations:\n  r:\n    a: b*k\n"
    )
    assert [(f.level, f.where.rsplit(":")[-1]) for f in findings] == [
        ("error", "2"),
        ("error", "3"),
        ("error", "5"),
    ]
    assert findings[0].what.startswith("a: there is no unit 'foo'")


def test_functions_that_cannot_be_executed(check: Check) -> None:
    findings = check(ONTOLOGY + '  rdl:\n    i: {not_executable: "min(laser)", inputs: [u]}\n', SOM)
    assert (
        "warning",
        "o.yaml:15",
        "rdl for i cannot be executed: 'min(laser)'",
    ) in brief(findings)


def test_what_a_constant_makes_impossible(check: Check) -> None:
    findings = check(
        "properties: {a: , b: }\nconstants: {k: {value: 500}}\n"
        "relations:\n  r:\n    a: b**(k + 0)\n"
    )
    assert [f.where.rsplit(":")[-1] for f in findings] == ["5"]
    assert "no code for the relations r" in findings[0].what and findings[0].level == "error"


def test_constraints_prevent_divisions_by_zero(check: Check) -> None:
    text = ONTOLOGY.replace("u: p/i", "u: {function: p/i, constraint: i > 1}")
    assert not any("divided by" in f.what for f in check(text, SOM))


def test_services_of_properties_that_are_not_there(check: Check) -> None:
    som = SOM.replace("{v: ", "{w: ") + (
        "  konst: {topic: /k, type: a/B, node: /k, period: 1, provides: {k: {field: data}}}\n"
    )
    findings = [f for f in check(ONTOLOGY, som) if f.level == "error"]
    assert brief(findings) == [
        ("error", "s.yaml:9", "wheels provides 'w', which is not in the ontology"),
        ("error", "s.yaml:10", "konst provides 'k', which is a constant in the ontology"),
    ]


def test_what_a_service_is_derived_from_is_there(check: Check) -> None:
    derived = "needed: true, derived_from: [volts, u, p, /elsewhere,\n  volt, wats],"
    findings = check(ONTOLOGY, SOM.replace("needed: true,", derived, 1))
    told = {text for text in map(str, findings) if "is derived from" in text}
    what = "amps is derived from the service {}, which is not there; did you mean {}? "
    todo = "Correct the name, write a topic as /topic, or remove it."
    assert {text.partition("warning: ")[2] for text in told} == {
        what.format("volt", "volts") + todo,
        what.format("wats", "watts") + todo,
    }
    assert all("s.yaml:3: " in text for text in told)


def test_ranges_of_all_services_count(check: Check) -> None:
    second = "  u2: {topic: /u2, type: a/B, node: /v2, period: 1, provides: {u: {field: data%s}}}\n"

    def divisions(extra: str) -> List[str]:
        return [f.what for f in check(ONTOLOGY, SOM + second % extra) if "ohm for i" in f.what]

    assert divisions(", range: [8, 9]") == []
    assert "u can be 0 (from -1 to 14)" in divisions(", range: [-1, 9]")[0]
    assert divisions("") == []


def test_a_relation_without_inputs_reaches_its_output(check: Check) -> None:
    findings = check(ONTOLOGY + "  fixed:\n    lonely: 5\n", SOM)
    assert not any("reached" in f.what for f in findings)


def test_a_cycle_reaches_nothing(check: Check) -> None:
    text = "properties: {a: , b: , c: }\nrelations:\n  r: {a: b, b: a}\n"
    som = (
        "services:\n"
        "  c: {topic: /c, type: a/B, node: /c, period: 1, provides: {c: {field: data}}}\n"
    )
    assert [f.what.split()[0] for f in check(text, som)] == ["a", "b"]


def test_errors_of_reading_come_with_the_rest(check: Check) -> None:
    text = ONTOLOGY + "  r:\n    v: sine(i)\n    i: u\n"
    findings = check(text, SOM + "  x: 5\n")
    assert [(f.level, pathlib.Path(f.where).name) for f in findings[:3]] == [
        ("error", "o.yaml:15"),
        ("error", "o.yaml:16"),
        ("error", "s.yaml:10"),
    ]
    assert any(f.level == "warning" for f in findings)


def test_files_that_cannot_be_read(check: Check, tmp_path: pathlib.Path) -> None:
    assert brief(check("- a"))[0][:2] == ("error", "o.yaml:1")
    assert brief(check(ONTOLOGY, "- a"))[0][:2] == ("error", "s.yaml:1")
    nowhere = str(tmp_path / "nowhere.yaml")
    assert check_files(nowhere)[0].what == "cannot be read: No such file or directory"
    assert check_files(nowhere)[0].where == nowhere


def test_the_command_line(tmp_path: pathlib.Path, capsys: Any) -> None:
    good, bad, som = tmp_path / "o.yaml", tmp_path / "bad.yaml", tmp_path / "s.yaml"
    good.write_text(ONTOLOGY)
    bad.write_text(ONTOLOGY + "  r:\n    v: sine(i)\n")
    som.write_text(SOM)
    assert main(["check", str(good)]) == 0
    assert capsys.readouterr().out == "valid: 0 errors, 0 warnings\n"
    assert main(["check", str(good), "--som", str(som)]) == 0
    assert capsys.readouterr().out.endswith("\nvalid: 0 errors, 3 warnings\n")
    assert main(["check", str(bad)]) == 1
    printed = capsys.readouterr().out
    assert f"{bad}:15: error: r for v: function: there is no function 'sine'" in printed
    assert printed.endswith("\nnot valid: 1 errors, 0 warnings\n")
    assert main(["check", str(bad), "--json"]) == 1
    report = json.loads(capsys.readouterr().out)
    assert report["valid"] is False
    assert report["findings"][0]["where"] == f"{bad}:15"
    assert set(report["findings"][0]) == {"level", "where", "what", "todo"}
    assert main(["check", str(good), "--json"]) == 0
    assert json.loads(capsys.readouterr().out) == {
        "valid": True,
        "types_checked": False,
        "findings": [],
    }
    with pytest.raises(SystemExit) as caught:
        main(["check"])
    assert caught.value.code == 2


def test_a_service_is_one_finding_for_all_that_it_loses(check: Check) -> None:
    som = SOM.replace("{v: {field: data}}", "{v: {field: data}, lonely: {field: other}}")
    whats = [f.what for f in check(ONTOLOGY, som) if "wheels is needed" in f.what]
    assert whats == [
        "wheels is needed, but if /wheels fails there is no substitute for v, lonely: "
        "missing any relation that yields it"
    ]


def test_an_integral_that_would_start_at_zero_is_named(check: Check) -> None:
    text = (
        "properties: {x: , v: , y: }\nrelations:\n  r:\n    x: integral(v)\n    y: 2*integral(v)\n"
    )
    (found,) = [each for each in check(text) if "integral" in each.what]
    assert (found.level, found.where.rsplit(":", 1)[1]) == ("warning", "5")
    assert "r for y: an integral within an expression starts at 0" in found.what


@pytest.mark.parametrize("has_heading", [True, False])
@pytest.mark.parametrize("law, warns", [("integral(v*cos(heading))", True), ("2*v", False)])
def test_an_angle_of_another_zero_is_told(
    check: Check, has_heading: bool, law: str, warns: bool
) -> None:
    heading = "heading: {field: yaw(pose.pose.orientation)}" if has_heading else ""
    ontology = (
        "properties: {v: {unit: m/s}, heading: {unit: rad}, x: {unit: m}}\n"
        f"relations: {{reckoning: {{x: {law}}}}}"
    )
    som = f"""
services:
  odom: {{topic: /odom, type: nav_msgs/Odometry, node: /base, period: 0.1, needed: true,
         provides: {{x: {{field: pose.pose.position.x}}, {heading}}}}}
  speed: {{topic: /v, type: std_msgs/Float64, node: /speed, period: 0.1,
          provides: {{v: {{field: data}}}}}}
  imu: {{topic: /imu, type: sensor_msgs/Imu, node: /imu, period: 0.1,
        provides: {{heading: {{field: yaw(orientation)}}}}}}
"""
    told = [each for each in check(ontology, som) if "whose zero may be another" in each.what]
    assert bool(told) == (has_heading or warns)


@pytest.mark.parametrize(
    "unit, wrong", [("rad", False), ("deg", True), ("m", True), ("", False), ("foo", False)]
)
def test_an_angle_of_a_quaternion_is_in_rad(check: Check, unit: str, wrong: bool) -> None:
    som = """
services:
  imu: {topic: /imu, type: sensor_msgs/Imu, node: /imu, period: 0.1,
        provides: {heading: {field: yaw(orientation)}}}
"""
    found = check(f"properties: {{heading: {{unit: '{unit}'}}}}\nrelations: {{}}", som)
    told = [each for each in brief(found) if "is in rad" in each[2]]
    what = f"imu: yaw(orientation) is in rad, but heading in {unit}"
    assert told == ([("error", "s.yaml:4", what)] if wrong else [])


def findings(tmp_path: pathlib.Path, where: str, function: str, constraint: str) -> List[str]:
    (tmp_path / "o.yaml").write_text(
        f"properties: {{v: , u: , i: }}\nrelations:\n  r:\n    i:\n      where: {{{where}}}\n"
        f"      function: {function}\n      constraint: {constraint}\n"
    )
    line = "{topic: /%s, type: std_msgs/Float64, node: /n%s, period: 0.1, provides: {%s: {%s}}}"
    (tmp_path / "s.yaml").write_text(
        "services:\n"
        + f"  v: {line % ('v', 'v', 'v', 'field: data, range: [-1, 1]')}\n"
        + f"  u: {line % ('u', 'u', 'u', 'field: data, range: [0, 14]')}\n"
    )
    found = check_files(str(tmp_path / "o.yaml"), str(tmp_path / "s.yaml"))
    return [each.what for each in found if "there is no output then" in each.what]


def test_ranges_are_followed(tmp_path: pathlib.Path) -> None:
    def found(where: str, function: str, constraint: str = "u >= 0") -> List[str]:
        return [
            each.split(": ")[1].split(" can")[0]
            for each in findings(tmp_path, where, function, constraint)
        ]

    assert found("h: v + 2", "1/h") == []
    assert found("h: v + 1", "1/h") == ["h"]
    assert found("h: 1/v", "tanh(h)") == ["v"]
    assert found("h: v + 2, g: 1/(h - 1)", "g") == ["h - 1"]
    assert found("h: u - 1", "sqrt(h)", "u > 1") == []
    assert found("h: u - 1", "sqrt(lowpass(h, 1))", "u > 1") == ["lowpass(h, 1)"]
    assert found("h: u - 1, g: 'lowpass(h, 1)'", "sqrt(g)", "u > 1") == ["g"]
    assert found("h: v", "1/h if h > 0 else 1") == []
