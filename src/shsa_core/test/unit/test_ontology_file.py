"""The ontology file: what it holds, and that every error says where."""
import pathlib
from typing import Any

import pytest

from shsa_core.codegen.plans import plan_service
from shsa_core.codegen.program import compile_program
from shsa_core.errors import ModelError, ModelErrors
from shsa_core.model.ontology import Constant, Property
from shsa_core.model.error import Error
from shsa_core.files.ontology_file import load_ontology, read_ontology
from shsa_core.model.service import Provision, Service
from shsa_core.search.derivation import SourceTable

ROOT = pathlib.Path(__file__).resolve().parents[4]

GOOD = """\
# a comment
properties:
  battery_current: {unit: A, symbol: i}
  battery_voltage: {unit: V}
  battery_power:
  v: {}
constants:
  wheel_base: {value: 0.39, unit: m}
  n: {value: 3}
relations:
  f1:
    battery_current:
      function: 48.67 - 0.03*abs(v) - wheel_base
      quality: 0.9
      constraint: battery_voltage > n
      error: 0.4
  power:
    battery_power:   battery_voltage * battery_current
    battery_current: battery_power / battery_voltage
  laser:
    v: {not_executable: "min(points)", inputs: [battery_power, n], quality: 0.5}
  fixed:
    battery_voltage: 12
"""


def write(tmp_path: pathlib.Path, text: str) -> str:
    file = tmp_path / "o.yaml"
    file.write_text(text)
    return str(file)


def test_a_good_file(tmp_path: pathlib.Path) -> None:
    ontology = read_ontology(write(tmp_path, GOOD))
    assert dict(ontology.properties) == {
        "battery_current": Property("battery_current", "A", "i"),
        "battery_voltage": Property("battery_voltage", "V"),
        "battery_power": Property("battery_power"),
        "v": Property("v"),
    }
    assert dict(ontology.constants) == {
        "wheel_base": Constant("wheel_base", 0.39, "m"),
        "n": Constant("n", 3.0),
    }
    functions: Any = ontology.functions
    f1, power, current, laser, fixed = functions
    assert (f1.relation, f1.output, f1.inputs) == (
        "f1",
        "battery_current",
        ("v", "battery_voltage"),
    )
    assert f1.quality == 0.9 and f1.constraint.text == "battery_voltage > n"
    assert f1.law.text == f1.text == "48.67 - 0.03*abs(v) - wheel_base"
    assert f1.where.endswith("o.yaml:12")
    assert (f1.error, power.error) == (Error(0.4), None)
    assert (power.relation, power.output) == ("power", "battery_power")
    assert power.inputs == ("battery_voltage", "battery_current")
    assert power.quality == 1.0 and power.constraint is None
    assert current.output == "battery_current" and current.where.endswith("o.yaml:19")
    assert laser.law is None and laser.text == "min(points)"
    assert laser.inputs == ("battery_power",) and laser.quality == 0.5
    assert fixed.inputs == () and fixed.law.text == "12"
    assert ontology.properties["v"].where.endswith("o.yaml:6")
    found = [f.relation for f in ontology.functions if f.output == "battery_current"]
    assert found == ["f1", "power"]


def test_the_ontologies_that_come_with_it() -> None:
    for name in ("rover.yaml", "paper.yaml"):
        assert read_ontology(str(ROOT / "ontology" / name)).functions


PROPERTIES = "properties: {a: , b: , c: {unit: m}}\nconstants: {k: {value: 2}}\n"


