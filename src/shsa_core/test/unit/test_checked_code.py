"""A substitute's code is read anew: what the generator could not have written is refused."""
import random
import re

import audit
import pytest
from shsa_testing.expressions import Sample, samples
from hostile_expressions import EXPRESSIONS
from hostile_programs import PROGRAMS
from hypothesis import given, settings, strategies as st

from shsa_core.codegen.checked_code import (
    MAX_CODE,
    MAX_DELAYS,
    MAX_RELATIONS,
    MAX_STEPS,
    check_code,
)
from shsa_core.codegen.program import compile_program
from shsa_core.errors import CodeError
from shsa_core.language.syntax import _LANGUAGE
from shsa_testing.thorough import many

NOT_IN_LANGUAGE = "is not part of the language; allowed: " + _LANGUAGE
GOOD = (
    "t0=x[0]; t1=x[1];\n"
    "def _tf1(i1,i2): # ohm: p\n"
    "  require(i1 > 0)\n"
    "  return i1*i2\n"
    "t2=_tf1(t0,t1)\n"
    "def _tf2(i1,i2): # sum: s\n"
    "  return i1 + derivative(i2)\n"
    "t3=_tf2(t2,t0)\n"
    "y=(t2,t3)\n"
)


@pytest.mark.parametrize("code", PROGRAMS, ids=lambda code: ascii(code)[:40])
def test_hostile_code_is_refused_and_nothing_runs(code: str) -> None:
    for n_inputs in (0, 1, 2):
        with audit.recorded() as events:
            with pytest.raises(CodeError) as caught:
                compile_program(code, n_inputs, 1)
        assert set(events) <= {"compile"}
        assert str(caught.value)


@pytest.mark.parametrize(
    "text", [t for ts in EXPRESSIONS.values() for t in ts], ids=lambda text: ascii(text)[:40]
)
def test_hostile_expression_in_code_is_refused(text: str) -> None:
    code = f"t0=x[0];\ndef _tf1(i1):\n  return i1*0 + ({text})\nt1=_tf1(t0)\ny=t1\n"
    with audit.recorded() as events:
        with pytest.raises(CodeError):
            compile_program(code, 1, 1)
    assert set(events) <= {"compile"}


def test_what_the_generator_writes_is_read() -> None:
    checked = check_code(GOOD, 2, 2)
    assert checked.n_inputs == 2
    assert checked.outputs == ("t2", "t3")
    assert [r.result for r in checked.relations] == ["t2", "t3"]
    assert [dict(r.arguments) for r in checked.relations] == [
        {"i1": "t0", "i2": "t1"},
        {"i1": "t2", "i2": "t0"},
    ]
    assert checked.relations[0].constraint is not None
    assert checked.relations[1].constraint is None


@pytest.mark.parametrize("n_inputs, n_outputs", [(1, 2), (3, 2), (2, 1), (2, 3), (0, 2), (2, 0)])
def test_the_number_of_inputs_and_outputs_must_fit(n_inputs: int, n_outputs: int) -> None:
    with pytest.raises(CodeError):
        check_code(GOOD, n_inputs, n_outputs)


