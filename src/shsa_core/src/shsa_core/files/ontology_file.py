"""Reads the ontology file (docs/reference/ontology.md describes it)."""
from functools import partial
from typing import Any, Callable, Collection, Dict, Iterable, List, Mapping, NamedTuple
from typing import Optional, Sequence, Set, Tuple

from shsa_core.errors import ExpressionError, ModelError, ModelErrors
from shsa_core.files.document import Value, read_yaml
from shsa_core.files.keys import CONSTANT, FUNCTION, ONTOLOGY, PROPERTY
from shsa_core.files.readers import parsed, read_entry, read_keys
from shsa_core.language.expression import Expression, Law, compose
from shsa_core.language.expression import parse_constraint, parse_expression
from shsa_core.language.syntax import NAMING, is_name
from shsa_core.language.vectors import Vector, Vectors, elements, unfold
from shsa_core.model.error import quality_of
from shsa_core.model.ontology import Constant, Ontology, Property, TransferFunction

MOST_ELEMENTS = 10_000
"""Of all vectors and matrices that a file declares."""


def read_ontology(path: str) -> Ontology:
    """Return the ontology in a file. Raises ModelErrors: all that is wrong, with file and line."""
    ontology, errors = load_ontology(path)
    if errors:
        raise ModelErrors(errors)
    return ontology


def load_ontology(path: str) -> Tuple[Ontology, List[ModelError]]:
    """Return the valid part of the ontology in a file, and all that is wrong. Raises ModelError."""
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


class _Place(NamedTuple):
    """The place of an output in a vector of `length`, None: it is a number; `what`: for errors."""

    what: str
    length: int
    place: Optional[int]
    vectors: Vectors

    def read(self, value: Value, key: str, parse: Callable[[str], Any] = parse_expression) -> Any:
        """Return the expression for this place; of a list the item there."""
        if self.place is not None and isinstance(value.data, list):
            if len(value.data) != self.length:
                raise value.error(f"{key} must have {self.length} items, not {len(value.data)}")
            value = value.data[self.place]
        known = self.vectors
        made = lambda text: parse(unfold(text, known, self.length, self.place) if known else text)
        return parsed("expression", made).read(value, key)

    def read_all(self, values: Mapping[str, Value], key: str) -> Dict[str, Expression]:
        return {name: self.read(value, f"{key}: {name}") for name, value in values.items()}


class _Reader:
    def __init__(self, errors: List[ModelError]) -> None:
        self.properties: Dict[str, Property] = {}
        self.constants: Dict[str, Constant] = {}
        self.functions: List[TransferFunction] = []
        self.errors = errors
        self._vectors: Dict[str, Vector] = {}
        self._elements = 0
        self._said: Set[str] = set()

    def collect(self, add: Callable[[], None]) -> None:
        """Call `add` and keep its ModelError."""
        try:
            add()
        except ModelError as error:
            self.errors += [each for each in error.errors if str(each) not in self._said]
            self._said.update(map(str, error.errors))  # each element says the same

    def add_property(self, name: str, value: Value) -> None:
        self._check_name(name, value, self.constants)
        given = {}
        if value.data is not None:
            given = read_entry(value, f"the property {name}", PROPERTY)
        length, names = given.pop("length", None), given.pop("elements", None)
        if names is not None:
            if not names or given or length is not None:
                raise value.error(f"the property {name} has elements, at least one, or other keys")
            self._vectors[name] = names
            return
        if length is None:
            self.properties[name] = Property(name, where=value.where, **given)
            return
        for each in self._vector(name, length, value, self.constants):
            # what is said of an element itself counts
            self.properties.setdefault(each, Property(each, where=value.where, **given))

    def add_constant(self, name: str, value: Value) -> None:
        self._check_name(name, value, self.properties)
        given = read_entry(value, f"the constant {name}", CONSTANT)
        self._add_numbers(name, given.pop("value"), given, value)

    def _add_numbers(self, name: str, number: Any, given: Mapping[str, str], value: Value) -> None:
        if not isinstance(number, tuple):
            if name in self.constants:
                raise value.error(f"the constant {name} is there already, as {name} or an element")
            self.constants[name] = Constant(name, number, where=value.where, **given)
            return
        names = self._vector(name, len(number), value, self.properties)
        for each, part in zip(names, number):
            self._add_numbers(each, part, given, value)
        if names[0] in self._vectors:  # rows of a matrix
            self._vectors[name] = tuple(self._vectors.pop(each) for each in names)

    def _vector(
        self, name: str, length: int, value: Value, others: Collection[str]
    ) -> Sequence[str]:
        """Declare a vector; return the names of its elements, which `others` must not have."""
        self._elements += length
        if self._elements > MOST_ELEMENTS:
            raise value.error(f"all vectors have more than {MOST_ELEMENTS} elements together")
        names = self._vectors[name] = elements(name, length)
        for each in names:
            self._check_name(each, value, others)
        return names

    def add_relation(self, relation: str, outputs: Value) -> None:
        if not is_name(relation):
            raise outputs.error(f"the relation cannot be named {relation!a}; {NAMING}")
        directions = dict(outputs.mapping(f"the relation {relation}"))
        shared: Mapping[str, Value] = {}
        if "where" in directions and "where" not in self.properties:
            where = directions.pop("where")
            shared = FUNCTION["where"].reader.read(where, f"{relation}: where")
        if not directions:
            raise outputs.error(f"the relation {relation} has no output")
        yielded: Set[str] = set()
        for output, value in directions.items():
            vector = self._vectors.get(output)
            what = f"{relation} for {output}"
            names = vector or (output,)
            if not yielded.isdisjoint(names):
                raise value.error(f"{what} yields what the relation yields already")
            yielded.update(names)
            for place, each in enumerate(names):
                at = _Place(what, len(vector or ()), place if vector else None, self._vectors)
                self.collect(partial(self._add_function, relation, each, value, shared, at))

    def _check_name(self, name: str, value: Value, others: Collection[str]) -> None:
        if not is_name(name):
            kind = "property" if others is self.constants else "constant"
            raise value.error(f"a {kind} cannot be named {name!a}; {NAMING}")
        if name in others or name in self._vectors:
            raise value.error(f"the name '{name}' stands for two things")

    def _add_function(
        self, relation: str, output: str, value: Value, shared: Mapping[str, Value], at: "_Place"
    ) -> None:
        what = at.what
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
        if constraint is not None:
            constraint = at.read(constraint, f"{what}: constraint", parse_constraint)
        names = list(given.get("inputs", ()))
        law: Optional[Law] = None
        if "function" in given:
            where = entry.mapping(what).get("where", value)
            function = at.read(given["function"], f"{what}: function")
            own = at.read_all(given.get("where", {}), f"{what}: where")
            steps = at.read_all(shared, f"{relation}: where")
            steps = {**_used(steps, [function, *own.values()]), **own}
            law = self._law(what, function, steps, where)
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
            if name in self.properties or name in self.constants or name in self._vectors:
                kind = "constant" if name in self.constants else "property"
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
