"""Reads the ontology file (docs/reference/ontology.md describes it)."""
from functools import partial
from typing import Callable, Dict, Iterable, List, Mapping, Optional, Tuple

from shsa_core.errors import ExpressionError, ModelError, ModelErrors
from shsa_core.files.document import Value, read_yaml
from shsa_core.files.keys import CONSTANT, FUNCTION, ONTOLOGY, PROPERTY
from shsa_core.files.readers import read_entry, read_keys
from shsa_core.language.expression import Expression, Law, compose
from shsa_core.language.syntax import is_name
from shsa_core.model.error import quality_of
from shsa_core.model.ontology import Constant, Ontology, Property
from shsa_core.model.relation import TransferFunction

_NAMES = "a name has letters, digits and _, does not begin with a digit and is not a reserved word"


def read_ontology(path: str) -> Ontology:
    """Return the ontology in a file. Raises ModelErrors: all that is wrong, with file and line."""
    ontology, errors = load_ontology(path)
    if errors:
        raise ModelErrors(errors)
    return ontology


def load_ontology(path: str) -> Tuple[Ontology, List[ModelError]]:
    """Return the valid part of the ontology in a file, and all that is wrong with the rest.

    Raises ModelError if the file as a whole cannot be read.
    """
    sections, errors = read_keys(read_yaml(path), "the ontology", ONTOLOGY)
    reader = _Reader(errors)
    adding = {
        "properties": reader.add_property,
        "constants": reader.add_constant,
        "relations": reader.add_relation,
    }
    for section, add in adding.items():
        for name, value in sections.get(section, {}).items():
            reader.collect(partial(add, name, value))
    return Ontology(reader.properties, reader.constants, tuple(reader.functions)), reader.errors


class _Reader:
    """Collects what is valid and what is wrong."""

    def __init__(self, errors: List[ModelError]) -> None:
        self.properties: Dict[str, Property] = {}
        self.constants: Dict[str, Constant] = {}
        self.functions: List[TransferFunction] = []
        self.errors = errors

    def collect(self, add: Callable[[], None]) -> None:
        """Call `add` and keep its ModelError."""
        try:
            add()
        except ModelError as error:
            self.errors += error.errors

    def add_property(self, name: str, value: Value) -> None:
        """Add an entry of `properties`."""
        self._check_name(name, value, "property")
        given = {}
        if value.data is not None:
            given = read_entry(value, f"the property {name}", PROPERTY)
        self.properties[name] = Property(name, where=value.where, **given)

    def add_constant(self, name: str, value: Value) -> None:
        """Add an entry of `constants`."""
        self._check_name(name, value, "constant")
        given = read_entry(value, f"the constant {name}", CONSTANT)
        self.constants[name] = Constant(name, where=value.where, **given)

    def add_relation(self, relation: str, outputs: Value) -> None:
        """Add an entry of `relations`, in all its directions."""
        if not is_name(relation):
            raise outputs.error(f"the relation cannot be named {relation!a}; {_NAMES}")
        directions = dict(outputs.mapping(f"the relation {relation}"))
        shared: Dict[str, Expression] = {}
        if "where" in directions and "where" not in self.properties:
            where = directions.pop("where")
            shared = FUNCTION["where"].reader.read(where, f"{relation}: where")
        if not directions:
            raise outputs.error(f"the relation {relation} has no output")
        for output, value in directions.items():
            self.collect(partial(self._add_function, relation, output, value, shared))

    def _check_name(self, name: str, value: Value, kind: str) -> None:
        if not is_name(name):
            raise value.error(f"a {kind} cannot be named {name!a}; {_NAMES}")
        if name in self.properties or name in self.constants:
            raise value.error(f"the name '{name}' is both a property and a constant")

    def _add_function(
        self, relation: str, output: str, value: Value, shared: Mapping[str, Expression]
    ) -> None:
        what = f"{relation} for {output}"
        if output not in self.properties:
            kind = "is a constant" if output in self.constants else "is not in 'properties'"
            raise value.error(f"the relation {relation} yields '{output}', which {kind}")
        entry = value
        if not isinstance(value.data, dict):
            entry = Value(value.where, {"function": value})
        given = read_entry(entry, what, FUNCTION, within=f"{what}: ")
        if ("function" in given) == ("not_executable" in given):
            raise value.error(f"{what} needs either the key 'function' or 'not_executable'")
        if ("not_executable" in given) != ("inputs" in given):
            raise value.error(f"{what}: the key 'inputs' belongs to 'not_executable' alone")
        if "where" in given and "function" not in given:
            raise value.error(f"{what}: the key 'where' belongs to 'function' alone")
        constraint, error = given.get("constraint"), given.get("error")
        names = list(given.get("inputs", ()))
        law: Optional[Law] = None
        if "function" in given:
            where = entry.mapping(what).get("where", value)
            own = given.get("where", {})
            steps = {**_used(shared, [given["function"], *own.values()]), **own}
            law = self._law(what, given["function"], steps, where)
            names += law.names
        names += constraint.names if constraint else ()
        self._check_inputs(names, relation, output, value)
        self.functions.append(
            TransferFunction(
                relation,
                output,
                tuple(dict.fromkeys(name for name in names if name in self.properties)),
                law,
                given.get("quality", quality_of(error)),
                constraint,
                given["not_executable"] if law is None else law.text,
                value.where,
                error,
            )
        )

    def _law(
        self, what: str, function: Expression, steps: Dict[str, Expression], value: Value
    ) -> Law:
        for name in steps:
            if name in self.properties or name in self.constants:
                kind = "property" if name in self.properties else "constant"
                raise value.error(f"{what}: '{name}' under 'where' is the name of a {kind}")
        try:
            return compose(steps, function)
        except ExpressionError as error:
            raise value.error(f"{what}: {error}") from error

    def _check_inputs(self, names: List[str], relation: str, output: str, value: Value) -> None:
        for name in names:
            if name == output:
                raise value.error(f"the relation {relation} uses its own output '{output}'")
            if name not in self.properties and name not in self.constants:
                raise value.error(
                    f"the relation {relation} uses '{name}', "
                    "which is neither in 'properties' nor in 'constants'"
                )


def _used(steps: Mapping[str, Expression], by: Iterable[Expression]) -> Dict[str, Expression]:
    """Return those of some steps, in order, that expressions use, be it through one another."""
    names = {name for each in by for name in each.names}
    for name in reversed(list(steps)):
        names.update(steps[name].names if name in names else ())
    return {name: step for name, step in steps.items() if name in names}
