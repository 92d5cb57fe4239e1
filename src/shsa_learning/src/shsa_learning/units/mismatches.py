"""Follows units through the laws of an ontology, and finds where they cannot match."""
import ast
from contextlib import suppress
from fractions import Fraction
from typing import Callable, Dict, Iterator, List, Mapping, Optional, Sequence, Tuple, Union

from shsa_core.language.expression import Expression, Law
from shsa_core.language.functions import CONSTANTS, ELAPSED
from shsa_core.language.trees import is_condition, literal, row
from shsa_core.model.field import is_angle
from shsa_core.model.ontology import Constant, Ontology, Property
from shsa_core.model.som import Som
from shsa_learning.finding import Finding
from shsa_learning.units.unit import (
    NO_UNIT,
    SECOND,
    Number,
    Quantity,
    Unit,
    UnitError,
    match,
    parse_unit,
    raised,
    times,
)

Units = Mapping[str, Optional[Unit]]
"""The unit of each name; None: not known."""

Mismatch = Tuple[str, bool]
"""Two units that cannot match, in words. False: a number may carry a unit that makes them match."""

Common = Callable[[Sequence[Quantity], str], Quantity]
"""Return the quantity that all parts have; the text says what is wrong if two differ."""

UnitRule = Callable[[str, Sequence[Quantity], Common], Quantity]
"""Map a function's name and the quantities of its arguments to the quantity of the call."""


def check_units(ontology: Ontology) -> Iterator[Finding]:
    """Report the units of an ontology that are none, or that its functions cannot match."""
    units: Dict[str, Optional[Unit]] = {}
    items: List[Union[Property, Constant]] = [*ontology.properties.values()]
    for item in [*items, *ontology.constants.values()]:
        units[item.name] = None
        try:
            units[item.name] = parse_unit(item.unit)
        except UnitError as error:
            yield Finding("error", item.where, f"{item.name}: {error}")
    for function in ontology.functions:
        if function.law is None:
            continue
        mismatches = law_mismatches(function.law, units, units[function.output])
        if function.constraint is not None:
            mismatches += condition_mismatches(function.constraint, units)
        for text, sure in dict.fromkeys(mismatches):
            name, level = f"{function.relation} for {function.output}", "error"
            todo = "Correct the function or the units"
            if not sure:
                level = "warning"
                todo = "Correct it, or give the number that carries a unit a name in 'constants'"
            yield Finding(level, function.where, f"units of {name}: {text}", todo)


def check_angles(ontology: Ontology, som: Som) -> Iterator[Finding]:
    """Report the properties in another unit than rad that are angles of quaternions."""
    for source in som.sources:
        known, field = ontology.properties.get(source.property), source.provision.field
        if known is None or not is_angle(field):
            continue
        with suppress(UnitError):  # which is reported with the property
            unit, rad = parse_unit(known.unit), parse_unit("rad")
            if unit is not None and rad is not None and not match(unit, rad):
                what = f"{source.service.name}: {field} is in rad, but {known.name} in {known.unit}"
                todo = f"Give {known.name} the unit rad, or provide another property"
                yield Finding("error", source.provision.where, what, todo)


def law_mismatches(law: Law, units: Units, result: Optional[Unit]) -> List[Mismatch]:
    """Return the units in a law that cannot match, its output in the unit `result`."""
    return _mismatches([*law.steps, ("", law.result)], units, result)


def condition_mismatches(condition: Expression, units: Units) -> List[Mismatch]:
    """Return the units in a condition that cannot match."""
    return _mismatches([("", condition)], units)


def _mismatches(
    parts: Sequence[Tuple[str, Expression]], units: Units, result: Optional[Unit] = None
) -> List[Mismatch]:
    """Return the units that cannot match in expressions of which the last gives the unit `result`.

    Each of `parts` has the name by which the parts behind it know it. None: not known.
    """
    known: Dict[str, Quantity] = dict(units)
    analysis = _Analysis(known)
    for name, expression in parts:
        tree = expression.tree()
        if is_condition(tree):
            analysis.condition(tree)
            result = known[name] = None
        else:
            known[name] = analysis.quantity(tree)
    last = known[parts[-1][0]]
    analysis.common([last, result], "the function gives {}, its property is in {}")
    return list(dict.fromkeys(analysis.mismatches))