@pytest.mark.parametrize(
    "text, line, what",
    [
        ("", 1, "the ontology must be a mapping (name: value), not empty"),
        ("- a", 1, "the ontology must be a mapping (name: value), not a list"),
        ("text", 1, "the ontology must be a mapping"),
        ("property: {}", 1, "has no key 'property'; allowed: properties, constants, relations"),
        ("properties: 5", 1, "properties must be a mapping"),
        ("properties: [a]", 1, "properties must be a mapping"),
        ("properties:\n  a: {units: A}", 2, "the property a has no key 'units'; allowed: unit"),
        ("properties:\n  a: 5", 2, "the property a must be a mapping"),
        ("properties:\n  a: {unit: [A]}", 2, "unit must be a text"),
        ("properties:\n  a: {symbol: {}}", 2, "symbol must be a text"),
        ("properties:\n  a: {usual: 3}", 2, "usual, [lowest, highest], must be a list, not 3"),
        ("properties:\n  a: {usual: [2, 1]}", 2, "usual must have its lowest first, not [2, 1]"),
        ("properties:\n  a: {usual: [2]}", 2, "usual must be two numbers"),
        ("properties:\n  1a:", 2, "a property cannot be named '1a'; a name has letters"),
        ("properties:\n  a b:", 2, "a property cannot be named 'a b'"),
        ("properties:\n  a-b:", 2, "a property cannot be named 'a-b'"),
        ("properties:\n  \u00e4:", 2, "a property cannot be named '\\xe4'"),
        ("properties:\n  abs:", 2, "a property cannot be named 'abs'"),
        ("properties:\n  dt:", 2, "a property cannot be named 'dt'"),
        ("properties:\n  lambda:", 2, "a property cannot be named 'lambda'"),
        ("properties:\n  __import__('os'):", 2, "a property cannot be named"),
        ("properties:\n  a:\n  a:", 3, "the key 'a' stands here a second time"),
        ("constants:\n  k: 5", 2, "the constant k must be a mapping"),
        ("constants:\n  k: {unit: m}", 2, "the constant k lacks the key 'value'"),
        ("constants:\n  k: {value: '5'}", 2, "value must be a number, not the text '5'"),
        ("constants:\n  k: {value: .nan}", 2, "value must be a finite number"),
        ("constants:\n  k: {value: 1, unit: {}}", 2, "unit must be a text"),
        ("constants:\n  pi: {value: 3}", 2, "a constant cannot be named 'pi'"),
        ("properties: {a: }\nconstants:\n  a: {value: 3}", 3, "the name 'a' stands for two things"),
        (PROPERTIES + "relations: []", 3, "relations must be a mapping"),
        (PROPERTIES + "relations:\n  r: a", 4, "the relation r must be a mapping"),
        (PROPERTIES + "relations:\n  r: {}", 4, "the relation r has no output"),
        (PROPERTIES + "relations:\n  r 1: {a: b}", 4, "the relation cannot be named 'r 1'"),
        (PROPERTIES + "relations:\n  r:\n    d: b", 5, "yields 'd', which is not in 'properties'"),
        (PROPERTIES + "relations:\n  r:\n    k: b", 5, "yields 'k', which is a constant"),
        (
            PROPERTIES + "relations:\n  r:\n    a: {function: b, error: 0}",
            5,
            "error must be above 0",
        ),
        (PROPERTIES + "relations:\n  r:\n    a: {function: b, error: x}", 5, "must be above 0"),
        *[
            (
                PROPERTIES + "relations:\n  r:\n    a:\n      function: b\n      error:\n" + keys,
                *told,
            )
            for keys, *told in [
                ("        bias: 1", 7, "error lacks the key 'rms'"),
                ("        rms: 0", 8, "error: rms must be above 0, not 0"),
                ("        rms: .nan", 8, "error: rms must be above 0, not .nan"),
                ("        rms: 1\n        bias: -2", 9, "bias must be at most rms, 1, not -2"),
                ("        rms: 1\n        p95: -1", 9, "error: p95 must be 0 or above, not -1"),
                ("        rms: 1\n        delay: -1", 9, "error: delay must be 0 or above"),
                (
                    "        rms: 1\n        baseline: 0",
                    9,
                    "error: baseline must be above 0, not 0",
                ),
                ("        rms: 1\n        n: 1.5", 9, "error: n must be a whole number from 1"),
                ("        rms: 1\n        n: 0", 9, "error: n must be a whole number from 1"),
                ("        rms: 1\n        source: [a]", 9, "error: source must be a text"),
                ("        rms: 1\n        mean: 2", 9, "error has no key 'mean'"),
            ]
        ],
        (PROPERTIES + "relations:\n  r:\n    a:", 5, "r for a: function must be a text, not empty"),
        (PROPERTIES + "relations:\n  r:\n    a: [b]", 5, "function must be a text, not a list"),
        (PROPERTIES + "relations:\n  r:\n    a: ''", 5, "the expression is empty"),
        (PROPERTIES + "relations:\n  r:\n    a: a + b", 5, "uses its own output 'a'"),
        (PROPERTIES + "relations:\n  r:\n    a: b + z", 5, "uses 'z', which is neither in"),
        (PROPERTIES + "relations:\n  r:\n    a: sine(b)", 5, "did you mean sin?"),
        (PROPERTIES + "relations:\n  r:\n    a: b.c", 5, "an attribute"),
        (PROPERTIES + "relations:\n  r:\n    a: b > 1", 5, "a condition stands where a number"),
        (
            PROPERTIES + "relations:\n  r:\n    a: __import__('os')",
            5,
            "is not part of the language",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a: {quality: 1}",
            5,
            "needs either the key 'function'",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a: {function: b, not_executable: b}",
            5,
            "needs either the key 'function' or 'not_executable'",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a: {function: b, inputs: [b]}",
            5,
            "the key 'inputs' belongs to 'not_executable' alone",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a: {not_executable: b}",
            5,
            "the key 'inputs' belongs to 'not_executable' alone",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a: {not_executable: f, inputs: [z]}",
            5,
            "uses 'z', which is neither",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a: {not_executable: f, inputs: b}",
            5,
            "inputs must be a list",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a:\n      function: b\n      quality: 0",
            7,
            "quality must be above 0 and at most 1, not 0",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a:\n      function: b\n      quality: 1.1",
            7,
            "quality must be above 0 and at most 1, not 1.1",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a:\n      function: b\n      quality: high",
            7,
            "quality must be above 0 and at most 1, not the text 'high'",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a:\n      function: b\n      constraint: c",
            7,
            "r for a: constraint: a number stands where a condition is needed",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a:\n      function: b\n      constraint: z > 1",
            5,
            "uses 'z', which is neither",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a:\n      function: b\n      constraint: a > 1",
            5,
            "uses its own output 'a'",
        ),
        (
            PROPERTIES + "relations:\n  r:\n    a:\n      function: b\n      qality: 1",
            7,
            "r for a has no key 'qality'; allowed: function, constraint",
        ),
    ],
)
def test_errors_name_file_line_and_what_is_allowed(
    tmp_path: pathlib.Path, text: str, line: int, what: str
) -> None:
    path = write(tmp_path, text)
    with pytest.raises(ModelError) as caught:
        read_ontology(path)
    assert caught.value.where == f"{path}:{line}"
    assert what in caught.value.what


