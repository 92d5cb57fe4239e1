"""Formulas that look back: against their definition, and what is refused."""
from typing import List, Sequence, Tuple

import pytest
from hypothesis import given, settings, strategies as st

from shsa_core.errors import ExpressionError
from shsa_core.language.temporal import ATOM, OPERATORS, Part, Truth, parse_formula
from shsa_testing.thorough import many

Sample = Tuple[float, List[bool]]


def by_definition(part: Part, samples: Sequence[Sample]) -> bool:
    """Judge a formula at the last sample by what its operators mean, all samples at hand."""
    now, truths = samples[-1]
    if part.operator == ATOM:
        return truths[part.place]

    def holds(number: int, at: int) -> bool:
        return by_definition(part.parts[number], samples[: at + 1])

    last = len(samples) - 1
    if part.operator in ("and", "or", "not"):
        inner = [holds(number, last) for number in range(len(part.parts))]
        return {"and": all(inner), "or": any(inner), "not": not inner[0]}[part.operator]
    near = [i for i, (time, _) in enumerate(samples) if now - time <= part.time]
    if part.operator == "always":
        return all(holds(0, i) for i in near)
    if part.operator == "once":
        return any(holds(0, i) for i in near)
    if part.operator == "since":
        return any(holds(1, i) and all(holds(0, k) for k in range(i + 1, last + 1)) for i in near)
    assert part.operator == "within"
    far = [i for i in range(last + 1) if i not in near]
    return not any(holds(0, i) and not any(holds(1, k) for k in range(i, last + 1)) for i in far)


def horizon(part: Part) -> float:
    """Return how far back a formula looks."""
    return part.time + max((horizon(each) for each in part.parts), default=0.0)


def parts(*operators: str) -> st.SearchStrategy[Part]:
    """Random formulas over two conditions."""
    atoms: st.SearchStrategy[Part] = st.integers(0, 1).map(lambda n: Part(ATOM, place=n))

    def larger(inner: st.SearchStrategy[Part]) -> st.SearchStrategy[Part]:
        def make(operator: str) -> st.SearchStrategy[Part]:
            takes, _ = OPERATORS.get(operator, ("a, b, T", ""))
            count = 1 if operator == "not" else takes.count(",")
            time = st.integers(1, 4).map(float) if operator in OPERATORS else st.just(0.0)
            inners = st.lists(inner, min_size=count, max_size=count).map(lambda each: tuple(each))
            return st.builds(Part, st.just(operator), inners, time)

        return st.sampled_from(operators).flatmap(make)

    return st.recursive(atoms, larger, max_leaves=4)


def histories(least: int) -> st.SearchStrategy[List[List[bool]]]:
    return st.lists(st.lists(st.booleans(), min_size=2, max_size=2), min_size=least, max_size=12)


def judged(part: Part, samples: Sequence[Sample]) -> List[Truth]:
    return told(part, [(time, [*truths]) for time, truths in samples])


BACK = ("not", "and", "or", "always", "once", "since")


@settings(max_examples=many(300), deadline=None)
@given(parts(*BACK), histories(0), histories(1), st.lists(st.integers(1, 3), min_size=24))
def test_what_is_told_is_true_whatever_was_before(
    part: Part, before: List[List[bool]], seen: List[List[bool]], steps: List[int]
) -> None:
    times = [float(sum(steps[:number])) for number in range(len(before) + len(seen))]
    samples = list(zip(times, before + seen))
    found = judged(part, samples[len(before) :])
    for number, truth in enumerate(found, len(before)):
        if truth is not None:
            assert truth == by_definition(part, samples[: number + 1])
        else:
            assert samples[number][0] - samples[len(before)][0] <= horizon(part)


