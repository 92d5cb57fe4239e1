"""The generator: exactly the paper's form, deterministic, everything computed once."""
import random
from typing import Optional

import pytest

from shsa_core.codegen.generator import generate, way, ways_of
from shsa_core.codegen.program import compile_program
from shsa_core.errors import GenerationError
from shsa_core.language.expression import parse_constraint, parse_law
from shsa_core.model.ontology import Constant, TransferFunction
from shsa_core.model.service import Provision, Service
from shsa_core.model.substitution import Program
from shsa_core.search.derivation import Derivation

CONSTANTS = {
    "wheel_base": Constant("wheel_base", 0.39, "m"),
    "offset": Constant("offset", -2.5),
    "n": Constant("n", 1000.0),
    "zero": Constant("zero", 0.0),
}


def source(name: str, topic: Optional[str] = None, field: str = "data") -> Derivation:
    topic = topic or "/" + name
    provides = (Provision(name, field),)
    own = Service(topic, topic, "std_msgs/Float64", "/node", 0.02, provides)
    return Derivation(name, own.sources[0], None)


def function(
    relation: str, output: str, text: str, constraint: Optional[str] = None
) -> TransferFunction:
    expression = parse_law(text)
    condition = parse_constraint(constraint) if constraint else None
    names = [*expression.names, *(condition.names if condition else ())]
    inputs = tuple(dict.fromkeys(name for name in names if name not in CONSTANTS))
    return TransferFunction(relation, output, inputs, expression, 1.0, condition, text)


def derive(transfer: TransferFunction, *inputs: Derivation) -> Derivation:
    return Derivation(transfer.output, None, transfer, tuple(inputs))


def test_relation_f1_of_the_paper() -> None:
    """With the terms of f1 whose coefficients are known; the published relation has more."""
    f1 = function(
        "f1",
        "battery_current",
        "48.67 - 0.03*abs(linear_velocity) - 1.17*abs(linear_acceleration)",
    )
    velocity = source("linear_velocity", "/odom", "twist.twist.linear.x")
    acceleration = source("linear_acceleration", "/drivetrain/accel", "accel.linear.x")
    program = generate([(derive(f1, velocity, acceleration), "/battery_current/data")], {})
    assert program == Program(
        inputs=("/odom/twist/twist/linear/x", "/drivetrain/accel/accel/linear/x"),
        code="t0=x[0]; t1=x[1];\n"
        "def _tf1(i1,i2): # f1: battery_current\n"
        "  return 48.67 - 0.03*abs(i1) - 1.17*abs(i2)\n"
        "t2=_tf1(t0,t1)\n"
        "y=t2\n",
        outputs=("/battery_current/data",),
    )
    step = compile_program(program.code, 2, 1).step
    assert step((-1.5, 0.5), 0.0) == pytest.approx((48.67 - 0.03 * 1.5 - 1.17 * 0.5,))


def test_a_value_is_passed_on() -> None:
    program = generate([(source("v"), "/other/data")], {})
    assert program == Program(("/v/data",), "t0=x[0];\ny=t0\n", ("/other/data",))


def test_constants_are_numbers_and_constraints_come_first() -> None:
    turn = function("turn", "w", "(r - l)/wheel_base + offset", constraint="r > offset and u > 0")
    program = generate([(derive(turn, source("r"), source("l"), source("u")), "/w")], CONSTANTS)
    assert program.code == (
        "t0=x[0]; t1=x[1]; t2=x[2];\n"
        "def _tf1(i1,i2,i3): # turn: w\n"
        "  require(i1 > (-2.5) and i3 > 0)\n"
        "  return (i1 - i2)/0.39 + (-2.5)\n"
        "t3=_tf1(t0,t1,t2)\n"
        "y=t3\n"
    )
    step = compile_program(program.code, 3, 1).step
    assert step((2.0, 1.0, 1.0), 0.0) == pytest.approx((1.0 / 0.39 - 2.5,))
    assert step((2.0, 1.0, 0.0), 0.0) is None