def test_sections_may_be_missing_or_empty(tmp_path: pathlib.Path) -> None:
    assert read_ontology(write(tmp_path, "properties:\nconstants:\nrelations:\n")).functions == ()
    assert read_ontology(write(tmp_path, "properties: {a: }\n")).properties


def test_the_valid_part_is_kept_and_every_error_is_told(tmp_path: pathlib.Path) -> None:
    text = PROPERTIES + "relations:\n  r: {a: b, b: z}\n  s: {c: 'a +'}\n  t: {b: c, q: a}\n"
    ontology, errors = load_ontology(write(tmp_path, text))
    assert [(f.relation, f.output) for f in ontology.functions] == [("r", "a"), ("t", "b")]
    assert [error.where.rsplit(":")[-1] for error in errors] == ["4", "5", "6"]


def test_all_errors_are_raised_at_once(tmp_path: pathlib.Path) -> None:
    text = PROPERTIES + "relations:\n  r: {a: b, b: z}\n  s: {c: 'a +'}\nmore: 1\n"
    with pytest.raises(ModelErrors) as caught:
        read_ontology(write(tmp_path, text))
    assert [line.split(":")[1] for line in str(caught.value).splitlines()] == ["6", "4", "5"]


def test_a_percentage_is_a_unit_in_quotes(tmp_path: pathlib.Path) -> None:
    found = read_ontology(write(tmp_path, "properties: {a: {unit: '%'}}\n"))
    assert found.properties["a"].unit == "%"
    with pytest.raises(ModelError, match="put it in quotes: '%'"):
        read_ontology(write(tmp_path, "properties: {a: {unit: %}}\n"))


def test_quality_may_be_one_or_very_small(tmp_path: pathlib.Path) -> None:
    for quality in ("1", "1.0", "1e-9"):
        text = PROPERTIES + f"relations:\n  r:\n    a: {{function: b, quality: {quality}}}"
        assert read_ontology(write(tmp_path, text)).functions[0].quality == float(quality)