@settings(max_examples=many(300), deadline=None)
@given(parts("within", "not", "and"), histories(1), st.lists(st.integers(1, 3), min_size=12))
def test_an_answer_within_a_time(part: Part, seen: List[List[bool]], steps: List[int]) -> None:
    samples = [(float(sum(steps[:number])), truths) for number, truths in enumerate(seen)]
    expected = [by_definition(part, samples[: n + 1]) for n in range(len(samples))]
    assert judged(part, samples) == expected


def test_a_condition_that_is_not_known_is_judged_neither_way() -> None:
    a, b = Part(ATOM, place=0), Part(ATOM, place=1)
    always: List[Tuple[float, List[Truth]]] = [(0, [None]), (3, [None]), (4, [True]), (6, [True])]
    assert told(Part("always", (a,), 2.0), always) == [None, None, None, True]
    since: List[Tuple[float, List[Truth]]] = [(0, [True, True]), (1, [None, False])]
    since += [(2, [True, False]), (2.5, [True, None]), (4, [True, False]), (5, [True, False])]
    assert told(Part("since", (a, b), 2.0), since) == [True, None, None, None, None, False]
    both = Part("or", (a, Part("not", (b,))))
    assert told(both, [(0, [None, None]), (0, [True, None])]) == [None, True]
    assert told(Part("within", (a, b), 1.0), [(0, [True, None]), (9, [True, None])]) == [True, True]


def told(part: Part, samples: Sequence[Tuple[float, List[Truth]]]) -> List[Truth]:
    judge = part.judge()
    return [judge((time, time), truths) for time, truths in samples]


def test_a_formula_is_read() -> None:
    formula = parse_formula("always(v > 0 or  not w < 3, 2.5) and 1 < v < 9")
    assert formula.text == "always(v > 0 or not w < 3, 2.5) and 1 < v < 9"
    assert formula.names == ("v", "w")
    assert [each.text for each in formula.conditions] == [
        *("1 if v > 0 else 0", "1 if w < 3 else 0", "1 if 1 < v < 9 else 0")
    ]
    (always, last) = formula.root.parts
    assert (formula.root.operator, always.operator, always.time) == ("and", "always", 2.5)
    assert (last.operator, last.place) == (ATOM, 2)
    assert parse_formula("within(derivative(v) > 1 and w > 0, v > 2, 1e-3)").root.time == 1e-3


@pytest.mark.parametrize(
    "text, why",
    [
        ("", "the expression is empty"),
        ("v", "a number stands where a condition is needed"),
        ("always[0,2](v > 0)", r"character '\['"),
        ("always(v > 0)", r"write always\(a, T\): T is a number of seconds"),
        ("always()", r"write always\(a, T\)"),
        ("always(v > 0, w)", r"write always\(a, T\)"),
        ("since(v > 0, 2)", r"write since\(a, b, T\)"),
        ("once(v > 0, w > 0, 2)", r"write once\(a, T\)"),
        ("within(v > 0, w > 0, -1)", "the time must be above 0 s, not -1"),
        ("once(v > 0, 1e999)", "the time must be above 0 s, not inf"),
        ("once(v, 2)", "a number stands where a condition is needed"),
        ("always(v > 0, 2) > 0", r"always\(...\) is true or false"),
        ("always > 0", r"always\(...\) is true or false"),
        ("v > open(w)", "there is no function 'open'"),
        ("v.__class__ > 0", r"an attribute \(a.b\)"),
        ("eventually(v > 0, 2)", "a number stands where a condition is needed"),
        ("v > 0 if w > 0 else v > 1", "a number stands where a condition is needed"),
        ("not " * 120 + "v > 0", "nested more than 100 deep"),
        ("v > 0 and " * 4000 + "v > 0", "has 40005 characters; at most 40000 are allowed"),
        ("v > 0, w > 0", r"a tuple \(a, b\)"),
        ("v > ", "not an expression"),
    ],
)
def test_what_is_no_formula_is_refused(text: str, why: str) -> None:
    with pytest.raises(ExpressionError, match=why):
        parse_formula(text)