def test_several_outputs_share_their_inputs_and_relations() -> None:
    u, i = source("u"), source("i")
    power = derive(function("ohm", "p", "u*i"), u, i)
    again = derive(function("ohm", "p", "u*i"), u, i)
    half = derive(function("half", "h", "p/2"), power)
    total = derive(function("sum", "s", "p + h + u"), again, half, u)
    program = generate([(half, "/h/data"), (total, "/s/data"), (u, "/u2/data")], {})
    assert program.inputs == ("/u/data", "/i/data")
    assert program.outputs == ("/h/data", "/s/data", "/u2/data")
    assert program.code == (
        "t0=x[0]; t1=x[1];\n"
        "def _tf1(i1,i2): # ohm: p\n"
        "  return i1*i2\n"
        "t2=_tf1(t0,t1)\n"
        "def _tf2(i1): # half: h\n"
        "  return i1/2\n"
        "t3=_tf2(t2)\n"
        "def _tf3(i1,i2,i3): # sum: s\n"
        "  return i1 + i2 + i3\n"
        "t4=_tf3(t2,t3,t0)\n"
        "y=(t3,t4,t0)\n"
    )


def test_one_relation_used_on_different_inputs_is_written_twice() -> None:
    double = function("double", "d", "2*v")
    one, other = derive(double, source("v", "/a")), derive(double, source("v", "/b"))
    program = generate([(one, "/x"), (other, "/y")], {})
    assert program.code.count("def ") == 2
    assert program.inputs == ("/a/data", "/b/data")


def test_one_relation_in_two_directions_is_two_functions() -> None:
    forth = derive(function("r", "b", "a + 1"), source("a"))
    back = derive(function("r", "c", "a + 1"), source("a"))
    assert generate([(forth, "/b"), (back, "/c")], {}).code.count("def ") == 2


def test_inputs_follow_their_first_use() -> None:
    f = function("f", "z", "c + a + b")
    deep = derive(f, derive(function("g", "c", "d*2"), source("d")), source("a"), source("b"))
    assert generate([(deep, "/z")], {}).inputs == ("/d/data", "/a/data", "/b/data")


def test_a_relation_without_inputs_needs_no_input_line() -> None:
    fixed = Derivation("g", None, function("fixed", "g", "wheel_base*2 + zero"), ())
    program = generate([(fixed, "/g/data")], CONSTANTS)
    assert program.inputs == ()
    assert program.code == "def _tf1(): # fixed: g\n  return 0.39*2 + 0.0\nt0=_tf1()\ny=t0\n"
    assert compile_program(program.code, 0, 1).step((), 0.0) == (0.78,)


def test_a_relation_that_cannot_be_executed_is_refused_by_name() -> None:
    laser = TransferFunction("rdl", "dmin", ("laser",), None, text="min(laser)")
    with pytest.raises(GenerationError) as caught:
        generate([(derive(laser, source("laser")), "/dmin/data")], {})
    assert str(caught.value) == "the relation rdl for dmin cannot be executed: min(laser)"


def test_what_a_constant_makes_of_an_exponent_is_refused_by_name() -> None:
    steep = derive(function("steep", "z", "a**(n*1)"), source("a"))
    both = derive(function("sum", "y", "z + a"), steep, source("a"))
    with pytest.raises(GenerationError) as caught:
        generate([(both, "/y")], CONSTANTS)
    assert str(caught.value) == (
        "no code for the relations steep, sum: line 3: "
        "the exponent is 1000; at most 100 is allowed"
    )


def test_a_name_that_is_not_one_cannot_smuggle_code_in() -> None:
    for relation, output in (("r\nimport os\n#", "z"), ("r", "z\nimport os"), ("r'", "z")):
        evil = TransferFunction(relation, output, ("a",), parse_law("a"), text="a")
        with pytest.raises(GenerationError):
            generate([(derive(evil, source("a")), "/z")], {})