@pytest.mark.parametrize(
    "old, new, message",
    [
        ("t1=x[1]", "t1=x[0]", "line 1: 't1=x[1]' is due here"),
        ("t1=x[1]", "t2=x[1]", "line 1: 't1=x[1]' is due here"),
        ("_tf1(i1,i2): # ohm", "_tf3(i1,i2): # ohm", "line 2: 'def _tf1(i1,i2,...)' is due here"),
        ("require(i1 > 0)", "ensure(i1 > 0)", "line 3: 'require(condition)' is due here"),
        (
            "require(i1 > 0)",
            "require(i1)",
            "line 3: a number stands where a condition is needed; "
            "write a comparison such as 'a > 0'",
        ),
        (
            "return i1*i2",
            "return i1*i1",
            "line 2: _tf1 does not use i2",
        ),
        ("return i1*i2", "return i1*i2*i3", "line 4: i3 has no value here"),
        ("return i1*i2", "o=i1*i2; return i1", "line 2: _tf1 does not use o"),
        ("return i1*i2", "o=i1*p; return o*i2", "line 4: p has no value here"),
        ("return i1*i2", "o=p*i2; p=i1; return o*p", "line 4: p has no value here"),
        ("return i1*i2", "o=i1; o=o*i2; return o", "line 4: o has a value already"),
        ("return i1*i2", "i2=i1; return i2", "line 4: i2 has a value already"),
        (
            "return i1*i2",
            "t9=i1; return t9*i2",
            "line 4: t9 may not be assigned; take another name",
        ),
        ("return i1*i2", "o+=i1; return o*i2", "line 4: 'name=...' or 'return ...' is due here"),
        ("return i1*i2", "return i1*\\i2", "line 4: the character '\\\\' is not allowed in code"),
        ("return i1*i2", "return i1.a*i2 + a.b", f"line 4: an attribute (a.b) {NOT_IN_LANGUAGE}"),
        ("return i1*i2", "i1*i2", "line 2: _tf1 must end with 'return ...'"),
        ("t2=_tf1(t0,t1)", "t2=_tf1(t0)", "line 5: 't2=_tf1(...)' with 2 arguments is due here"),
        (
            "t2=_tf1(t0,t1)",
            "t2=_tf1(t0,t2)",
            "line 5: only a variable that has a value, such as t0, is allowed here",
        ),
        ("t2=_tf1(t0,t1)", "t2=_tf1(t0,t0)", "line 5: _tf1 gets the same argument twice"),
        ("t2=_tf1(t0,t1)", "t4=_tf1(t0,t1)", "line 5: 't2=_tf1(...)' with 2 arguments is due here"),
        (
            "y=(t2,t3)",
            "y=(t2,t4)",
            "line 9: only a variable that has a value, such as t0, is allowed here",
        ),
        ("y=(t2,t3)", "y=(t2,t1)", "line 8: t3 is computed but not used"),
        ("y=(t2,t3)", "y=t3", "line 9: y must have 2 values"),
        ("y=(t2,t3)", "y=[t2,t3]", "line 9: y must have 2 values"),
        ("y=(t2,t3)", "z=(t2,t3)", "line 9: 'y=...' is due here"),
        ("y=(t2,t3)", "y=(t2,t3)\ny=t2", "line 10: nothing may follow 'y=...'"),
        ("y=(t2,t3)\n", "", "the code ends where 'y=...' is due"),
        (
            "t3=_tf2(t2,t0)\ny=(t2,t3)\n",
            "",
            "the code ends where 't3=_tf2(...)' with 2 arguments is due",
        ),
        ("i1*i2", "i1*'a'*i2", 'line 4: the character "\'" is not allowed in code'),
        ("i1*i2", "i1[0]*i2", f"line 4: a subscript (a[b]) {NOT_IN_LANGUAGE}"),
        ("t0=x[0]", "\n\n\u00e4", "line 3: the character '\\xe4' is not allowed in code"),
        ("t0=x[0]", "\nt1=x[0]", "line 2: 't0=x[0]' is due here"),
        ("i1*i2", "i1 i2", "line 4: not Python: invalid syntax"),
        ("# ohm", "# \u00e4", "line 2: the character '\\xe4' is not allowed in code"),
    ],
)
def test_refusal_says_where_and_what_is_due(old: str, new: str, message: str) -> None:
    assert old in GOOD
    with pytest.raises(CodeError) as caught:
        check_code(GOOD.replace(old, new, 1), 2, 2)
    assert str(caught.value) == message


def with_steps(count: int) -> str:
    steps = "".join(f"  s{i}=s{i - 1}+s{i - 1}\n" for i in range(1, count))
    return f"t0=x[0];\ndef _tf1(i1):\n  s0=i1\n{steps}  return s{count - 1}\nt1=_tf1(t0)\ny=t1\n"


def test_names_may_be_given_values_on_the_way() -> None:
    code = GOOD.replace("return i1*i2", "o = i1 \\\n    * i2\n  return o", 1)
    relation = check_code(code, 2, 2).relations[0]
    assert [name for name, _ in relation.steps] == ["o"]
    assert {"i1", "i2", "o"} <= relation.names


@pytest.mark.parametrize("name", ["nan", "now", "step", "power", "t1_1", "value_of_memory0", "T0"])
def test_names_on_the_way_never_reach_what_runs_the_code(name: str) -> None:
    code = f"t0=x[0];\ndef _tf1(i1):\n  {name}=2*i1\n  o=previous({name})**0.5\n"
    code += f"  return {name} + 0*o + 1/i1\nt1=_tf1(t0)\ny=t1\n"
    step = compile_program(code, 1, 1).step
    assert step((1.0,), 0.0) is None
    assert step((2.0,), 0.1) == (4.5,)
    assert step((0.0,), 0.2) is None
    assert step((4.0,), 0.3) == (8.25,)


