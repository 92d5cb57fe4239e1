"""Reads the ontology file (docs/ontology.md describes it)."""
from typing import Callable, Dict, Iterator, List, Mapping, Optional, Tuple, TypeVar

from shsa_core.errors import ExpressionError, ModelError
from shsa_core.files.document import Value, read_yaml
from shsa_core.language.expression import is_name, parse_constraint, parse_expression
from shsa_core.language.law import Law
from shsa_core.model.ontology import Constant, Ontology, Property
from shsa_core.model.relation import TransferFunction

_NAMES = "a name has letters, digits and _, does not begin with a digit and is not a reserved word"
LAWS: Mapping[str, Callable[[str], Law]] = {"function": parse_expression}
"""The key of a law in the file, and how its text is read."""
_FUNCTION_KEYS = (*LAWS, "not_executable", "inputs", "quality", "constraint")
_Parsed = TypeVar("_Parsed")


def read_ontology(path: str) -> Ontology:
    """The ontology in a file.

    Raises ModelError with file and line at the first thing that is wrong.
    """
    ontology, errors = load_ontology(path)
    if errors:
        raise errors[0]
    return ontology


def load_ontology(path: str) -> Tuple[Ontology, List[ModelError]]:
    """The valid part of the ontology in a file, and all that is wrong with the rest, in order.

    Raises ModelError if the file as a whole cannot be read.
    """
    sections = read_yaml(path).entry("the ontology", ("properties", "constants", "relations"))
    reader = _Reader()
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
            self.errors.append(error)

    def add_property(self, name: str, value: Value) -> None:
        """Adds one entry of `properties`."""
        self._check_name(name, value, "property")
        unit = symbol = ""
        if value.data is not None:
            entry = value.entry(f"the property {name}", ("unit", "symbol"))
            unit = entry["unit"].string("unit") if "unit" in entry else ""
            symbol = entry["symbol"].string("symbol") if "symbol" in entry else ""
        self.properties[name] = Property(name, unit, symbol, value.where)

    def add_constant(self, name: str, value: Value) -> None:
        """Adds one entry of `constants`."""
        self._check_name(name, value, "constant")
        entry = value.entry(f"the constant {name}", ("value", "unit"), required=("value",))
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
            entry = value.entry(what, _FUNCTION_KEYS)
        laws = [key for key in (*LAWS, "not_executable") if key in entry]
        if len(laws) != 1:
            keys = "', '".join(LAWS)
            raise value.error(f"{what} needs either the key '{keys}' or 'not_executable'")
        if ("not_executable" in entry) != ("inputs" in entry):
            raise value.error(f"{what}: the key 'inputs' belongs to 'not_executable' alone")

        quality = entry["quality"].number("quality") if "quality" in entry else 1.0
        if not 0.0 < quality <= 1.0:
            raise entry["quality"].error(f"quality must be above 0 and at most 1, not {quality:g}")
        constraint = None
        if "constraint" in entry:
            constraint = _parse(entry["constraint"], f"{what}: constraint", parse_constraint)
        law: Optional[Law] = None
        names: List[str] = []
        if laws[0] in LAWS:
            law = _parse(entry[laws[0]], what, LAWS[laws[0]])
            text = law.text
            names += law.names
        else:
            text = entry["not_executable"].string("not_executable")
            names += [item.string("an input") for item in entry["inputs"].sequence("inputs")]
        names += constraint.names if constraint else ()
        self._check_inputs(names, relation, output, value)
        inputs = tuple(dict.fromkeys(name for name in names if name in self.properties))
        self.functions.append(
            TransferFunction(relation, output, inputs, law, quality, constraint, text, value.where)
        )

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
