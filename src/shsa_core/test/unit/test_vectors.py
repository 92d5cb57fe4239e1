"""Vectors: properties of several elements, in both files, and the functions of them."""
import pathlib
from typing import Any, Callable, List, Tuple

import pytest

from shsa_core.analysis.check import name_errors
from shsa_core.cli.main import main
from shsa_core.codegen.plans import plan_service
from shsa_core.codegen.program import compile_program
from shsa_core.errors import ModelError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som, read_tree, som_parameters
from shsa_core.files.document import from_parameters
from shsa_core.model.ontology import Ontology
from shsa_core.model.som import Som
from shsa_core.search.derivation import SourceTable

HEAD = """properties:
  linear: {unit: m/s}
  angular: {unit: rad/s}
  motion: {elements: [linear, angular]}
  wheels: {length: 2, unit: rad/s}
  ranges: {length: 3, unit: m, symbol: d}
  nearest: {unit: m}
  long: {length: 1000}
constants:
  jacobian: {value: [[0.05, 0.05], [-0.25, 0.25]]}
  mounted: {value: [1, 2, 3]}
relations:
"""
ONTOLOGY = (
    HEAD
    + """  kinematics:
    motion: dot(jacobian, wheels)
    wheels: [(linear - 0.2*angular)/0.1, (linear + 0.2*angular)/0.1]
  ahead: {nearest: min(ranges)}
"""
)
SERVICE = (
    "  {0}: {{topic: /{0}, type: sensor_msgs/JointState, node: /{0}, period: 0.1, provides: {1}}}"
)
SOM = "services:\n" + "\n".join(
    [
        SERVICE.format("drive", "{wheels: {field: 'velocity[0:2]', range: [-30, 30]}}"),
        SERVICE.format("odom", "{linear: {field: 'effort[0]'}, angular: {field: 'effort[1]'}}"),
    ]
)


def models(tmp_path: pathlib.Path, ontology: str, som: str = SOM) -> Tuple[Ontology, Som]:
    (tmp_path / "o.yaml").write_text(ontology)
    (tmp_path / "s.yaml").write_text(som)
    return read_ontology(str(tmp_path / "o.yaml")), read_som(str(tmp_path / "s.yaml"))


def relation(tmp_path: pathlib.Path, text: str) -> List[str]:
    """Return the functions of a relation, each as `output: text`."""
    functions = models(tmp_path, HEAD + f"  r: {text}\n")[0].functions
    return [f"{each.output}: {each.text}" for each in functions]


def computed(ontology: Ontology, som: Som, service: str, *x: float) -> Any:
    table = SourceTable(ontology.network, som.sources)
    program = plan_service(ontology, som.services[service], table).program
    return compile_program(program.code, len(program.inputs), len(program.outputs)).step(x, 0.0)


def test_a_vector_in_both_files_is_computed_as_a_whole(tmp_path: pathlib.Path) -> None:
    ontology, som = models(tmp_path, ONTOLOGY)
    assert som.services["drive"].properties == ("wheels_0", "wheels_1")
    assert [each.field for each in som.services["drive"].provides] == ["velocity[0]", "velocity[1]"]
    assert computed(ontology, som, "drive", 0.6, 0.5) == pytest.approx((5.0, 7.0))
    assert computed(ontology, som, "odom", 5.0, 7.0) == pytest.approx((0.6, 0.5))


def test_check_and_find_know_it(tmp_path: pathlib.Path, capsys: Any) -> None:
    models(tmp_path, ONTOLOGY)
    files = ["--ontology", str(tmp_path / "o.yaml"), "--som", str(tmp_path / "s.yaml")]
    assert main(["check", files[1], "--som", files[3]]) == 0
    assert main(["find", "drive", *files]) == 0
    said = capsys.readouterr().out
    assert "inputs  /odom/effort[0],/odom/effort[1]" in said
    assert "output  /drive/velocity[0],/drive/velocity[1]" in said


def check_told(read: Callable[[], object], what: str, where: str) -> None:
    with pytest.raises(ModelError) as caught:
        read()
    assert what in str(caught.value)
    assert {each.where for each in caught.value.errors} == {where}


