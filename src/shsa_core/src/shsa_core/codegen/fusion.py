"""Fusion: a weighted sum of derivations of a value, by errors that were measured together.

It is a derivation by a relation that is named after the shares, and so it is searched, generated,
and run as any other.
"""
import re
from contextlib import suppress
from functools import lru_cache
from typing import Dict, List, NamedTuple, Sequence, Tuple

from shsa_core.codegen.generator import uses_of, way
from shsa_core.errors import ExpressionError
from shsa_core.language.expression import parse_law
from shsa_core.model.calibration import Calibration
from shsa_core.model.relation import TransferFunction
from shsa_core.model.substitution import Program
from shsa_core.search.derivation import Derivation, Rated, rate_function

NAMES = ("first", "second", "third")
"""Of what is fused, as the law calls it; so many at most."""
_FUSION = re.compile(r"(fusion [\d:]+): (.+)")
_INPUT = re.compile(r"\bi([123])\b")


class Fusion(NamedTuple):
    """A function of derivations of its output, and the `way` of each."""

    function: TransferFunction
    ways: Tuple[str, ...]


def fuse(derivations: Sequence[Derivation], parts: Sequence[Tuple[float, Calibration]]) -> Fusion:
    """Return the fusion of derivations of a property: the sum of their shares, calibrated."""
    words = ":".join(f"{100.0 * share:.0f}" for share, _ in parts)
    sum_ = " + ".join(f"{s * each.gain:.6g}*{name}" for name, (s, each) in zip(NAMES, parts))
    text = f"{sum_} {sum(share * each.offset for share, each in parts):+.6g}"
    ways = tuple(way(derivation) for derivation in derivations)
    return Fusion(_function(f"fusion {words}", derivations[0].property, text), ways)


@lru_cache(maxsize=1000)
def fusions_of(program: Program) -> Tuple[Fusion, ...]:
    """Return the fusions that a generated program computes."""
    found: List[Fusion] = []
    for use in uses_of(program)[0]:
        title = _FUSION.fullmatch(use.title)
        if title is not None:
            text = _INPUT.sub(lambda i: NAMES[int(i[1]) - 1], use.result.replace("return ", ""))
            with suppress(ExpressionError):
                each = Fusion(_function(title[1], title[2], text), use.inputs)
                found += [each] if each.function.inputs == NAMES[: len(each.ways)] else []
    return tuple(found)


def _function(relation: str, output: str, text: str) -> TransferFunction:
    law = parse_law(text)
    return TransferFunction(relation, output, law.names, law, text=law.text)


def fused(fusions: Sequence[Fusion], parts: Sequence[Rated]) -> List[Rated]:
    """Return the fusions of some derivations of a property of which all parts are there."""
    by_way: Dict[str, Rated] = {}
    for rated in parts if fusions else ():
        by_way.setdefault(way(rated.derivation), rated)
    return [
        rate_function(each.function, 0, [by_way[one] for one in each.ways])
        for each in fusions
        if all(one in by_way for one in each.ways)
    ]
