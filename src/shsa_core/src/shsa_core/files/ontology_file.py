"""Reads the ontology file (docs/ontology.md describes it)."""
from typing import Callable, Dict, Iterator, List, Optional, Tuple, TypeVar

from shsa_core.errors import ExpressionError, ModelError, ModelErrors
from shsa_core.files.document import Entry, Value, read_yaml
from shsa_core.files.error_values import read_error, usual_quality
from shsa_core.language.expression import (
    Expression,
    Law,
    compose,
    parse_constraint,
    parse_expression,
)
from shsa_core.language.syntax import is_name
from shsa_core.model.ontology import Constant, Ontology, Property
from shsa_core.model.relation import TransferFunction

_NAMES = "a name has letters, digits and _, does not begin with a digit and is not a reserved word"
SECTIONS = {
    "properties": "the quantities that change",
    "constants": "the quantities that do not",
    "relations": "how properties follow from others",
}
PROPERTY = {
    "unit": "its unit; 1: none; unsaid: not known",
    "symbol": "its sign in formulas",
    "usual": "[lowest, highest]: what 5 to 95 % of its values are within",
}
CONSTANT = {"value": "a finite number; required", "unit": "its unit; 1: none; unsaid: not known"}
FUNCTION = {
    "function": "the expression; may stand alone, without this key",
    "not_executable": "instead of function: a text that is no expression; code is refused for it",
    "inputs": "with not_executable: the properties that it needs",
    "where": "names for values on the way, and their expressions, in order",
    "quality": "above 0, at most 1: how far its result can be trusted; unsaid, what its error says",
    "constraint": "a condition; where it is false, there is no output",
    "error": "how far its result is from the truth, in the unit of what it yields",
}
"""What an ontology may say at each place, and what that means."""
_Parsed = TypeVar("_Parsed")


def read_ontology(path: str) -> Ontology:
    """The ontology in a file. Raises ModelErrors: all that is wrong, with file and line."""
    ontology, errors = load_ontology(path)
    if errors:
        raise ModelErrors(errors)
    return ontology


def load_ontology(path: str) -> Tuple[Ontology, List[ModelError]]:
    """The valid part of the ontology in a file, and all that is wrong with the rest, in order.

    Raises ModelError if the file as a whole cannot be read.
    """
    document = read_yaml(path)
    reader = _Reader()
    reader.errors += document.wrong_keys("the ontology", SECTIONS)
    sections = document.mapping("the ontology")
    for name, value in _entries(sections, "properties"):
        reader.collect(lambda: reader.add_property(name, value))
    for name, value in _entries(sections, "constants"):
        reader.collect(lambda: reader.add_constant(name, value))
    for relation, outputs in _entries(sections, "relations"):
        reader.collect(lambda: reader.add_relation(relation, outputs))
    return Ontology(reader.properties, reader.constants, tuple(reader.functions)), reader.errors


def _entries(sections: Dict[str, Value], section: str) -> Iterator[Tuple[str, Value]]:
    value = sections.get(section)
    if value is not None and value.data is not None:
        yield from value.mapping(section).items()


