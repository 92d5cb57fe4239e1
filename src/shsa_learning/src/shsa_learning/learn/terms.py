"""The library of terms: what physics makes of some inputs, as expressions of the language.

A term's coefficient may carry any unit; what is added within a term has one unit.
"""
import re
from typing import Dict, List, Mapping, Optional, Sequence, Set, Tuple

import numpy as np

from shsa_learning.units.mismatches import law_mismatches
from shsa_learning.units.unit import Unit
from shsa_learning.learn.delays import Lag, candidates
from shsa_learning.learn.evaluation import Knowledge
from shsa_learning.learn.features import function_of

SIDES = frozenset("x y z left right front rear back l r fl fr rl rr bl br roll pitch".split())
"""Words that tell like inputs apart, as digits do."""
SIGNED = 0.02  # of all values must be on either side of 0
NEVER_NEAR_ZERO = 0.2  # of its largest magnitude: what an input must stay above to divide by it
MOVING = 0.05  # of the largest magnitude: what moves less stands still
RATES_S = (0.1, 0.4)
"""Time constants behind which a derivative is more than noise."""
FORGETTING_S = (3.0, 10.0)
"""Time constants of an integral that forgets: the sum of a substitute begins when it starts."""
MOST_TERMS = 1500


def library(columns: Mapping[str, np.ndarray], known: Knowledge = Knowledge()) -> List[str]:
    """Return the terms over inputs of which some values are given, each once, simple ones first."""
    signed = {name for name, values in columns.items() if _signed(values)}
    groups = _groups(tuple(columns), known.units)
    alone = [name for name in columns if not any(name in group for group in groups)]
    sums = [text for group in groups for text in _sums(group, signed)]
    factors = [*alone, *(f"abs({name})" for name in alone if name in signed), *sums]
    terms = [*columns, *sums, *known.laws]
    for name in alone:
        sign = [f"abs({name})", f"{name}*abs({name})"] if name in signed else []
        terms += [*sign, f"{name}**2", f"{name}**3"]
    for name, values in columns.items():
        terms += [*_gates(name, values), *(_rate(name, tau) for tau in RATES_S)]
    for name in alone:
        if _away_from_zero(columns[name]):
            terms += [f"{one}/{name}" for one in factors if name not in one]
            terms += [f"1.0/{name}"]
    terms += [f"{one}*{other}" for k, one in enumerate(factors) for other in factors[:k]]
    terms += [f"{name}*{_rate(name, RATES_S[0])}" for name in alone]
    return [term for term in dict.fromkeys(terms) if _sensible(term, known.units)][:MOST_TERMS]


def behind_lags(term: str, period: float) -> List[str]:
    """Return a term behind each delay and filter that rows so far apart (s) can tell."""
    if "derivative(" in term:
        return []
    lags = [*candidates(), *(Lag(0.0, tau) for tau in FORGETTING_S)]
    return [lag.text(term) for lag in lags if lag.delay + lag.filter >= 0.5 * period]


def _rate(name: str, tau: float) -> str:
    return Lag(0.0, tau).text(f"derivative({name})")


def _groups(names: Sequence[str], units: Mapping[str, Optional[Unit]]) -> List[Tuple[str, ...]]:
    """Return the inputs that are alike: of one unit, called the same but for a side or a number."""
    found: Dict[Tuple[object, ...], List[str]] = {}
    for name in names:
        words = re.sub("[0-9]+", "_", name.lower()).split("_")
        stem = tuple(word for word in words if word and word not in SIDES)
        unit = units.get(name)
        found.setdefault((stem or name, unit.powers if unit else None), []).append(name)
    return [tuple(group) for group in found.values() if len(group) > 1]


def _sums(group: Sequence[str], signed: Set[str]) -> List[str]:
    """Return the sums over like inputs, of powers to the third and of magnitudes, and the norm."""
    squares = "(" + " + ".join(f"{name}**2" for name in group) + ")"
    sums = ["(" + " + ".join(group) + ")", squares, f"sqrt{squares}"]
    if signed.intersection(group):
        sums.append("(" + " + ".join(f"abs({name})" for name in group) + ")")
        sums.append("(" + " + ".join(f"abs({name})**3" for name in group) + ")")
    else:
        sums.append("(" + " + ".join(f"{name}**3" for name in group) + ")")
    return sums


def _gates(name: str, values: np.ndarray) -> List[str]:
    """Return 1 where an input moves and 0 where it stands still, if it does both."""
    size = np.abs(values)
    least = float(f"{MOVING * np.max(size):.2g}") * (1.0 + 1e-9)
    moves = float(np.mean(size > least))
    if not SIGNED < moves < 1.0 - SIGNED:
        return []
    return [f"(1.0 if abs({name}) > {least!r} else 0.0)"]


def _signed(values: np.ndarray) -> bool:
    return bool(min(np.mean(values < 0.0), np.mean(values > 0.0)) > SIGNED)


def _away_from_zero(values: np.ndarray) -> bool:
    size = np.abs(values)
    return bool(np.min(size) > NEVER_NEAR_ZERO * np.max(size) > 0.0)


def _sensible(term: str, units: Mapping[str, Optional[Unit]]) -> bool:
    """Return whether the units within a term match, as far as they are known."""
    function = function_of("", term)
    assert function.law is not None
    if not any(units.get(name) for name in function.inputs):
        return True
    return not law_mismatches(function.law, {n: units.get(n) for n in function.inputs}, None)