def test_the_quality_of_what_has_figures_is_theirs_unless_it_says_another(
    tmp_path: pathlib.Path,
) -> None:
    head = PROPERTIES + "relations:\n"
    figures = "{rms: 0.6, bias: -0.1, p95: 1.1, delay: 0.04, baseline: 2.4, n: 9, source: drive 1}"
    path = tmp_path / "o.yaml"
    path.write_text(
        f"{head}  one:\n    a: {{function: b, error: {figures}}}\n"
        f"  two:\n    a: {{function: b, quality: 0.5, error: {figures}}}\n"
        "  three:\n    a: {function: b, error: {rms: 0.6}}\n"
    )
    one, two, three = read_ontology(str(path)).functions
    assert one.error == two.error == Error(0.6, -0.1, 1.1, 0.04, 2.4, 9, "drive 1")
    assert (one.quality, two.quality) == (0.75, 0.5)
    assert (three.error, three.quality) == (Error(0.6), 1.0)


WHEELS = """\
properties: {left: , right: , speed: , turn: , radius: , odd: }
constants: {base: {value: 0.5}}
relations:
  kinematics:
    where:
      l: radius*left
      r: radius*right
      difference: r - l
    speed: (l + r)/2
    turn: {function: difference/base, quality: 0.9}
    odd: {function: 3*l, where: {l: 2*right}}
"""


def test_the_outputs_of_a_relation_share_values_on_the_way(tmp_path: pathlib.Path) -> None:
    ontology = read_ontology(write(tmp_path, WHEELS))
    speed, turn, odd = ontology.functions
    assert (speed.relation, speed.output, speed.text) == (
        *("kinematics", "speed"),
        "l = radius*left; r = radius*right; (l + r)/2",
    )
    assert turn.text == "l = radius*left; r = radius*right; difference = r - l; difference/base"
    assert turn.inputs == ("radius", "left", "right") and turn.quality == 0.9
    assert odd.text == "l = 2*right; 3*l"  # its own counts more


def test_one_relation_heals_all_values_of_a_service(tmp_path: pathlib.Path) -> None:
    ontology = read_ontology(write(tmp_path, WHEELS))
    pairs = [(name, f"/{name}", f"/{name}_node") for name in ("left", "right", "radius")]
    sources = [
        source
        for name, topic, node in pairs
        for source in Service(name, topic, "p/T", node, 0.1, (Provision(name, "data"),)).sources
    ]
    lost = Service(
        "odometry", "/odom", "p/T", "/drive", 0.1, (Provision("speed", "v"), Provision("turn", "w"))
    )
    plan = plan_service(ontology, lost, SourceTable(ontology.network, sources))
    assert plan.relations == ("kinematics",)
    program = compile_program(plan.program.code, 3, 2)
    values = {"left": 3.0, "right": 5.0, "radius": 0.1}
    found = program.step([values[source.property] for source in plan.inputs], 0.0)
    assert found == pytest.approx((0.4, 0.4))


@pytest.mark.parametrize(
    "old, new, line, what",
    [
        ("r: radius*right", "r: radius*", 7, "kinematics: where: r: not an expression"),
        ("difference: r - l", "difference: d - l", 10, "uses 'd', which is neither"),
        ("r: radius*right", "base: radius*right", 9, "uses 'r', which is neither"),
        ("difference: r - l", "speed: r - l", 10, "uses 'difference', which is neither"),
        ("    where:\n      l: radius*left\n", "    where: [l]\n    x:\n", 5, "must be a mapping"),
        ("difference: r - l", "l: r - l", 8, "stands here a second time"),
    ],
)
def test_what_is_wrong_with_them_is_named(
    tmp_path: pathlib.Path, old: str, new: str, line: int, what: str
) -> None:
    path = write(tmp_path, WHEELS.replace(old, new))
    with pytest.raises(ModelError) as caught:
        read_ontology(path)
    assert f"{path}:{line}: " in str(caught.value) and what in str(caught.value)


def test_a_property_may_be_called_where(tmp_path: pathlib.Path) -> None:
    text = "properties: {where: , a: }\nrelations: {r: {where: 2*a}}\n"
    (function,) = read_ontology(write(tmp_path, text)).functions
    assert (function.output, function.text) == ("where", "2*a")
