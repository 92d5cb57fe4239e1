"""Values on the way: relations that name parts of their function under `where`."""
import pathlib
from typing import List, Tuple

import pytest

from shsa_core.analysis.check import function_errors
from shsa_core.codegen.plans import plan_service
from shsa_core.codegen.program import compile_program
from shsa_core.errors import ExpressionError, ModelError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.language.expression import Law, Expression, compose, parse_expression, parse_law
from shsa_core.language.syntax import MAX_STEPS
from shsa_core.model.ontology import Ontology
from shsa_core.search.derivation import SourceTable
from shsa_testing.models import source

HEAD = "properties: {v: {unit: m/s}, u: {unit: V}, i: {unit: A}}\nconstants: {k: {value: -0.1}}\n"
FILE = (
    HEAD
    + """relations:
  net:
    i:
      where:
        h1: tanh(0.3*v + k)     # one neuron
        h2: tanh(-0.7*u + 0.2*v)
        sum_: 1.2*h1 - 0.4*h2
      function: sum_ + 8.1
      constraint: u > 10
      quality: 0.9
"""
)


def read(tmp_path: pathlib.Path, text: str) -> Ontology:
    path = tmp_path / "o.yaml"
    path.write_text(text)
    return read_ontology(str(path))


def law_of(ontology: Ontology) -> Law:
    law = ontology.functions[0].law
    assert isinstance(law, Law)
    return law


def test_a_file_is_read(tmp_path: pathlib.Path) -> None:
    (function,) = read(tmp_path, FILE).functions
    assert function.inputs == ("v", "u")
    law = function.law
    assert isinstance(law, Law) and law.names == ("v", "k", "u")
    assert (
        function.text
        == law.text
        == ("h1 = tanh(0.3*v + k); h2 = tanh(-0.7*u + 0.2*v); sum_ = 1.2*h1 - 0.4*h2; sum_ + 8.1")
    )


def test_the_code_assigns_each_name_once(tmp_path: pathlib.Path) -> None:
    ontology = read(tmp_path, FILE)
    table = SourceTable(ontology.network, [source("v"), source("u")])
    program = plan_service(ontology, source("i").service, table).program
    assert program.code == (
        "t0=x[0]; t1=x[1];\n"
        "def _tf1(i1,i2): # net: i\n"
        "  require(i2 > 10)\n"
        "  h1=tanh(0.3*i1 + (-0.1))\n"
        "  h2=tanh(-0.7*i2 + 0.2*i1)\n"
        "  sum_=1.2*h1 - 0.4*h2\n"
        "  return sum_ + 8.1\n"
        "t2=_tf1(t0,t1)\n"
        "y=t2\n"
    )
    step = compile_program(program.code, 2, 1).step
    assert step((0.5, 12.0), 0.0) == pytest.approx((8.1 + 1.2 * 0.04995837 + 0.4,), abs=1e-6)
    assert step((0.5, 9.0), 0.0) is None


def test_its_text_is_read_as_the_same_law(tmp_path: pathlib.Path) -> None:
    law = law_of(read(tmp_path, FILE))
    assert parse_law(law.text) == law
    assert parse_law("h = 1 if a <= b else 2; h*2").names == ("a", "b")


