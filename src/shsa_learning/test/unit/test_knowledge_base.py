"""Knowledge bases of the predecessor library: what is taken over, and what is said of the rest."""
import json
import pathlib
from typing import Any, Callable, List

import pytest

from shsa_core.cli.main import main
from shsa_core.codegen.generator import generate
from shsa_core.errors import GenerationError, ModelError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.language.expression import Condition, parse_law
from shsa_core.model.service import Provision as Value, Service
from shsa_core.search.derivation import Derivation
from shsa_learning.init.knowledge_base import KnowledgeBase, Provision, read_knowledge_base
from shsa_learning.substitutes import find_substitute

Read = Callable[[str], KnowledgeBase]

BASE = """\
utils: ["helpers.py"]
relations:
  scan:
    dmin:
      in: [laser]
      fct: "min(laser)"
  steer:
    wheel_angle: {in: [steering_angle, gear, battery], fct: "steering_angle / gear", \
constraint: "steering_angle < 3"}
    steering_angle: {in: [wheel_angle, gear], fct: "9*wheel_angle"}
  self:
    dmin: {in: [dmin, laser], fct: "dmin"}
    gear: {in: [laser], fct: "laser"}
  guarded:
    dmin: {in: [battery], fct: "battery", constraint: "battery"}
  foreign:
    dmin: {in: [battery], fct: "battery + threshold"}
  empty:
    dmin: {in: [battery], fct: ""}
properties:
  type: {dmin: 0, scan: 1}
  description: {dmin: "distance"}
  provision:
    dmin: []
    laser: ["/scan"]
    battery: ["/battery", "/battery2"]
    gear: [2]
    fixed: [1.5]
  need: {dmin: ["/stop/dmin/data"], wheel_angle: 1, battery: true, laser: false}
  accuracy: {laser: 0.9}
  period: {battery: 0.5}
  utility: {steer: 1}
provision_properties:
  "/stop/dmin/data": {need: True, pubrate: 10}
  "/battery": {accuracy: 0.7}
"""


@pytest.fixture
def read(tmp_path: pathlib.Path) -> Read:
    def run(text: str) -> KnowledgeBase:
        path = tmp_path / "kb.yaml"
        path.write_text(text)
        return read_knowledge_base(str(path))

    return run


def notes(base: KnowledgeBase) -> List[str]:
    return [note.split("kb.yaml:")[1] for note in base.notes]


def test_the_ontology(read: Read) -> None:
    ontology = read(BASE).ontology
    assert {name: c.value for name, c in ontology.constants.items()} == {"gear": 2.0, "fixed": 1.5}
    names = {"dmin", "laser_min", "wheel_angle", "steering_angle", "battery"}
    assert set(ontology.properties) == names
    functions: Any = {(f.relation, f.output): f for f in ontology.functions}
    assert set(functions) == {
        ("scan", "dmin"),
        ("steer", "wheel_angle"),
        ("steer", "steering_angle"),
        ("guarded", "dmin"),
        ("foreign", "dmin"),
        ("empty", "dmin"),
    }
    steer = functions["steer", "wheel_angle"]
    assert steer.inputs == ("steering_angle",) and steer.quality == 1.0
    assert steer.law == parse_law("steering_angle / gear")
    assert steer.constraint == Condition("steering_angle < 3", ("steering_angle",))
    assert functions["steer", "steering_angle"].law.text == "9*wheel_angle"
    scan = functions["scan", "dmin"]
    assert (scan.text, scan.inputs) == ("laser_min", ("laser_min",))
    guarded = functions["guarded", "dmin"]
    assert (guarded.law, guarded.constraint) == (None, None)
    assert guarded.text == "battery if battery"
    assert functions["foreign", "dmin"].text == "battery + threshold"
    assert functions["empty", "dmin"].text == ""


def test_the_services(read: Read) -> None:
    assert read(BASE).provisions == (
        Provision("dmin", "/stop/dmin/data", True, 0.1, None),
        Provision("battery", "/battery", True, 0.5, 0.7),
        Provision("battery", "/battery2", True, 0.5, None),
        Provision("laser_min", "/scan", False, None, 0.9, "min"),
    )