class _Analysis:
    """Finds the quantity of each part of a tree and collects mismatches."""

    def __init__(self, units: Mapping[str, Quantity]) -> None:
        self._units = units
        self.mismatches: List[Tuple[str, bool]] = []

    def quantity(self, node: ast.expr) -> Quantity:
        """Return the quantity of a number."""
        value = literal(node)
        if value is not None:
            return Number(plain=value == round(value) or abs(value) == 0.5)
        if isinstance(node, ast.Name):
            if node.id in CONSTANTS:
                return Number(plain=True)
            return SECOND if node.id == ELAPSED else self._units[node.id]
        if isinstance(node, ast.UnaryOp):
            return self.quantity(node.operand)
        if isinstance(node, ast.BinOp):
            first, operations = row(node)
            result = self.quantity(first)
            for each in operations:
                result = self._operation(each, result, self.quantity(each.right))
            return result
        if isinstance(node, ast.IfExp):
            self.condition(node.test)
            parts = [self.quantity(node.body), self.quantity(node.orelse)]
            return self.common(parts, "the two sides of if ... else are in {} and {}")
        assert isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
        parts = [self.quantity(argument) for argument in node.args]
        return RULES[node.func.id](node.func.id, parts, self.common)

    def condition(self, node: ast.expr) -> None:
        """Check a part that is true or false."""
        if isinstance(node, ast.Compare):
            parts = [self.quantity(part) for part in (node.left, *node.comparators)]
            self.common(parts, "{} is compared with {}")
        elif isinstance(node, ast.BoolOp):
            for part in node.values:
                self.condition(part)
        elif isinstance(node, ast.UnaryOp):
            self.condition(node.operand)

    def common(self, parts: Sequence[Quantity], message: str) -> Quantity:
        """Return the quantity that all parts have; note a mismatch where two differ."""
        units = [part for part in parts if isinstance(part, Unit)]
        for unit in units[1:]:
            if not match(units[0], unit):
                sure = units[0].sure and unit.sure
                self.mismatches.append((message.format(units[0], unit), sure))
                return None
        if units:
            return units[0]
        numbers = all(isinstance(part, Number) for part in parts)
        return Number(all(part.plain for part in parts)) if numbers else None

    def _operation(self, node: ast.BinOp, left: Quantity, right: Quantity) -> Quantity:
        if isinstance(node.op, (ast.Add, ast.Sub)):
            return self.common([left, right], "{} and {} are added or subtracted")
        if isinstance(node.op, ast.Mod):
            return self.common([left, right], "{} % {}")
        if isinstance(node.op, ast.Pow):
            return self._power(left, right, node.right)
        return times(left, right, 1 if isinstance(node.op, ast.Mult) else -1)

    def _power(self, base: Quantity, exponent: Quantity, node: ast.expr) -> Quantity:
        if self.common([exponent, NO_UNIT], "an exponent is in {}, it must be in {}") is None:
            return None
        value = literal(node)
        if value is not None:
            return raised(base, Fraction(value).limit_denominator(12))
        if isinstance(base, Unit) and base.powers:
            if not isinstance(exponent, Number):
                self.mismatches.append((f"{base} has an exponent that is not a number", base.sure))
            return None
        return base


_same: UnitRule = lambda name, parts, common: parts[0]
_shared: UnitRule = lambda name, parts, common: common(parts, name + " of {} and {}")
_root: UnitRule = lambda name, parts, common: raised(parts[0], Fraction(1, 2))


def _none(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    common([parts[0], NO_UNIT], name + " of {}, it needs {}")
    return NO_UNIT


def _ratio(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    _shared(name, parts, common)
    return NO_UNIT


def _timed(what: str) -> UnitRule:
    def rule(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
        common([parts[1], SECOND], f"the {what} of {name} is in {{}}, not in {{}}")
        return parts[0]

    return rule


def _sum(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    products = [times(*pair) for pair in zip(parts[::2], parts[1::2])]
    return common(products, name + " adds {} and {}")


def _bell(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    gamma, *pairs = parts
    for pair in zip(pairs[::2], pairs[1::2]):
        distance = common(pair, name + " of {} from {}")
        exponent = times(gamma, raised(distance, Fraction(2)))
        common([exponent, NO_UNIT], "the exponent of " + name + " is in {}, it needs {}")
    return NO_UNIT


def _table(name: str, parts: Sequence[Quantity], common: Common) -> Quantity:
    common([parts[0], *parts[1::2]], name + " of {} by {}")
    return common(parts[2::2], name + " gives {} and {}")


RULES: Mapping[str, UnitRule] = {
    "abs": _same,
    "sign": lambda name, parts, common: NO_UNIT,
    "min": _shared,
    "max": _shared,
    "floor": _same,
    "ceil": _same,
    "sqrt": _root,
    "exp": _none,
    "log": _none,
    "log10": _none,
    "sin": _none,
    "cos": _none,
    "tan": _none,
    "asin": _none,
    "acos": _none,
    "atan": _none,
    "tanh": _none,
    "atan2": _ratio,
    "hypot": _shared,
    "clip": _shared,
    "dot": _sum,
    "rbf": _bell,
    "table": _table,
    "derivative": lambda name, parts, common: times(parts[0], SECOND, -1),
    "integral": lambda name, parts, common: times(parts[0], SECOND),
    "previous": _same,
    "lowpass": _timed("time constant"),
    "delay": _timed("time"),
}
"""The rule of each function of the language."""