@pytest.mark.parametrize(
    "where, function, line, what",
    [
        ("{h: tanh(w)}", "h", 5, "the relation r uses 'w', which is neither in 'properties' nor"),
        ("{h: tanh(i)}", "h", 5, "the relation r uses its own output 'i'"),
        ("{h: tanh(}", "h", 7, "r for i: where: h: not an expression"),
        (
            "{h: v.real}",
            "h",
            7,
            "r for i: where: h: an attribute (a.b) is not part of the language",
        ),
        ("{v: tanh(u)}", "v", 7, "r for i: 'v' under 'where' is the name of a property"),
        ("{k: tanh(u)}", "k", 7, "r for i: 'k' under 'where' is the name of a constant"),
        ("{tanh: u}", "u", 7, "r for i: a value under 'where' cannot be named 'tanh'"),
        ("{x: u}", "x", 7, "r for i: a value under 'where' cannot be named 'x'"),
        ("{y: u}", "y", 7, "r for i: a value under 'where' cannot be named 'y'"),
        ("{t0: u}", "t0", 7, "r for i: a value under 'where' cannot be named 't0'"),
        ("{i1: u}", "i1", 7, "r for i: a value under 'where' cannot be named 'i1'"),
        ("{require: u}", "require + v", 8, "r for i: function: 'require' is a function"),
        ("{dt: u}", "dt", 7, "r for i: a value under 'where' cannot be named 'dt'"),
        ("{sum: u}", "sum", 7, "r for i: a value under 'where' cannot be named 'sum'"),
        ("{__import__: u}", "u", 7, "r for i: a value under 'where' cannot be named '__import__'"),
        ("{lambda: u}", "u", 7, "r for i: a value under 'where' cannot be named 'lambda'"),
        ("{a b: u}", "u", 7, "r for i: a value under 'where' cannot be named 'a b'"),
        ("{h: u, g: v}", "h", 7, "r for i: g stands under 'where' and is not used"),
        ("{h: u, g: h}", "v", 7, "r for i: g stands under 'where' and is not used"),
        ("{h: g, g: v}", "h", 7, "r for i: h uses g, which has no value before it"),
        ("{h: h + v}", "h", 7, "r for i: h uses h, which has no value before it"),
        ("{h: v, h: u}", "h", 7, "the key 'h' stands here a second time"),
        ("{h: }", "h", 7, "r for i: where: h must be a text"),
        ("{h: {g: v}}", "h", 7, "r for i: where: h must be a text"),
        ("{}", "v", 7, "r for i: where has no entry"),
        ("tanh(v)", "v", 7, "r for i: where must be a mapping"),
        ("[v]", "v", 7, "r for i: where must be a mapping"),
    ],
)
def test_what_is_wrong_is_told(
    tmp_path: pathlib.Path, where: str, function: str, line: int, what: str
) -> None:
    text = f"relations:\n  r:\n    i:\n      # said here\n      where: {where}\n"
    with pytest.raises(ModelError) as caught:
        read(tmp_path, HEAD + text + f"      function: {function}\n")
    assert what in str(caught.value)
    assert caught.value.errors[0].where == f"{tmp_path}/o.yaml:{line}"


def test_where_needs_a_function_and_a_constraint_does_not_know_it(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ModelError, match="the key 'where' belongs to 'function' alone"):
        read(
            tmp_path,
            HEAD + "relations: {r: {i: {where: {h: v}, not_executable: a, inputs: [v]}}}",
        )
    with pytest.raises(ModelError, match="uses 'h', which is neither in 'properties'"):
        read(tmp_path, FILE.replace("u > 10", "h > 10"))


def steps(count: int, text: str = "v") -> List[Tuple[str, Expression]]:
    return [(f"h{k}", parse_expression(text)) for k in range(count)]


def test_how_much_there_may_be_is_limited() -> None:
    def composed(count: int, text: str = "v") -> Law:
        names = [f"h{k}" for k in range(count)]
        return compose(dict(steps(count, text)), parse_expression(" + ".join(names[:500])))

    assert len(composed(MAX_STEPS).steps) == MAX_STEPS
    for count in (MAX_STEPS + 1, 5000):
        with pytest.raises(ExpressionError, match=f"^'where' has {count} entries; 1 to 100"):
            composed(count)
    with pytest.raises(ExpressionError, match="^all expressions have .* at most 40000 are allowed"):
        composed(40, "v" * 1000)


def test_a_constant_that_makes_a_function_impossible_is_an_error(tmp_path: pathlib.Path) -> None:
    for text in ("delay(v, k)", "table(v, 0, 1, k, 2)", "delay(v, u)", "table(v, u, 1, 2, 3)"):
        ontology = read(tmp_path, FILE.replace("tanh(-0.7*u + 0.2*v)", text + " + u"))
        found = function_errors(ontology)
        assert any("no code for the relations net" in each.what for each in found), text


def test_functions_with_memory_hear_every_sample(tmp_path: pathlib.Path) -> None:
    """Also where the constraint is false, or another value on the way does not exist."""
    text = FILE.replace("tanh(0.3*v + k)", "delay(2*v, 0.1) + 0*k").replace(
        "tanh(-0.7*u + 0.2*v)", "1/v"
    )
    ontology = read(tmp_path, text.replace("sum_ + 8.1", "h1 + 0*sum_"))
    table = SourceTable(ontology.network, [source("v"), source("u")])
    program = plan_service(ontology, source("i").service, table).program
    step = compile_program(program.code, 2, 1).step
    assert step((1.0, 12.0), 0.0) == (2.0,)
    assert step((2.0, 12.0), 0.1) == (2.0,)
    assert step((0.0, 12.0), 0.2) is None  # 1/v
    assert step((4.0, 9.0), 0.3) is None  # the constraint
    assert step((5.0, 12.0), 0.4) == (8.0,)
