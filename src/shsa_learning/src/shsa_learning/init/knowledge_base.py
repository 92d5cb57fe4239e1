"""Reads the knowledge-base files that were published with the predecessor library."""
from dataclasses import dataclass
from typing import Dict, List, Optional, Set, Tuple

from shsa_core.errors import ExpressionError
from shsa_core.files.document import Entry, Value, read_yaml
from shsa_core.language.expression import (
    Condition,
    Law,
    compose,
    parse_constraint,
    parse_expression,
)
from shsa_core.language.syntax import is_name
from shsa_core.model.ontology import Constant, Ontology, Property, TransferFunction
from shsa_learning.init.knowledge_text import inserted, reduced, translated


@dataclass(frozen=True)
class Provision:
    """A service as far as the knowledge base knows it: its path, and the rest if it is given.

    The path is topic and field in one: where the field begins is not said. It is empty where all
    that is known is that something provides the property. `period` in s, `quality` in (0, 1].
    `reduction`: what makes one number of the array that is there, such as `min`.
    """

    property: str
    path: str
    needed: bool = False
    period: Optional[float] = None
    quality: Optional[float] = None
    reduction: str = ""


@dataclass(frozen=True)
class KnowledgeBase:
    """The contents of such a file, and notes on what could not be taken over."""

    ontology: Ontology
    provisions: Tuple[Provision, ...]
    notes: Tuple[str, ...]


def read_knowledge_base(path: str) -> KnowledgeBase:
    """Read a knowledge base. Raises ModelError with file and line if the file is none."""
    return _Reader(read_yaml(path)).read()