def test_the_number_of_assignments_is_limited() -> None:
    assert len(check_code(with_steps(MAX_STEPS), 1, 1).relations[0].steps) == MAX_STEPS
    with pytest.raises(CodeError, match="^line 2: _tf1 has more than 100 assignments$"):
        check_code(with_steps(MAX_STEPS + 1), 1, 1)


def test_the_number_of_delays_is_limited() -> None:
    def code(first: int, second: int) -> str:
        terms = [" + ".join(["delay(i1, 10)"] * count) for count in (first, second)]
        body = f"  o={terms[0]}\n  return o + {terms[1]}\n"
        return f"t0=x[0];\ndef _tf1(i1):\n{body}t1=_tf1(t0)\ny=t1\n"

    assert check_code(code(MAX_DELAYS - 1, 1), 1, 1)
    message = "^line 4: delay\\(...\\) stands more than 200 times in the code$"
    with pytest.raises(CodeError, match=message):
        check_code(code(MAX_DELAYS, 1), 1, 1)


def test_limits_of_size() -> None:
    assert check_code(GOOD + "#" * (MAX_CODE - len(GOOD)), 2, 2)
    with pytest.raises(
        CodeError, match="^the code has 100001 characters; at most 100000 are allowed$"
    ):
        check_code(GOOD + "#" * (MAX_CODE + 1 - len(GOOD)), 2, 2)

    def chain(length: int) -> str:
        lines = ["t0=x[0];"]
        for i in range(1, length + 1):
            lines += [f"def _tf{i}(i1):", " return i1", f"t{i}=_tf{i}(t{i - 1})"]
        return "\n".join([*lines, f"y=t{length}\n"])

    assert len(check_code(chain(MAX_RELATIONS), 1, 1).relations) == MAX_RELATIONS
    with pytest.raises(CodeError, match="at most 1000 functions are allowed$"):
        check_code(chain(MAX_RELATIONS + 1), 1, 1)


def test_code_nested_too_deeply_is_refused_without_a_crash() -> None:
    for code in ("(" * 99_000, "-" * 99_000 + "x", "[" * 50_000, "x[" * 40_000):
        with pytest.raises(CodeError):
            check_code(code, 1, 1)
    with pytest.raises(CodeError, match="^the code is nested too deeply$"):
        check_code("-" * 99_000 + "x", 1, 1)


def test_what_was_read_cannot_be_changed() -> None:
    checked = check_code(GOOD, 2, 2)
    with pytest.raises(AttributeError):
        setattr(checked, "n_inputs", 3)
    with pytest.raises(AttributeError):
        setattr(checked.relations[0], "result", "t9")


def test_mutated_code_is_refused_or_still_in_the_language() -> None:
    """Single characters of good code are changed, removed and doubled, with a fixed seed."""
    choice = random.Random(11)
    good = GOOD.replace("return i1*i2", "o=i1*i2; p=o-i1 \\\n    +i2\n  return o*p")
    alphabet = sorted(set(good)) + list("\"'{}\\@:;,=()[]#.\n ")
    refused = 0
    for _ in range(4000):
        code = list(good)
        for _ in range(choice.randrange(1, 4)):
            place = choice.randrange(len(code))
            code[place] = choice.choice([choice.choice(alphabet), "", code[place] * 2])
        with audit.recorded() as events:
            try:
                compile_program("".join(code), 2, 2)
            except CodeError:
                refused += 1
                assert set(events) <= {"compile"}
            else:
                assert set(events) <= {
                    "compile",
                    "exec of checked code",
                    "code.__new__",
                    "function.__new__",
                }
    assert 2000 < refused < 4000


@settings(derandomize=True, max_examples=many(1500), deadline=None)
@given(st.text(alphabet="txyi_01=[]();,:# \ndefrtun+*-/<>.'\"\\{}@\t\u00e4", max_size=120))
def test_random_text_is_refused_and_nothing_runs(code: str) -> None:
    with audit.recorded() as events:
        with pytest.raises(CodeError):
            compile_program(code, 1, 1)
    assert set(events) <= {"compile"}


@settings(derandomize=True, max_examples=many(300), deadline=None)
@given(samples())
def test_random_expressions_are_read_in_code(sample: Sample) -> None:
    parameters = {"a": "i1", "b": "i2", "c": "i3"}
    text = re.sub(r"\b[abc]\b", lambda name: parameters[name.group()], sample.text)
    code = "t0=x[0]; t1=x[1]; t2=x[2];\ndef _tf1(i1,i2,i3):\n"
    code += f"  return {text} + 0*(i1 + i2 + i3)\nt3=_tf1(t0,t1,t2)\ny=t3\n"
    assert check_code(code, 3, 1)
