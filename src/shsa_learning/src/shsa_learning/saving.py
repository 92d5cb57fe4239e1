"""Writes ontology files. What has not changed keeps its text and its comments."""
import io
import os
import re
from typing import Any, Dict, Iterable, List, Mapping, Optional, Tuple

from ruamel.yaml import YAML
from ruamel.yaml.comments import CommentedMap, CommentedSeq
from ruamel.yaml.scalarstring import DoubleQuotedScalarString

from shsa_core.errors import ModelError
from shsa_core.files.keys import CONSTANT, PROPERTY
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.readers import plain, plain_entry
from shsa_core.files.regular import read_text
from shsa_core.model.error import Error, quality_of
from shsa_core.model.ontology import Constant, Ontology, Property, TransferFunction
from shsa_learning.whole_file import write_whole

_PLAIN = re.compile(r"[A-Za-z][A-Za-z0-9_/*^%]*\Z")
_WIDTH = 4096  # lines are not wrapped


def save_ontology(ontology: Ontology, path: str) -> None:
    """Write the ontology to a file. An ontology that is there already is edited: comments survive.

    Raises ModelError if the file is there and is not an ontology, OSError if it cannot be written.
    """
    tree, old = CommentedMap(), Ontology({}, {}, ())
    if os.path.exists(path):
        old = read_ontology(path)
        if old == ontology:
            return
        tree = load(path)
    sections: List[Tuple[str, Mapping[str, Any], Mapping[str, Any], Any]] = [
        ("properties", old.properties, ontology.properties, _property_entry),
        ("constants", old.constants, ontology.constants, _constant_entry),
    ]
    for name, before, after, entry in sections:
        changed = {key: entry(item) for key, item in after.items() if before.get(key) != item}
        _update(_section(tree, name, bool(after)), before, after, changed)
    _update_relations(tree, old.functions, ontology.functions)
    dump(tree, path)


def _update_relations(
    tree: CommentedMap, before: Iterable[TransferFunction], after: Iterable[TransferFunction]
) -> None:
    old = {(function.relation, function.output): function for function in before}
    relations: Dict[str, Dict[str, TransferFunction]] = {}
    for function in after:
        directions = relations.setdefault(function.relation, {})
        if function.output in directions:
            raise ModelError(
                function.relation, f"yields {function.output} twice; give one a name of its own"
            )
        directions[function.output] = function
    section = _section(tree, "relations", bool(relations))
    names = [relation for relation, _ in old]
    _update(
        section,
        names,
        relations,
        {name: CommentedMap() for name in relations if name not in section},
    )
    for name, directions in relations.items():
        changed = {
            output: _function_entry(function)
            for output, function in directions.items()
            if old.get((name, output)) != function
        }
        outputs = [output for relation, output in old if relation == name]
        _update(section[name], outputs, directions, changed)


def _section(tree: CommentedMap, name: str, wanted: bool) -> CommentedMap:
    if tree.get(name) is None and wanted:
        tree[name] = CommentedMap()
    section = tree.get(name)
    return CommentedMap() if section is None else section


def _update(
    section: CommentedMap, before: Iterable[str], after: Iterable[str], changed: Mapping[str, Any]
) -> None:
    """Remove the entries that are gone and set the changed ones; vectors and `where` stay."""
    gone = set(before) - set(after)
    for key in [key for key in section if str(key) in gone]:
        del section[key]
    for key, entry in changed.items():
        section[key] = entry


def _text(text: str) -> str:
    """Return the text, quoted unless any parser reads it the same without."""
    return text if _PLAIN.match(text) else DoubleQuotedScalarString(text)


def _one_line(entries: Mapping[str, Any]) -> CommentedMap:
    """Return entries that are written on one line, lists too, and texts in quotes if need be."""
    line = CommentedMap()
    for key, value in entries.items():
        if isinstance(value, list):
            value = CommentedSeq(value)
            value.fa.set_flow_style()
        line[key] = _text(value) if isinstance(value, str) else value
    line.fa.set_flow_style()
    return line


def _property_entry(item: Property) -> Optional[CommentedMap]:
    entry = plain_entry(item, PROPERTY)
    return _one_line({key: value for key, value in entry.items() if value != ""}) or None


def _constant_entry(item: Constant) -> CommentedMap:
    entry = plain_entry(item, CONSTANT)
    return _one_line({key: value for key, value in entry.items() if value != ""})


def _function_entry(function: TransferFunction) -> Any:
    entry = CommentedMap()
    if function.law is not None:
        if function.law.steps:
            entry["where"] = {name: step.text for name, step in function.law.steps}
        entry["function"] = function.law.result.text
    else:
        entry["not_executable"] = _text(function.text)
        entry["inputs"] = CommentedSeq(function.inputs)
        entry["inputs"].fa.set_flow_style()
    if function.quality != quality_of(function.error):
        entry["quality"] = function.quality
    if function.constraint is not None:
        entry["constraint"] = function.constraint.text
    if function.error is not None:
        entry["error"] = _error_entry(function.error)
    return entry["function"] if list(entry) == ["function"] else entry


def _error_entry(error: Error) -> Any:
    entry = plain(error)
    return _one_line(entry) if isinstance(entry, dict) else entry


def _editor() -> YAML:
    editor = YAML()
    editor.preserve_quotes = True  # type: ignore[assignment]
    editor.width = _WIDTH  # type: ignore[assignment]
    editor.indent(mapping=2, sequence=4, offset=2)
    return editor


def load(path: str) -> CommentedMap:
    """Return the tree of a YAML file, with its comments."""
    tree = _editor().load(read_text(path))
    _plain_exponents(tree)
    return CommentedMap() if tree is None else tree


def _plain_exponents(tree: Any) -> None:
    """Make floats of numbers that have an exponent: others ruamel.yaml writes inexactly."""
    if isinstance(tree, (CommentedMap, CommentedSeq)):
        keys = tree.keys() if isinstance(tree, CommentedMap) else range(len(tree))
        for key in keys:
            if getattr(tree[key], "_exp", None) is not None:
                tree[key] = float(tree[key])
            _plain_exponents(tree[key])


def _without_tags(text: str) -> str:
    """Return what is written, with null as newer versions of ruamel.yaml than 0.15 have it."""
    return text.replace("!!null ''", "null")


def dump(tree: CommentedMap, path: str) -> None:
    """Write the file as a whole or not at all."""
    text = io.StringIO()
    _editor().dump(tree, text, transform=_without_tags)
    write_whole(path, text.getvalue())
