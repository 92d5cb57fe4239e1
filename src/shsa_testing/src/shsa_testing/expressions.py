"""Random expressions with what they mean, for property tests."""
import math
from typing import Callable, Dict, NamedTuple, Tuple

from hypothesis import strategies as st

Meaning = Callable[[Dict[str, float]], float]
NAMES = ("a", "b", "c")


class Sample(NamedTuple):
    """An expression as text, and its value as a Python function of its names' values."""

    text: str
    meaning: Meaning


class NoValue(Exception):
    """The expression has no value there."""


def _number(value: float) -> Sample:
    return Sample(repr(value), lambda env: float(value))


def _name(name: str) -> Sample:
    return Sample(name, lambda env: env[name])


def _divide(left: float, right: float) -> float:
    if right == 0.0:
        raise NoValue
    return left / right


def _power(left: float, right: float) -> float:
    try:
        result = left**right
    except (ZeroDivisionError, OverflowError):
        raise NoValue
    if isinstance(result, complex):
        raise NoValue
    return result


def _root(value: float) -> float:
    if value < 0.0:
        raise NoValue
    return value**0.5


def _whole(call: Callable[[float], float]) -> Callable[[float], float]:
    def rounded(value: float) -> float:
        if not math.isfinite(value):
            raise NoValue
        return float(call(value))

    return rounded


def _overflowing(call: Callable[[float], float]) -> Callable[[float], float]:
    def called(value: float) -> float:
        try:
            return call(value)
        except OverflowError:
            raise NoValue

    return called


def _logarithm(value: float) -> float:
    if value <= 0.0:
        raise NoValue
    return math.log(value)


_BINARY: Dict[str, Callable[[float, float], float]] = {
    "+": lambda left, right: left + right,
    "-": lambda left, right: left - right,
    "*": lambda left, right: left * right,
    "/": _divide,
}
_UNARY: Dict[str, Callable[[float], float]] = {
    "abs": lambda v: v if v >= 0.0 else -v,
    "sign": lambda v: float((v > 0) - (v < 0)),
    "sqrt": _root,
    "sin": math.sin,
    "atan": math.atan,
    "floor": _whole(math.floor),
    "ceil": _whole(math.ceil),
    "exp": _overflowing(math.exp),
    "log": _logarithm,
    "cos": math.cos,
}
_COMPARE: Dict[str, Callable[[float, float], bool]] = {
    "<": lambda left, right: left < right,
    "<=": lambda left, right: left <= right,
    ">": lambda left, right: left > right,
    ">=": lambda left, right: left >= right,
    "==": lambda left, right: left == right,
    "!=": lambda left, right: left != right,
}


def _binary(parts: Tuple[Sample, str, Sample]) -> Sample:
    left, sign, right = parts
    operation = _BINARY[sign]
    return Sample(
        f"({left.text} {sign} {right.text})",
        lambda env: operation(left.meaning(env), right.meaning(env)),
    )


def _unary(parts: Tuple[str, Sample]) -> Sample:
    name, inner = parts
    return Sample(f"{name}({inner.text})", lambda env: _UNARY[name](inner.meaning(env)))


def _minus(inner: Sample) -> Sample:
    return Sample(f"-{inner.text}", lambda env: -inner.meaning(env))


def _raised(parts: Tuple[Sample, float]) -> Sample:
    base, exponent = parts
    return Sample(f"({base.text})**{exponent!r}", lambda env: _power(base.meaning(env), exponent))


def _extreme(parts: Tuple[str, Sample, Sample]) -> Sample:
    name, one, other = parts
    pick = {"min": min, "max": max}[name]
    return Sample(
        f"{name}({one.text}, {other.text})",
        lambda env: pick(one.meaning(env), other.meaning(env)),
    )


def _choice(parts: Tuple[Sample, str, Sample, Sample, Sample]) -> Sample:
    left, sign, right, body, orelse = parts

    def meaning(env: Dict[str, float]) -> float:
        holds = _COMPARE[sign](left.meaning(env), right.meaning(env))
        return body.meaning(env) if holds else orelse.meaning(env)

    return Sample(f"({body.text} if {left.text} {sign} {right.text} else {orelse.text})", meaning)


def samples() -> st.SearchStrategy:
    """Random expressions over NAMES."""
    numbers = st.one_of(
        st.integers(min_value=0, max_value=20),
        st.floats(min_value=0.0, max_value=100.0, allow_nan=False),
    )
    leaves = st.one_of(numbers.map(_number), st.sampled_from(NAMES).map(_name))

    def extend(inner: st.SearchStrategy) -> st.SearchStrategy:
        exponents = st.sampled_from([-2, -1, -0.5, 0, 0.5, 1, 1.5, 2, 3])
        return st.one_of(
            st.tuples(inner, st.sampled_from(sorted(_BINARY)), inner).map(_binary),
            st.tuples(st.sampled_from(sorted(_UNARY)), inner).map(_unary),
            inner.map(_minus),
            st.tuples(inner, exponents).map(_raised),
            st.tuples(st.sampled_from(["min", "max"]), inner, inner).map(_extreme),
            st.tuples(inner, st.sampled_from(sorted(_COMPARE)), inner, inner, inner).map(_choice),
        )

    return st.recursive(leaves, extend, max_leaves=12)