@pytest.mark.parametrize(
    "text, functions",
    [
        ("{ranges: mounted*nearest + 1}", ["mounted_0*nearest + 1", "mounted_1*nearest + 1"]),
        ("{ranges: 'min(mounted, 2)'}", ["min(mounted_0, 2)", "min(mounted_1, 2)"]),
        ("{ranges: nearest}", ["nearest", "nearest", "nearest"]),
        ("{nearest: max(ranges) - min(ranges)}", ["max(ranges_0, ranges_1, ranges_2) - min("]),
        ("{nearest: '2*(dot(mounted, ranges))'}", ["2*(dot(mounted_0, ranges_0, mounted_1, "]),
        ("{linear: 'dot(2, angular)'}", ["dot(2, angular)"]),
        ("{motion: 'dot(2, wheels)'}", ["dot(2, wheels_0)", "dot(2, wheels_1)"]),
        ("{linear: wheels_0 if wheels_1 > 0 else 0}", ["wheels_0 if wheels_1 > 0 else 0"]),
        ("{wheels: [linear, 'dot(mounted, ranges)']}", ["linear", "dot(mounted_0, ranges_0, "]),
        (
            "{where: {k: 3*mounted}, ranges: {where: {near: 1}, function: k*near}}",
            ["k = 3*mounted_0; near = 1; k*near", "k = 3*mounted_1; near = 1; k*near"],
        ),
        ("{motion: {function: wheels, constraint: wheels > 0}}", ["wheels_0", "wheels_1"]),
    ],
)
def test_functions_are_taken_element_by_element(
    tmp_path: pathlib.Path, text: str, functions: List[str]
) -> None:
    found = [each.partition(": ")[2] for each in relation(tmp_path, text)]
    assert [each[: len(text)] for each, text in zip(found, functions)] == functions


def test_what_each_element_has_is_that_of_the_vector(tmp_path: pathlib.Path) -> None:
    text = "{motion: {function: wheels, constraint: ['wheels_0 > 1', 'linear < 2'], quality: 0.5}}"
    text = text.replace("linear", "ranges_0")
    first, second = models(tmp_path, HEAD + f"  r: {text}\n")[0].functions
    assert first.constraint is not None and first.constraint.text == "wheels_0 > 1"
    assert second.constraint is not None and second.constraint.text == "ranges_0 < 2"
    assert (first.quality, second.quality) == (0.5, 0.5)
    ontology, som = models(tmp_path, ONTOLOGY)
    assert [ontology.properties[f"ranges_{i}"].symbol for i in range(3)] == ["d"] * 3
    assert [each.range for each in som.services["drive"].provides] == [(-30.0, 30.0)] * 2
    again, errors = read_tree(from_parameters(som_parameters(som), "shsa/som"))
    assert (errors, again) == ([], som)


def test_what_is_said_of_an_element_itself_counts(tmp_path: pathlib.Path) -> None:
    for text in ("{a: {length: 2, unit: m}, a_1: {unit: s}}", "{a_1: {unit: s}, a: {length: 2}}"):
        properties = models(tmp_path, f"properties: {text}")[0].properties
        assert sorted(properties) == ["a_0", "a_1"] and properties["a_1"].unit == "s"


def test_fields_of_elements_may_be_named(tmp_path: pathlib.Path) -> None:
    fields = "['velocity[name=left]', 'velocity[name=right]']"
    som = models(tmp_path, ONTOLOGY, SOM.replace("'velocity[0:2]'", fields))[1]
    assert [each.field for each in som.services["drive"].provides] == [
        "velocity[name=left]",
        "velocity[name=right]",
    ]
    som = models(tmp_path, ONTOLOGY, SOM.replace("velocity[0:2]", "poses[1:3].x"))[1]
    assert [each.field for each in som.services["drive"].provides] == ["poses[1].x", "poses[2].x"]


@pytest.mark.parametrize(
    "text, what",
    [
        ("{motion: 'dot(jacobian, ranges)'}", "r for motion: function: dot(...) of 2 and 3 elem"),
        ("{motion: 'dot(jacobian, linear)'}", "a matrix can be used in dot(MATRIX, VECTOR) alone"),
        ("{motion: 2*jacobian}", "a matrix can be used in dot(MATRIX, VECTOR) alone"),
        ("{motion: 'dot(wheels, jacobian)'}", "a matrix can be used in dot(MATRIX, VECTOR) alone"),
        ("{motion: min(jacobian)}", "a matrix can be used in dot(MATRIX, VECTOR) alone"),
        ("{linear: 'dot(jacobian, wheels)'}", "a vector of 2 stands where a number is computed"),
        ("{ranges: 'dot(jacobian, wheels)'}", "a vector of 2 stands where a vector of 3 is comp"),
        ("{ranges: mounted*wheels}", "a vector of 2 stands where a vector of 3 is computed"),
        ("{ranges: [1, 2]}", "r for ranges: function must have 3 items, not 2"),
        ("{ranges: []}", "r for ranges: function must have 3 items, not 0"),
        ("{ranges: [[1], 2, 3]}", "function must be a text, not a list"),
        ("{ranges: [wheels, 2, 3]}", "a vector of 2 stands where a vector of 3 is computed"),
        ("{nearest: ranges}", "a vector of 3 stands where a number is computed"),
        ("{nearest: 'ranges[0]'}", "character '[' at position 7 is not part of the language"),
        ("{nearest: ranges()}", "a vector of 3 stands where a number is computed"),
        ("{nearest: min(linear)}", "min(...) takes 2 or more arguments, not 1"),
        ("{ranges: 2*ranges}", "the relation r uses its own output 'ranges_0'"),
        ("{nearest: ranges_3}", "uses 'ranges_3', which is neither in"),
        ("{jacobian: 1}", "the relation r yields '"),
        ("{mounted: ranges}", "the relation r yields 'mounted_0', which is a constant"),
        ("{nearest: {function: 1, constraint: ranges > 1}}", "a vector of 3 stands where a number"),
        ("{where: {linear: 1}, nearest: linear}", "'linear' under 'where' is the name of a prop"),
        ("{where: {wheels: 1}, nearest: wheels}", "a vector of 2 stands where a number is"),
        ("{nearest: " + " + ".join(["min(long)"] * 100) + "}", "it has more than 40000 characters"),
    ],
)
def test_what_is_wrong_is_told_with_its_line(tmp_path: pathlib.Path, text: str, what: str) -> None:
    check_told(lambda: relation(tmp_path, text), what, f"{tmp_path}/o.yaml:13")