def test_what_is_not_taken_over_is_said_with_its_line(read: Read) -> None:
    found = notes(read(BASE))
    assert found == [
        "1: the section 'utils' is not taken over; nothing in it is run",
        "4: scan for dmin is taken over as laser_min",
        "8: steer for wheel_angle does not use its input battery",
        "9: steer for steering_angle does not use its input gear",
        "11: self for dmin is left out: it uses its own output",
        "12: self for gear is left out: gear is a constant",
        "14: guarded for dmin cannot be executed: a number stands where a condition is needed; "
        "write a comparison such as 'a > 0'",
        "16: foreign for dmin cannot be executed: 'threshold' is not among its inputs",
        "18: empty for dmin cannot be executed: the expression is empty",
        "28: wheel_angle is needed, but no topic is named",
        "31: the table 'utility' is not taken over",
    ]


def test_constants_of_every_form(read: Read) -> None:
    base = read(
        "relations: {r: {a: {in: [b, c, d, e], fct: 'b + c + d'}}}\n"
        "properties:\n"
        "  provision: {b: [3], d: [4, 5]}\n"
        "  constant: {b: true, c: 0.5, e: ['/pose'], d: true}\n"
    )
    assert {name: c.value for name, c in base.ontology.constants.items()} == {"b": 3.0, "c": 0.5}
    assert set(base.ontology.properties) == {"a", "d", "e"}
    assert "4: e is marked constant but has no number; it is a property" in notes(base)
    assert "4: d is marked constant but has no number; it is a property" in notes(base)


def test_provided_without_a_topic(read: Read) -> None:
    base = read(
        "relations: {r: {a: {in: [b], fct: ''}}}\n"
        "properties:\n  provided: {a: False, b: True, c: 1, d: 0}\n"
    )
    assert set(base.ontology.properties) == {"a", "b", "c", "d"}
    assert notes(base)[1:] == [
        "3: b is provided, but by no topic that is named",
        "3: c is provided, but by no topic that is named",
    ]


def test_the_form_without_functions(read: Read) -> None:
    base = read(
        "graph:\n  t1: [root, other]\n  r1: [t1]\n  r2: [t1, t2]\n  t2: [root]\n"
        "properties:\n  type: {root: 0, t1: 1, t2: 1, r1: 0, r2: 0, other: 0}\n"
    )
    assert [(f.relation, f.output, f.inputs) for f in base.ontology.functions] == [
        ("t1", "root", ("r1", "r2")),
        ("t1", "other", ("r1", "r2")),
        ("t2", "root", ("r2",)),
    ]
    assert all(f.law is None for f in base.ontology.functions)


def test_a_relation_without_a_function_entry(read: Read) -> None:
    assert read("relations: {r: {a: {in: [b]}}}").ontology.functions[0].text == ""


def test_tables_may_be_empty(read: Read) -> None:
    base = read("relations: {r: {a: {in: [b], fct: b}}}\nproperties:\n  provision:\n  need:\n")
    assert base.provisions == () and base.notes == ()
    text = "relations: {}\nproperties: {provision: {a: [/x]}}\nprovision_properties: {/x: }\n"
    assert read(text).provisions == (Provision("a", "/x"),)