class _Reader:
    def __init__(self, document: Value) -> None:
        self._document = document
        self._sections = document.mapping("a knowledge base")
        properties = self._sections.get("properties")
        self._tables: Entry = properties.mapping("properties") if properties else {}
        self._properties: Dict[str, Property] = {}
        self._constants: Dict[str, Constant] = {}
        self._functions: List[TransferFunction] = []
        self._provisions: List[Provision] = []
        self._notes: List[Tuple[int, str]] = []
        # By the name of an array: what stands for a number that is made of it, and how it is made.
        self._reduced: Dict[str, Dict[str, str]] = {}
        self._plain: Set[str] = set()  # what is used as it is

    def read(self) -> KnowledgeBase:
        """Read the whole file."""
        if "relations" not in self._sections and "graph" not in self._sections:
            raise self._document.error("a knowledge base has the key 'relations' (or 'graph')")
        self._read_constants()
        if "graph" in self._sections:
            self._read_graph()
        if "relations" in self._sections:
            self._read_relations()
        self._read_provisions()
        self._note_the_rest()
        ontology = Ontology(self._properties, self._constants, tuple(self._functions))
        notes = tuple(note for _, note in sorted(self._notes))
        return KnowledgeBase(ontology, tuple(self._provisions), notes)

    def _table(self, name: str) -> Entry:
        value = self._tables.get(name)
        return value.mapping(name) if value is not None and value.data is not None else {}

    def _note(self, value: Value, what: str) -> None:
        line = int(value.where.rsplit(":", 1)[1])
        self._notes.append((line, f"{value.where}: {what}"))

    def _read_constants(self) -> None:
        provisions = self._table("provision")
        marked = self._table("constant")
        for name, value in {**provisions, **marked}.items():
            number = _number(value)
            if number is None and value.data is True and name in provisions:
                number = _number(provisions[name])
            if number is not None:
                self._check_name(name, value)
                self._constants[name] = Constant(name, number, where=value.where)
            elif name in marked:
                self._note(value, f"{name} is marked constant but has no number; it is a property")

    def _read_relations(self) -> None:
        for relation, outputs in self._sections["relations"].mapping("relations").items():
            self._check_name(relation, outputs)
            for output, entry in outputs.mapping(f"the relation {relation}").items():
                what = f"{relation} for {output}"
                for error in entry.wrong_keys(what, ("in", "fct", "constraint"), ["in"]):
                    raise error
                keys = entry.mapping(what)
                inputs = [item.string("an input") for item in keys["in"].sequence("in")]
                text = keys["fct"].text if "fct" in keys else ""
                condition = keys["constraint"].text if "constraint" in keys else ""
                self._add_function(relation, output, inputs, text, condition, entry)

    def _read_graph(self) -> None:
        """Read the form without functions: nodes with successors, and which are relations."""
        types = self._table("type")
        relations = {name for name, value in types.items() if value.data == 1.0}
        inputs: Dict[str, List[str]] = {}
        outputs: Dict[str, List[Tuple[str, Value]]] = {}
        for node, successors in self._sections["graph"].mapping("graph").items():
            for item in successors.sequence(f"the successors of {node}"):
                other = item.string("a node")
                if (node in relations) == (other in relations):
                    raise item.error(f"{node} and {other}: one of them must have the type 1")
                if node in relations:
                    outputs.setdefault(node, []).append((other, item))
                else:
                    inputs.setdefault(other, []).append(node)
        for relation, targets in outputs.items():
            for output, item in targets:
                self._check_name(relation, item)
                self._add_function(relation, output, inputs.get(relation, []), "", "", item)

    def _add_function(
        self,
        relation: str,
        output: str,
        inputs: List[str],
        text: str,
        condition: str,
        value: Value,
    ) -> None:
        name = f"{relation} for {output}"
        if output in inputs:
            return self._note(value, f"{name} is left out: it uses its own output")
        if output in self._constants:
            return self._note(value, f"{name} is left out: {output} is a constant")
        if condition == "False":
            return self._note(value, f"{name} is left out: its constraint is never true")
        law, reductions = reduced(translated(text), set(inputs) - self._constants.keys())
        where = inserted(translated(condition), output, law) if condition != "True" else ""
        expression, constraint, reason = _executable(law, where, {*inputs, *reductions})
        taken = [each for each in reductions if each in inputs or each in self._table("provision")]
        if taken:
            expression, reason = None, f"{taken[0]} is the name of something else"
        if expression is not None:
            for name_, (reduction, array) in reductions.items():
                self._reduced.setdefault(array, {})[name_] = reduction
            used_plainly = {*expression.names, *(constraint.names if constraint else ())}
            arrays = {array for _, array in reductions.values()} - used_plainly
            inputs = [*(i for i in inputs if i not in arrays), *reductions]
            if law != text or where != condition:
                said = law + (f", if {where}" if where else "")
                self._note(value, f"{name} is taken over as {said}")
        self._plain.update(inputs)
        for item in [output, *inputs]:
            self._add_property(item, value)
        if expression is None:
            self._note(value, f"{name} cannot be executed: {reason}")
            text = f"{text} if {condition}" if condition else text
            used = inputs
        else:
            used = [*expression.names, *(constraint.names if constraint else ())]
            unused = [item for item in inputs if item not in used]
            if unused:
                self._note(value, f"{name} does not use its input {', '.join(unused)}")
            text = expression.text
        names = tuple(dict.fromkeys(item for item in used if item in self._properties))
        self._functions.append(
            TransferFunction(
                relation, output, names, expression, 1.0, constraint, text, value.where
            )
        )

    def _read_provisions(self) -> None:
        details = self._sections.get("provision_properties")
        by_path = details.mapping("provision_properties") if details else {}
        for name, value in self._table("provided").items():
            self._add_property(name, value)
            if value.data is True or value.data == 1.0:
                self._note(value, f"{name} is provided, but by no topic that is named")
                if name in self._properties and not _paths(self._table("provision").get(name)):
                    self._add_provision(name, "")
        needs = self._table("need")
        for name, value in {**needs, **self._table("provision")}.items():
            if name in self._constants:
                continue
            if name in self._plain or name not in self._reduced:
                self._add_property(name, value)
            paths = dict.fromkeys(
                [*_paths(self._table("provision").get(name)), *_paths(needs.get(name))]
            )
            for path in paths:
                for number, reduction in self._reduced.get(name, {}).items():
                    self._add_provision(name, path, by_path.get(path), number, reduction)
                if name in self._properties:
                    self._add_provision(name, path, by_path.get(path))
            if name in needs and not paths and _truth(needs[name]):
                self._note(needs[name], f"{name} is needed, but no topic is named")

    def _add_provision(
        self,
        name: str,
        path: str,
        value: Optional[Value] = None,
        number: str = "",
        reduction: str = "",
    ) -> None:
        """Adds a service of a property, or of a `number` that a reduction makes of it."""
        detail = value.mapping(path) if value is not None and value.data is not None else {}
        needs = self._table("need").get(name)
        needed = needs is not None and (
            path in _paths(needs) or not _paths(needs) and _truth(needs)
        )
        quality = _number(detail.get("accuracy", self._table("accuracy").get(name)))
        rate = _number(detail.get("pubrate", self._table("pubrate").get(name)))
        period = 1.0 / rate if rate else _number(self._table("period").get(name))
        self._provisions.append(Provision(number or name, path, needed, period, quality, reduction))

    def _note_the_rest(self) -> None:
        taken = {"provision", "provided", "constant", "need", "accuracy", "period", "pubrate"}
        for name, value in self._tables.items():
            if name not in taken | {"type", "description", "fct"}:
                self._note(value, f"the table '{name}' is not taken over")
        for name, value in self._sections.items():
            if name not in ("relations", "graph", "properties", "provision_properties"):
                self._note(value, f"the section '{name}' is not taken over; nothing in it is run")

    def _add_property(self, name: str, value: Value) -> None:
        if name not in self._constants and name not in self._properties:
            self._check_name(name, value)
            self._properties[name] = Property(name, where=value.where)

    def _check_name(self, name: str, value: Value) -> None:
        if not is_name(name):
            raise value.error(
                f"{name!a} cannot be a name here: use letters, digits and _, and no reserved word"
            )


def _executable(
    text: str, condition: str, inputs: Set[str]
) -> Tuple[Optional[Law], Optional[Condition], str]:
    """Return the function and its constraint, or why they are not expressions of the language."""
    try:
        expression = compose({}, parse_expression(text))
        constraint = parse_constraint(condition) if condition else None
    except ExpressionError as error:
        return None, None, str(error)
    names = [*expression.names, *(constraint.names if constraint else ())]
    foreign = [name for name in names if name not in inputs]
    if foreign:
        return None, None, f"'{foreign[0]}' is not among its inputs"
    return expression, constraint, ""


def _number(value: Optional[Value]) -> Optional[float]:
    """Return the number that the value is, or the one number in its list."""
    if value is not None and isinstance(value.data, list) and len(value.data) == 1:
        value = value.data[0]
    return value.data if value is not None and isinstance(value.data, float) else None


def _paths(value: Optional[Value]) -> List[str]:
    """Return the texts in the value's list."""
    items = value.data if value is not None and isinstance(value.data, list) else []
    return [item.text for item in items if isinstance(item.data, str)]


def _truth(value: Value) -> bool:
    return value.data is True or (isinstance(value.data, float) and value.data != 0.0)