def test_the_same_derivation_gives_the_same_text() -> None:
    def build() -> Program:
        names = [f"p{i}" for i in range(6)]
        parts = [source(name) for name in names]
        inner = derive(function("sum", "s", " + ".join(names)), *parts)
        return generate([(derive(function("twice", "t", "2*s"), inner), "/t")], CONSTANTS)

    assert len({build() for _ in range(20)}) == 1


def test_a_program_tells_by_what_way_each_output_is_derived() -> None:
    double, triple = function("double", "b", "2*a"), function("triple", "b", "3*a")
    ways = [way(derive(each, source(a))) for each in (double, triple) for a in ("a", "z")]
    assert len({*ways, way(source("a"))}) == 5
    both = derive(double, source("a")), derive(triple, source("a"))
    program = generate([(each, f"/{i}/z") for i, each in enumerate(both)], {})
    assert ways_of(program) == (ways[0], ways[2])
    alone = generate([(derive(double, source("a", "/a")), "/other/z")], {})
    assert ways_of(alone) == (ways[0],), "whatever else is computed, and wherever it goes"
    fixed = generate([(derive(function("fixed", "b", "1")), "/b/z"), (source("a"), "/c/z")], {})
    assert ways_of(fixed)[1] == "/a/data"
    for other in ("", "y=t7", "t1=_tf1(t0)\ny=t1", "o = x[0]; return o"):
        assert not set(ways) & set(ways_of(Program(("/a/data",), other, ("/b/z",))))


def test_a_long_chain_and_a_wide_one() -> None:
    node = source("p0")
    for i in range(1, 500):
        node = derive(function(f"r{i}", f"p{i}", f"p{i - 1} + 1"), node)
    program = generate([(node, "/z")], {})
    assert compile_program(program.code, 1, 1).step((1.0,), 0.0) == (500.0,)
    for i in range(500, 3000):
        node = derive(function(f"r{i}", f"p{i}", f"p{i - 1} + 1"), node)
    with pytest.raises(GenerationError, match="at most"):
        generate([(node, "/z")], {})
    names = [f"p{i}" for i in range(50)]
    wide = derive(function("sum", "s", " + ".join(names)), *[source(name) for name in names])
    program = generate([(wide, "/s")], {})
    assert compile_program(program.code, 50, 1).step([1.0] * 50, 0.0) == (50.0,)


def test_a_ladder_of_shared_derivations_is_linear() -> None:
    """Each step uses the one before twice, in two relations: as a tree it has 2^60 leaves."""
    node = source("a")
    for i in range(60):
        left = derive(function(f"l{i}", "b", "a + 0"), node)
        right = derive(function(f"r{i}", "c", "a - 0"), node)
        node = derive(function(f"m{i}", "a", "(b + c)/2"), left, right)
    program = generate([(node, "/a/x")], {})
    assert program.code.count("def ") == 180 and ways_of(program) == (way(node),)
    assert compile_program(program.code, 1, 1).step((3.0,), 0.0) == (3.0,)


def test_random_trees_compute_what_their_expressions_say() -> None:
    choice = random.Random(7)
    for _ in range(200):
        inputs = [source(f"p{i}") for i in range(4)]
        values = {f"p{i}": choice.uniform(-9, 9) for i in range(4)}
        known = [(node, values[node.property]) for node in inputs]
        for i in range(choice.randrange(1, 8)):
            (one, x), (other, y) = choice.sample(known, 2)
            if one.property == other.property:
                continue
            sign, value = choice.choice([("+", x + y), ("-", x - y), ("*", x * y)])
            text = f"{one.property} {sign} {other.property}"
            known.append((derive(function(f"r{i}", f"q{i}", text), one, other), value))
        outputs = choice.sample(known, 2)
        program = generate([(node, f"/{i}/z") for i, (node, _) in enumerate(outputs)], {})
        step = compile_program(program.code, len(program.inputs), 2).step
        assert ways_of(program) == tuple(way(node) for node, _ in outputs)
        inputs_now = [values[path.split("/")[1]] for path in program.inputs]
        assert step(inputs_now, 0.0) == pytest.approx(tuple(value for _, value in outputs))