@pytest.mark.parametrize(
    "text, line, what",
    [
        ("", 1, "a knowledge base must be a mapping"),
        ("properties: {}", 1, "a knowledge base has the key 'relations' (or 'graph')"),
        ("relations: 5", 1, "relations must be a mapping"),
        ("relations:\n  r: 5", 2, "the relation r must be a mapping"),
        ("relations:\n  r:\n    a: b", 3, "r for a must be a mapping"),
        ("relations:\n  r:\n    a: {fct: b}", 3, "r for a lacks the key 'in'"),
        ("relations:\n  r:\n    a: {in: b, fct: b}", 3, "in must be a list"),
        ("relations:\n  r:\n    a: {in: [[b]], fct: b}", 3, "an input must be a text"),
        ("relations:\n  r:\n    a: {in: [b], function: b}", 3, "r for a has no key 'function'"),
        ("relations:\n  r-1:\n    a: {in: [b], fct: b}", 2, "'r-1' cannot be a name here"),
        ("relations:\n  r:\n    a b: {in: [b], fct: b}", 3, "'a b' cannot be a name here"),
        ("relations:\n  r:\n    a: {in: [b/c], fct: b}", 3, "'b/c' cannot be a name here"),
        ("relations: {}\nproperties: []", 2, "properties must be a mapping"),
        ("relations: {}\nproperties: {need: 5}", 2, "need must be a mapping"),
        ("relations: {}\nproperties:\n  provision: {a b: []}", 3, "'a b' cannot be a name"),
        ("relations: {}\nproperties:\n  constant: {a b: 1}", 3, "'a b' cannot be a name"),
        ("relations: !!python/dict {}", 1, "tags are not allowed"),
        ("graph: {a: [b]}\nproperties: {type: {a: 0, b: 0}}", 1, "one of them must have the type"),
        ("graph: {a: [b]}\nproperties: {type: {a: 1, b: 1}}", 1, "one of them must have the type"),
        (
            "graph: {a: b}\nproperties: {type: {a: 1, b: 0}}",
            1,
            "the successors of a must be a list",
        ),
        ("graph: {a 1: [b]}\nproperties: {type: {a 1: 1, b: 0}}", 1, "'a 1' cannot be a name"),
    ],
)
def test_errors_name_file_and_line(read: Read, text: str, line: int, what: str) -> None:
    with pytest.raises(ModelError) as caught:
        read(text)
    assert caught.value.where.endswith(f"kb.yaml:{line}")
    assert what in caught.value.what


def test_what_cannot_be_executed_is_found_by_the_search_and_refused_by_name(read: Read) -> None:
    ontology = read("relations: {scan: {dmin: {in: [laser], fct: map(laser)}}}").ontology
    laser = Service("laser", "/scan", "p/T", "/hokuyo", 0.1, (Value("laser", "data"),))
    derivation: Derivation = find_substitute(ontology, laser.sources, "dmin").derivation
    with pytest.raises(GenerationError, match="the relation scan for dmin cannot be executed"):
        generate([(derivation, "/dmin/data")], ontology.constants)


def test_the_command_line(tmp_path: pathlib.Path, capsys: Any) -> None:
    base, ontology, som = (str(tmp_path / name) for name in ("kb.yaml", "o.yaml", "s.yaml"))
    with open(base, "w") as stream:
        stream.write(BASE)
    assert main(["import", base, "--ontology", ontology, "--som", som]) == 0
    printed = capsys.readouterr().out
    assert f"{base}:4: scan for dmin is taken over as laser_min" in printed
    assert f"{ontology}: 5 properties, 2 constants, 6 functions" in printed
    assert (
        f"{som}: 4 services with blanks; fill them in, then: shsa check {ontology} --som {som}"
        in printed
    )
    assert read_ontology(ontology) == read_knowledge_base(base).ontology
    with open(som) as stream:
        draft = stream.read()
    assert (
        '  laser_min:\n    topic: "/scan"\n    type:\n    node:\n    period:\n    provides:\n'
        "      laser_min: {field: min(), quality: 0.9}\n"
    ) in draft
    assert '    topic: "/stop/dmin/data"\n' in draft
    assert "    period: 0.1\n    needed: true\n" in draft
    assert "  battery:\n" in draft and "  battery_2:\n" in draft
    with pytest.raises(ModelError, match="type must be written like std_msgs/Float64, not empty"):
        read_som(som)
    filled = draft.replace("type:\n", "type: p/T\n").replace("node:\n", "node: /n\n")
    filled = (
        filled.replace("period:\n", "period: 1\n")
        .replace("field: ", "field: a")
        .replace("min()", "")
    )
    with open(som, "w") as stream:
        stream.write(filled)
    assert len(read_som(som)) == 4

    assert main(["import", base, "--ontology", ontology]) == 2
    assert "is there already; give the name of a new file" in capsys.readouterr().err
    fresh = str(tmp_path / "fresh.yaml")
    assert main(["import", base, "--ontology", fresh, "--som", som]) == 2
    capsys.readouterr()
    assert main(["import", base, "--ontology", fresh, "--json"]) == 0
    report = json.loads(capsys.readouterr().out)
    assert report["ontology"] == fresh and report["som"] is None and len(report["notes"]) == 11
    assert main(["import", base, "--ontology", str(tmp_path / "more.yaml")]) == 0
    assert capsys.readouterr().out.endswith("6 functions\n")


