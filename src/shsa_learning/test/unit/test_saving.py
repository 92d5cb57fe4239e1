"""Saving: what is loaded, saved and loaded again is the same, and comments survive."""
import os
import pathlib
import stat
from dataclasses import replace
from typing import Any, List

import pytest
from hypothesis import given, settings, strategies as st

from shsa_core.errors import ModelError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.language.expression import parse_constraint, parse_law
from shsa_core.language.syntax import is_name
from shsa_core.model.error import Error
from shsa_core.model.ontology import Constant, Ontology, Property, TransferFunction
from shsa_learning.saving import save_ontology
from shsa_testing.thorough import many

ROOT = pathlib.Path(__file__).resolve().parents[4]

TEXT = """\
# An ontology with comments.
properties:
  a: {unit: A, symbol: i}     # the first
  # before b
  b: {unit: V}
  c:                          # the last
constants:
  k: {value: 0.39, unit: m}   # measured
relations:
  # about r
  r:                          # two directions
    a: b*k                    # one
    b: a/k                    # the other
  s:
    c:
      function: a + b         # the sum
      quality: 0.9            # a guess
      constraint: b > 10
  laser:
    c: {not_executable: "min(x)", inputs: [a, b]}
"""
COMMENTS = [line.split("#")[1].strip() for line in TEXT.splitlines() if "#" in line]


@pytest.fixture
def file(tmp_path: pathlib.Path) -> pathlib.Path:
    path = tmp_path / "o.yaml"
    path.write_text(TEXT)
    return path


def comments(path: pathlib.Path) -> List[str]:
    return [line.split("#")[1].strip() for line in path.read_text().splitlines() if "#" in line]


def change(ontology: Ontology, **parts: Any) -> Ontology:
    values: Any = dict(
        properties=ontology.properties,
        constants=ontology.constants,
        functions=ontology.functions,
    )
    values.update(parts)
    return Ontology(**values)


def test_saving_what_has_not_changed_changes_nothing(file: pathlib.Path) -> None:
    before = os.stat(str(file)).st_mtime_ns
    save_ontology(read_ontology(str(file)), str(file))
    assert file.read_text() == TEXT and os.stat(str(file)).st_mtime_ns == before