class _Reader:
    """Collects what is valid and what is wrong."""

    def __init__(self) -> None:
        self.properties: Dict[str, Property] = {}
        self.constants: Dict[str, Constant] = {}
        self.functions: List[TransferFunction] = []
        self.errors: List[ModelError] = []

    def collect(self, add: Callable[[], None]) -> None:
        """Calls `add` and keeps its ModelError."""
        try:
            add()
        except ModelError as error:
            self.errors += error.errors

    def add_property(self, name: str, value: Value) -> None:
        """Adds one entry of `properties`."""
        self._check_name(name, value, "property")
        unit = symbol = ""
        usual = None
        if value.data is not None:
            entry = value.entry(f"the property {name}", PROPERTY)
            usual = entry["usual"].interval("usual") if "usual" in entry else None
            unit = entry["unit"].string("unit") if "unit" in entry else ""
            symbol = entry["symbol"].string("symbol") if "symbol" in entry else ""
        self.properties[name] = Property(name, unit, symbol, value.where, usual)

    def add_constant(self, name: str, value: Value) -> None:
        """Adds one entry of `constants`."""
        self._check_name(name, value, "constant")
        entry = value.entry(f"the constant {name}", CONSTANT, required=("value",))
        unit = entry["unit"].string("unit") if "unit" in entry else ""
        self.constants[name] = Constant(name, entry["value"].number("value"), unit, value.where)

    def add_relation(self, relation: str, outputs: Value) -> None:
        """Adds one entry of `relations`, in all its directions."""
        if not is_name(relation):
            raise outputs.error(f"the relation cannot be named {relation!a}; {_NAMES}")
        directions = outputs.mapping(f"the relation {relation}")
        if not directions:
            raise outputs.error(f"the relation {relation} has no output")
        for output, value in directions.items():
            self.collect(lambda: self._add_function(relation, output, value))

    def _check_name(self, name: str, value: Value, kind: str) -> None:
        if not is_name(name):
            raise value.error(f"a {kind} cannot be named {name!a}; {_NAMES}")
        if name in self.properties or name in self.constants:
            raise value.error(f"the name '{name}' is both a property and a constant")

    def _add_function(self, relation: str, output: str, value: Value) -> None:
        what = f"{relation} for {output}"
        if output not in self.properties:
            kind = "is a constant" if output in self.constants else "is not in 'properties'"
            raise value.error(f"the relation {relation} yields '{output}', which {kind}")
        entry = {"function": value}
        if isinstance(value.data, dict):
            entry = value.entry(what, FUNCTION)
        if ("function" in entry) == ("not_executable" in entry):
            raise value.error(f"{what} needs either the key 'function' or 'not_executable'")
        if ("not_executable" in entry) != ("inputs" in entry):
            raise value.error(f"{what}: the key 'inputs' belongs to 'not_executable' alone")
        if "where" in entry and "function" not in entry:
            raise value.error(f"{what}: the key 'where' belongs to 'function' alone")

        error = read_error(entry["error"], "error") if "error" in entry else None
        quality = usual_quality(error)
        if "quality" in entry:
            quality = entry["quality"].number("quality")
        if not 0.0 < quality <= 1.0:
            raise entry["quality"].error(f"quality must be above 0 and at most 1, not {quality:g}")
        constraint = None
        if "constraint" in entry:
            constraint = _parse(entry["constraint"], f"{what}: constraint", parse_constraint)
        law: Optional[Law] = None
        names: List[str] = []
        if "function" in entry:
            law = self._law(what, entry)
            text = law.text
            names += law.names
        else:
            text = entry["not_executable"].string("not_executable")
            names += [item.string("an input") for item in entry["inputs"].sequence("inputs")]
        names += constraint.names if constraint else ()
        self._check_inputs(names, relation, output, value)
        inputs = tuple(dict.fromkeys(name for name in names if name in self.properties))
        self.functions.append(
            TransferFunction(
                relation, output, inputs, law, quality, constraint, text, value.where, error
            )
        )

    def _law(self, what: str, entry: Entry) -> Law:
        function = _parse(entry["function"], what, parse_expression)
        if "where" not in entry:
            return compose({}, function)
        steps: Dict[str, Expression] = {}
        for name, value in entry["where"].mapping(f"{what}: where").items():
            if name in self.properties or name in self.constants:
                kind = "property" if name in self.properties else "constant"
                raise value.error(f"{what}: '{name}' under 'where' is the name of a {kind}")
            steps[name] = _parse(value, f"{what}: {name}", parse_expression)
        if not steps:
            raise entry["where"].error(f"{what}: 'where' has no entry")
        try:
            return compose(steps, function)
        except ExpressionError as error:
            raise entry["where"].error(f"{what}: {error}") from error

    def _check_inputs(self, names: List[str], relation: str, output: str, value: Value) -> None:
        for name in names:
            if name == output:
                raise value.error(f"the relation {relation} uses its own output '{output}'")
            if name not in self.properties and name not in self.constants:
                raise value.error(
                    f"the relation {relation} uses '{name}', "
                    "which is neither in 'properties' nor in 'constants'"
                )


def _parse(value: Value, what: str, parse: Callable[[str], _Parsed]) -> _Parsed:
    try:
        return parse(value.string(what))
    except ExpressionError as error:
        raise value.error(f"{what}: {error}") from error