@pytest.mark.parametrize(
    "text, what",
    [
        ("properties: {a: {length: 0}}", "length must be a whole number from 1 to 1000, not 0"),
        ("properties: {a: {length: 1e9}}", "length must be a whole number from 1 to 1000"),
        ("properties: {a: {length: 2.5}}", "length must be a whole number"),
        ("{properties: {a_1: }, constants: {a: {value: [1, 2]}}}", "'a_1' stands for two things"),
        ("{properties: {a: {length: 2}}, constants: {a: {value: 1}}}", "'a' stands for two things"),
        ("properties: {a_1: {length: 2}, a: {length: 2}}", "'a_1' stands for two things"),
        ("properties: {a: {elements: [b], unit: m}, b: }", "has elements, at least one, or other"),
        ("properties: {a: {elements: []}}", "has elements, at least one, or other keys"),
        ("constants: {a: {value: []}}", "must have 1 to 1000 numbers, or rows of the same"),
        ("constants: {a: {value: [[1, 2], [3]]}}", "numbers, or rows of the same length"),
        ("constants: {a: {value: [[1, 2], 3]}}", "numbers, or rows of the same length"),
        ("constants: {a: {value: [[[1]]]}}", "must be a number, not a list"),
        ("constants: {a: {value: [1, x]}}", "an element of value must be a number, not the text"),
        ("constants: {a_1: {value: 3}, a: {value: [1, 2]}}", "the constant a_1 is there already"),
        ("constants: {a: {value: [1, 2]}, a_1: {value: 3}}", "the constant a_1 is there already"),
        (
            "{properties: {a: {length: 2}, b: }, relations: {r: {a: '[b, b]', a_0: b}}}",
            "r for a_0 yields what the relation yields already",
        ),
        ("constants: {a: {value: [.nan]}}", "an element of value must be a finite number"),
        (
            "properties: {" + ", ".join(f"a{i}: {{length: 1000}}" for i in range(11)) + "}",
            "all vectors have more than 10000 elements together",
        ),
        (
            "constants: {a: {value: [" + ", ".join(["[" + "1, " * 999 + "1]"] * 11) + "]}}",
            "all vectors have more than 10000 elements together",
        ),
    ],
)
def test_what_is_wrong_with_a_vector_is_told(tmp_path: pathlib.Path, text: str, what: str) -> None:
    check_told(lambda: models(tmp_path, text), what, f"{tmp_path}/o.yaml:1")


@pytest.mark.parametrize(
    "field, what",
    [
        ("'velocity[2:2]'", "field must have 1 to 1000 elements"),
        ("'velocity[3:2]'", "field must have 1 to 1000 elements"),
        ("'velocity[0:999999]'", "field must have 1 to 1000 elements"),
        ("'velocity[0:]'", "a slice stands at the end of min, max, mean, count alone"),
        ("'min(velocity[0:2])[0:2]'", "is not a field"),
        ("[]", "field must have 1 to 1000 elements, not a list"),
        ("[velocity, 'a b']", "field: 'a b' is not a field"),
        ("[velocity, {a: b}]", "field must be a text, not a mapping"),
        ("['effort[0]', 'effort[0]']", "the field effort[0] provides wheels_0 already"),
        ("'velocity[0:2]'}, wheels_1: {field: effort", "wheels_1 is provided already"),
    ],
)
def test_what_is_wrong_with_fields_is_told(tmp_path: pathlib.Path, field: str, what: str) -> None:
    with pytest.raises(ModelError) as caught:
        models(tmp_path, ONTOLOGY, SOM.replace("'velocity[0:2]'", field))
    assert what in str(caught.value)
    assert {each.where for each in caught.value.errors} == {f"{tmp_path}/s.yaml:2"}


def test_a_slice_that_is_too_long_for_the_vector_is_found(tmp_path: pathlib.Path) -> None:
    (error,) = name_errors(*models(tmp_path, ONTOLOGY, SOM.replace("0:2", "0:3")))
    assert error.what == "drive provides 'wheels_2', which is not in the ontology"