def test_a_new_file_holds_the_same(file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    ontology = read_ontology(str(file))
    copy = tmp_path / "copy.yaml"
    save_ontology(ontology, str(copy))
    assert read_ontology(str(copy)) == ontology
    assert copy.read_text() == (
        "properties:\n"
        "  a: {unit: A, symbol: i}\n"
        "  b: {unit: V}\n"
        "  c:\n"
        "constants:\n"
        "  k: {value: 0.39, unit: m}\n"
        "relations:\n"
        "  r:\n"
        "    a: b*k\n"
        "    b: a/k\n"
        "  s:\n"
        "    c:\n"
        "      function: a + b\n"
        "      quality: 0.9\n"
        "      constraint: b > 10\n"
        "  laser:\n"
        "    c:\n"
        '      not_executable: "min(x)"\n'
        "      inputs: [a, b]\n"
    )
    assert stat.S_IMODE(os.stat(str(copy)).st_mode) == 0o644
    assert sorted(os.listdir(str(tmp_path))) == ["copy.yaml", "o.yaml"]


def test_a_new_relation_leaves_the_rest_and_its_comments(file: pathlib.Path) -> None:
    ontology = read_ontology(str(file))
    learned = TransferFunction(
        "learned",
        "c",
        ("a",),
        parse_law("1.5*a - 2"),
        0.75,
        None,
        "1.5*a - 2",
        error=Error(0.2),
    )
    bigger = change(ontology, functions=(*ontology.functions, learned))
    save_ontology(bigger, str(file))
    assert read_ontology(str(file)) == bigger
    assert comments(file) == COMMENTS
    assert file.read_text().endswith(
        "  learned:\n    c:\n      function: 1.5*a - 2\n      quality: 0.75\n      error: 0.2\n"
    )


def test_what_is_usual_is_saved(file: pathlib.Path) -> None:
    ontology = read_ontology(str(file))
    properties = {**ontology.properties, "b": Property("b", "V", usual=(-1.0, 2.5))}
    bigger = change(ontology, properties=properties)
    save_ontology(bigger, str(file))
    assert read_ontology(str(file)) == bigger
    assert "  b: {unit: V, usual: [-1.0, 2.5]}" in file.read_text()


def test_figures_are_saved_on_one_line(file: pathlib.Path) -> None:
    ontology = read_ontology(str(file))
    error = Error(0.2, -0.1, 0.4, 0.04, 0.8, 100, "drive.bag: 60 s")
    law = parse_law("a")
    new = [
        TransferFunction("by_figures", "c", ("a",), law, 0.75, text="a", error=error),
        TransferFunction("by_word", "c", ("a",), law, 1.0, text="a", error=error),
    ]
    bigger = change(ontology, functions=(*ontology.functions, *new))
    save_ontology(bigger, str(file))
    assert read_ontology(str(file)) == bigger
    text = file.read_text()
    assert text.count("quality: 1.0") == 1 and "quality: 0.75" not in text
    line = (
        'error: {rms: 0.2, bias: -0.1, p95: 0.4, delay: 0.04, baseline: 0.8, n: 100, source: "dri'
    )
    assert text.count(line) == 2


def test_a_new_direction_of_a_relation(file: pathlib.Path) -> None:
    ontology = read_ontology(str(file))
    new = TransferFunction("r", "c", ("a",), parse_law("a"), text="a")
    functions = (*ontology.functions[:2], new, *ontology.functions[2:])
    save_ontology(change(ontology, functions=functions), str(file))
    assert read_ontology(str(file)).functions == functions
    assert comments(file) == COMMENTS


def test_changed_and_removed_entries(file: pathlib.Path) -> None:
    ontology = read_ontology(str(file))
    first = ontology.functions[0]
    changed = TransferFunction("r", "a", ("b",), parse_law("b*2"), 1.0, None, "b*2")
    smaller = Ontology(
        {"a": Property("a", "mA"), "b": ontology.properties["b"], "d": Property("d")},
        {"g": Constant("g", 9.81, "m/s^2")},
        (changed,),
    )
    assert first != changed
    save_ontology(smaller, str(file))
    assert read_ontology(str(file)) == smaller
    text = file.read_text()
    assert "a: {unit: mA}" in text and "g: {value: 9.81, unit: m/s^2}" in text
    assert "two directions" in text and "laser" not in text and "k:" not in text


def test_sections_that_were_not_there_and_empty_ones(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "o.yaml"
    path.write_text("# nothing yet\nproperties:\n")
    ontology = Ontology({"a": Property("a")}, {"k": Constant("k", 1.0)}, ())
    save_ontology(ontology, str(path))
    assert read_ontology(str(path)) == ontology
    assert path.read_text().startswith("# nothing yet\n")
    empty = Ontology({}, {}, ())
    save_ontology(empty, str(path))
    assert read_ontology(str(path)) == empty


def test_one_relation_cannot_yield_a_property_twice(tmp_path: pathlib.Path) -> None:
    one = TransferFunction("r", "a", (), parse_law("1"), text="1")
    other = TransferFunction("r", "a", (), parse_law("2"), text="2")
    with pytest.raises(ModelError, match="r: yields a twice; give one a name of its own"):
        save_ontology(Ontology({"a": Property("a")}, {}, (one, other)), str(tmp_path / "o.yaml"))
    assert os.listdir(str(tmp_path)) == []


def test_a_file_that_is_no_ontology_is_left_alone(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "o.yaml"
    path.write_text("a: !!python/name:os.system\n")
    with pytest.raises(ModelError):
        save_ontology(Ontology({}, {}, ()), str(path))
    assert path.read_text() == "a: !!python/name:os.system\n"


def test_what_is_no_file_is_left_alone(tmp_path: pathlib.Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    for path in (tmp_path, tmp_path / "pipe"):
        with pytest.raises(ModelError):
            save_ontology(Ontology({}, {}, ()), str(path))


def test_a_folder_that_is_not_there(tmp_path: pathlib.Path) -> None:
    with pytest.raises(OSError):
        save_ontology(Ontology({}, {}, ()), str(tmp_path / "no" / "o.yaml"))


def test_a_failed_write_leaves_the_old_file_and_no_other(
    file: pathlib.Path, monkeypatch: Any
) -> None:
    ontology = read_ontology(str(file))

    def fail(source: str, target: str) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("shsa_learning.saving.os.replace", fail)
    with pytest.raises(OSError, match="disk full"):
        save_ontology(change(ontology, functions=()), str(file))
    assert file.read_text() == TEXT
    assert os.listdir(str(file.parent)) == ["o.yaml"]


def test_the_mode_of_the_file_stays(file: pathlib.Path) -> None:
    os.chmod(str(file), 0o600)
    save_ontology(change(read_ontology(str(file)), functions=()), str(file))
    assert stat.S_IMODE(os.stat(str(file)).st_mode) == 0o600


def test_a_link_stays_a_link(file: pathlib.Path, tmp_path: pathlib.Path) -> None:
    (tmp_path / "linked").mkdir()
    link = tmp_path / "linked" / "ontology.yaml"
    link.symlink_to(file)
    ontology = read_ontology(str(link))
    properties = {**ontology.properties, "new": Property("new", "m")}
    save_ontology(replace(ontology, properties=properties), str(link))
    assert link.is_symlink()
    assert "new" in read_ontology(str(file)).properties


STEPS = """\
properties: {v: , u: , i: }
constants: {k: {value: -0.1}}
relations:
  net:
    i:
      where:
        h1: tanh(0.3*v + k)
        sum_: 1.2*h1 - 0.4*u
      function: sum_ + 8.1
      constraint: u > 10
"""


def test_a_relation_with_steps_survives_being_saved_and_changed(tmp_path: pathlib.Path) -> None:
    old, new = tmp_path / "old.yaml", tmp_path / "new.yaml"
    old.write_text(STEPS)
    ontology = read_ontology(str(old))
    (function,) = ontology.functions
    save_ontology(ontology, str(new))
    assert read_ontology(str(new)) == ontology
    save_ontology(replace(ontology, functions=(replace(function, quality=0.5),)), str(old))
    assert read_ontology(str(old)).functions[0].law == function.law
    plain = parse_law("2*v")
    with_plain = replace(ontology, functions=(replace(function, law=plain, text=plain.text),))
    save_ontology(with_plain, str(old))
    assert read_ontology(str(old)).functions[0].law == plain
    assert "where" not in old.read_text()


def test_vectors_stay_where_a_relation_is_added(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "o.yaml"
    file.write_text(
        "properties: {w: {length: 2, unit: m}, v: , m: {elements: [v, u]}, u: }\n"
        "constants: {j: {value: [[1, 2], [3, 4]]}, k: {value: [1, 2]}}\n"
        "relations: {r: {m: 'dot(j, w)'}, s: {v: 'dot(k, w)'}}\n"
    )
    old = read_ontology(str(file))
    more = replace(old.functions[-1], relation="t", output="w_0", inputs=("v",), law=parse_law("v"))
    usual = {**old.properties, "w_1": replace(old.properties["w_1"], usual=(0.0, 1.0))}
    new = replace(old, properties=usual, functions=(*old.functions[:2], replace(more, text="v")))
    save_ontology(new, str(file))
    again = read_ontology(str(file))
    assert (again.properties, again.constants) == (new.properties, new.constants)
    assert again.functions == new.functions
    assert "dot(j, w)" in file.read_text() and "dot(k, w)" not in file.read_text()


def test_the_models_that_come_with_it(tmp_path: pathlib.Path) -> None:
    ontology = read_ontology(str(ROOT / "ontology" / "rover.yaml"))
    save_ontology(ontology, str(tmp_path / "o.yaml"))
    assert read_ontology(str(tmp_path / "o.yaml")) == ontology


NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_]{0,8}", fullmatch=True).filter(is_name)
SPECIAL = [
    "null",
    "true",
    "False",
    "yes",
    "no",
    "on",
    "y",
    "n",
    "~",
    "1",
    "1e5",
    "0x1",
    ".inf",
    "NULL",
]
TEXTS = st.one_of(
    st.sampled_from(SPECIAL), st.text(alphabet="abA1:#{}[]&*!|>'\"%@`,?-. \n\u03a9", max_size=12)
)


@settings(derandomize=True, max_examples=many(200), deadline=None)
@given(
    st.lists(NAMES, min_size=4, max_size=6, unique=True),
    st.lists(TEXTS, min_size=5, max_size=5),
    st.floats(allow_nan=False, allow_infinity=False),
    st.floats(min_value=1e-9, max_value=1.0),
)
def test_any_ontology_survives(
    tmp_path_factory: Any, names: List[str], texts: List[str], value: float, quality: float
) -> None:
    a, b, c, k = names[:4]
    functions = (
        TransferFunction(
            texts[0] if is_name(texts[0]) else "r",
            a,
            (b, c),
            parse_law(f"{b} + {k}"),
            quality,
            parse_constraint(f"{c} > {k}"),
            f"{b} + {k}",
        ),
        TransferFunction("s", b, (c,), None, 1.0, None, texts[4]),
    )
    ontology = Ontology(
        {
            a: Property(a, texts[0], texts[1]),
            b: Property(b, texts[2]),
            c: Property(c, "", texts[3]),
        },
        {k: Constant(k, value, texts[3])},
        functions,
    )
    path = str(tmp_path_factory.mktemp("any") / "o.yaml")
    save_ontology(ontology, path)
    assert read_ontology(path) == ontology
    fewer = change(ontology, functions=functions[1:])
    save_ontology(fewer, path)
    assert read_ontology(path) == fewer


def test_what_the_outputs_of_a_relation_share_stays(tmp_path: pathlib.Path) -> None:
    path = tmp_path / "o.yaml"
    path.write_text(
        "properties: {a: , b: , c: }\n"
        "relations:\n  r:\n    where: {s: 2*c}  # shared\n    a: s + 1\n    b: s + 2\n"
    )
    ontology = read_ontology(str(path))
    first, second = ontology.functions
    changed = change(ontology, functions=(replace(first, quality=0.5), second))
    save_ontology(changed, str(path))
    assert read_ontology(str(path)) == changed
    assert "where: {s: 2*c}  # shared\n" in path.read_text()