@pytest.mark.parametrize(
    "text, condition, law, constraint",
    [
        ("arctan(b/c)", "", "atan(b/c)", None),
        ("math.arcsin(b) + np.arccos(c)", "", "asin(b) + acos(c)", None),
        ("arctan2(b, c)", "True", "atan2(b, c)", None),
        ("b^2/c", "a > 0", "b**2/c", "(b**2/c) > 0"),
        ("integral ( b dt )", "", "integral(b)", None),
        ("integral(b dt) + c", "c > 0 and a < 3", "integral(b) + c", None),
        ("d b / dt", "a < b", "derivative(b)", "(derivative(b)) < b"),
        ("1 - int(b > c)", "", "1 - (1 if b > c else 0)", None),
        ("max(b)", "a > 0", "b_max", "(b_max) > 0"),
        ("min(b) + average(c)", "", "b_min + c_mean", None),
        ("min(b, c)", "", "min(b, c)", None),
        ("min(b) + b", "", "b_min + b", None),
    ],
)
def test_what_is_written_otherwise_is_translated(
    read: Read, text: str, condition: str, law: str, constraint: Any
) -> None:
    rest = f", constraint: '{condition}'" if condition else ""
    base = read(f"relations: {{r: {{a: {{in: [b, c], fct: '{text}'{rest}}}}}}}")
    (function,) = base.ontology.functions
    if condition == "c > 0 and a < 3":  # the integral would miss samples
        assert function.law is None and "would miss samples" in base.notes[0]
        return
    assert function.law is not None and function.law.text == law
    assert (function.constraint.text if function.constraint else None) == constraint
    assert any(f"is taken over as {law}" in note for note in base.notes) == (law != text)


def test_numbers_of_arrays_do_not_take_the_name_of_something_else(read: Read) -> None:
    base = read("relations: {r: {a: {in: [b, b_min], fct: 'min(b) + b_min'}}}")
    assert base.ontology.functions[0].law is None
    assert "b_min is the name of something else" in base.notes[0]


ROVER = """\
relations:
  near_scan: {gap: {in: [scan], fct: "min(scan)"}}
  near_echo: {gap: {in: [echo], fct: "min(echo)"}}
  near_touch: {gap: {in: [touch], fct: "all(touch) * FAR"}}
  near_plan: {gap: {in: [place, plan], fct: "plan(place)"}}
  pace: {rate: {in: [place], fct: "d place / dt"}}
properties:
  provision: {gap: [], scan: [], echo: ["/echo/ranges"], touch: ["/touch"], place: ["/pose/x"]}
  need: {gap: ["/stop/gap/data"]}
  accuracy: {echo: 0.8, place: 0.7}
  period: {gap: 0.1}
provision_properties:
  "/stop/gap/data": {need: True, pubrate: 10}
  "/echo/ranges": {accuracy: 0.8}
"""


def test_a_robot_of_arrays_heals_its_one_needed_property(
    tmp_path: pathlib.Path, capsys: Any
) -> None:
    base, ontology, som = (str(tmp_path / name) for name in ("kb.yaml", "o.yaml", "s.yaml"))
    (tmp_path / "kb.yaml").write_text(ROVER)
    assert main(["import", base, "--ontology", ontology, "--som", som]) == 0
    draft = (tmp_path / "s.yaml").read_text()
    for words, filled in (
        ("type:\n", "type: p/T\n"),
        ("period:\n", "period: 0.1\n"),
        ('"/echo/ranges"', "/echo"),
        ('"/stop/gap/data"', "/stop/gap"),
        ("field: min()", "field: nearest"),
        ("field: ,", "field: data,"),
        ("field: }", "field: data}"),
    ):
        draft = draft.replace(words, filled)
    lines = draft.splitlines()
    for number, line in enumerate(lines):
        if line == "    node:":
            lines[number] = f"    node: /node{number}"
    (tmp_path / "s.yaml").write_text("\n".join(lines) + "\n")
    capsys.readouterr()
    assert main(["find", "gap", "--ontology", ontology, "--som", som]) == 0
    assert "gap: quality 0.8 by near_echo from /echo/nearest" in capsys.readouterr().out
