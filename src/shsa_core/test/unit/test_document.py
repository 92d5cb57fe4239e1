"""YAML and parameters are read as plain values with their place, and nothing else."""
import math
import pathlib
from typing import Any

import audit
import pytest
from hypothesis import given, settings, strategies as st

from shsa_core.errors import ModelError
from shsa_core.files.document import MAX_DEPTH, Value, from_parameters, parse_yaml, read_yaml
from shsa_testing.thorough import many


def plain(value: Value) -> Any:
    if isinstance(value.data, dict):
        return {key: plain(item) for key, item in value.data.items()}
    if isinstance(value.data, list):
        return [plain(item) for item in value.data]
    return value.data


@pytest.mark.parametrize(
    "text, expected",
    [
        ("a: 1", {"a": 1.0}),
        ("a: -0.5", {"a": -0.5}),
        ("a: +1e3", {"a": 1000.0}),
        ("a: 1E-3", {"a": 0.001}),
        ("a: .5", {"a": 0.5}),
        ("a: 5.", {"a": 5.0}),
        ("a: 010", {"a": 10.0}),
        ("a: '1'", {"a": "1"}),
        ('a: "1"', {"a": "1"}),
        ("a: 1:30", {"a": "1:30"}),
        ("a: 0x10", {"a": "0x10"}),
        ("a: 1_000", {"a": "1_000"}),
        ("a: 2020-01-01", {"a": "2020-01-01"}),
        ("a: nan", {"a": "nan"}),
        ("a: true", {"a": True}),
        ("a: False", {"a": False}),
        ("a: yes", {"a": "yes"}),
        ("a: on", {"a": "on"}),
        ("a: 'true'", {"a": "true"}),
        ("a:", {"a": None}),
        ("a: ~", {"a": None}),
        ("a: null", {"a": None}),
        ("a: ''", {"a": ""}),
        ("a: [1, b, {c: 2}]", {"a": [1.0, "b", {"c": 2.0}]}),
        ("a:\n  - 1\n  - [2]\n", {"a": [1.0, [2.0]]}),
        ("on: 1\n1: 2\n'x y': 3", {"on": 1.0, "1": 2.0, "x y": 3.0}),
        ("a: b\n  c", {"a": "b c"}),
        ("a: |\n  b\n  c\n", {"a": "b\nc\n"}),
        ("a: {b: {c: {d: e}}}", {"a": {"b": {"c": {"d": "e"}}}}),
        ("--- {a: 1}\n...\n", {"a": 1.0}),
        ("%YAML 1.1\n---\na: 1", {"a": 1.0}),
        ("", None),
        ("# nothing", None),
        ("---", None),
        ("text", "text"),
        ("- 1", [1.0]),
    ],
)
def test_values(text: str, expected: Any) -> None:
    assert plain(parse_yaml(text, "f")) == expected


def test_infinities_and_nan_are_numbers_that_are_refused_where_one_is_needed() -> None:
    values: Any = parse_yaml("[.inf, -.inf, .nan, .NaN, -.Inf]", "f").sequence("it")
    assert values[0].data == math.inf and values[1].data == -math.inf
    assert all(math.isnan(values[i].data) for i in (2, 3)) and values[4].data == -math.inf
    for value in values:
        with pytest.raises(ModelError, match="must be a finite number"):
            value.number("it")


def test_every_value_knows_its_line() -> None:
    tree: Any = parse_yaml(
        "# first\na:\n  b: 1\n  c:\n    - 2\n    - d:\n        3\ne: {f: 1,\n  g: 2}", "x.yaml"
    )
    a, e = tree.data["a"], tree.data["e"]
    assert a.where == "x.yaml:2"
    assert a.data["b"].where == "x.yaml:3"
    assert [item.where for item in a.data["c"].data] == ["x.yaml:5", "x.yaml:6"]
    assert a.data["c"].data[1].data["d"].where == "x.yaml:6"  # where its key stands
    assert e.data["g"].where == "x.yaml:9"


@pytest.mark.parametrize(
    "text, line, what",
    [
        ("a: 1\na: 2", 2, "the key 'a' stands here a second time"),
        ("a: {b: 1, b: 2}", 1, "the key 'b' stands here a second time"),
        ("a: 1\n'a': 2", 2, "a second time"),
        ("a: &x 1\nb: *x", 1, "anchors (&) and aliases (*) are not allowed"),
        ("a: *x", 1, ""),
        ("a: &x [1]", 1, "anchors"),
        ("a: &x {b: 1}", 1, "anchors"),
        ("&x a: 1", 1, "anchors"),
        ("x: 1\na: !!python/object/apply:os.system ['true']", 2, "tags are not allowed: tag:yaml"),
        ("a: !!python/name:os.system", 1, "tags are not allowed"),
        ("a: !radians '1'", 1, "tags are not allowed: !radians"),
        ("a: !degrees 90", 1, "tags are not allowed: !degrees"),
        ("a: !!float 1", 1, "tags are not allowed"),
        ("a: !!str 1", 1, "tags are not allowed"),
        ("a: ! 1", 1, "tags are not allowed"),
        ("!!map {a: 1}", 1, "tags are not allowed"),
        ("!!python/dict {a: 1}", 1, "tags are not allowed"),
        ("!x a: 1", 1, "tags are not allowed"),
        ("a: 1\n---\nb: 2", 2, "a second document begins"),
        ("? [a]\n: 1", 1, "a key must be a plain text"),
        ("? {a: b}\n: 1", 1, "a key must be a plain text"),
        ("a: [1", None, "is not valid YAML"),
        ("a: 1\n b: 2", 2, "is not valid YAML"),
        ("a: b: c", 1, "is not valid YAML"),
        ("a: '1", None, "is not valid YAML"),
        ("\ta: 1", 1, "is not valid YAML"),
        ("a: @b", 1, "is not valid YAML"),
        ("a: `b", 1, "is not valid YAML"),
        ("a: %b", 1, "is not valid YAML"),
        ("a: {unit: %}", 1, "cannot start any token: put it in quotes: '%'"),
        ("a: 1\nb: {unit: %, symbol: x}", 2, "put it in quotes: '%'"),
        ("a: @b c", 1, "put it in quotes: '@b'"),
        ("a: @b|c", 1, "put it in quotes: '@b|c'"),
        ("a:\n\tb: 1", 2, "a tab; indent with spaces"),
        ("a:\n  b 1\n  c: 2", 3, "the line before lacks a colon or a space after it"),
        ("a:\n  b: 1\n    c: 2", 3, "or this one is indented too far"),
        ("a: b: c", 1, "put a text that has a colon in quotes"),
        ("a:\n  x: 1\n  b:1\n  c: 2", 3, "this line lacks a colon, or a space after it"),
        ("a: 1\nb: '2\nc: 3\nd: 4\n", 2, "the quote that begins here has no end"),
        ("a:\n  b: 1\n c: 2", 3, "its indentation differs from that of the lines above"),
        ("a: 'it's'", 1, "a quote or a bracket ends too soon"),
        ("x: 1\na: {b: 1,\n  c: 2\nd: 3", 4, "the bracket of line 2 has no end"),
        ("x: 1\na: {b: [1, 2}\n", 2, "the bracket of line 2 has no end"),
        ("a: {b: 1\n", 2, "the bracket of line 1 has no end"),
        ("a: [\n  {b: 1} {c: 2}]", 2, "a comma is missing, or the bracket"),
        ("a: \x07", None, "is not valid YAML"),
        ("a: }", 1, "is not valid YAML"),
        ("[" * (MAX_DEPTH + 1), 1, f"is nested more than {MAX_DEPTH} deep"),
        ("[" * 100_000, 1, "is nested more than"),
        ("{a: " * 50_000, 1, "is nested more than"),
        ("- " * 50_000 + "a", 1, "is nested more than"),
    ],
)
def test_refusals_name_file_and_line(text: str, line: int, what: str) -> None:
    with audit.recorded() as events:
        with pytest.raises(ModelError) as caught:
            parse_yaml(text, "x.yaml")
    assert what in caught.value.what
    if line is not None:
        assert caught.value.where == f"x.yaml:{line}"
    assert not {"exec", "os.system", "subprocess.Popen"} & set(events)


def test_a_bomb_of_aliases_is_refused() -> None:
    lines = ["a0: &a0 [x, x]"] + [f"a{i}: &a{i} [*a{i - 1}, *a{i - 1}]" for i in range(1, 60)]
    with pytest.raises(ModelError, match="x.yaml:1: anchors"):
        parse_yaml("\n".join(lines), "x.yaml")


def test_files_that_cannot_be_read(tmp_path: pathlib.Path) -> None:
    with pytest.raises(ModelError, match="nowhere.yaml: cannot be read: No such file"):
        read_yaml(str(tmp_path / "nowhere.yaml"))
    with pytest.raises(ModelError, match="cannot be read: Is a directory"):
        read_yaml(str(tmp_path))
    broken = tmp_path / "broken.yaml"
    broken.write_bytes(b"a: 1\nb: \xff\n")
    with pytest.raises(ModelError, match="broken.yaml:2: is not UTF-8"):
        read_yaml(str(broken))


def test_a_byte_order_mark_and_other_letters(tmp_path: pathlib.Path) -> None:
    file = tmp_path / "a.yaml"
    file.write_bytes("\ufeffa: \u03a9".encode("utf-8"))
    assert plain(read_yaml(str(file))) == {"a": "\u03a9"}


def test_parameters_become_values_with_their_names() -> None:
    tree: Any = from_parameters(
        {"v": [{"period": 1, "on": True, "text": "1", "none": None}]}, "/shsa/som"
    )
    assert plain(tree) == {"v": [{"period": 1.0, "on": True, "text": "1", "none": None}]}
    entry = tree.data["v"].data[0]
    assert entry.where == "/shsa/som/v[0]"
    assert entry.data["period"].where == "/shsa/som/v[0]/period"
    assert plain(from_parameters((1, 2.5), "/p")) == [1.0, 2.5]
    assert from_parameters(10**400, "/p").data == math.inf
    assert from_parameters(3, "/p").text == "3" and from_parameters(False, "/p").text == "false"
    assert plain(from_parameters({1: 2}, "/p")) == {"1": 2.0}


def test_parameters_of_other_kinds_and_depths_are_refused() -> None:
    strange: Any = from_parameters({"a": b"x"}, "/p").data
    for ask in ("number", "string", "flag", "sequence", "mapping"):
        with pytest.raises(ModelError, match="^/p/a: it must be .*, not a bytes"):
            getattr(strange["a"], ask)("it")
    deep: Any = 1
    for _ in range(MAX_DEPTH + 1):
        deep = [deep]
    value: Any = from_parameters(deep, "/p")
    for _ in range(MAX_DEPTH + 1):
        (value,) = value.data
    with pytest.raises(ModelError, match="must be a number, not nested more than"):
        value.number("it")
    assert plain(from_parameters(deep[0], "/p")) == deep[0]


def test_what_a_value_must_be() -> None:
    value: Any = parse_yaml("{n: 1, t: abc, f: true, l: [1], m: {a: 1}, e: }", "f").data
    assert value["n"].number("n") == 1.0
    assert value["t"].string("t") == "abc" and value["n"].string("n") == "1"
    assert value["f"].string("f") == "true"
    assert value["f"].flag("f") is True
    assert len(value["l"].sequence("l")) == 1
    for key, ask, message in [
        ("t", "number", "it must be a number, not the text 'abc'"),
        ("f", "number", "it must be a number, not true"),
        ("n", "flag", "it must be true or false, not 1"),
        ("e", "flag", "it must be true or false, not empty"),
        ("m", "sequence", "it must be a list, not a mapping"),
        ("l", "mapping", "it must be a mapping (name: value), not a list"),
        ("m", "string", "it must be a text, not a mapping"),
        ("l", "string", "it must be a text, not a list"),
        ("e", "string", "it must be a text, not empty"),
    ]:
        with pytest.raises(ModelError) as caught:
            getattr(value[key], ask)("it")
        assert caught.value.what == message
    assert Value("f:1", "x" * 100, "x" * 100).describe() == f"the text '{'x' * 57}...'"


def test_wrong_keys_are_told() -> None:
    value = parse_yaml("a: 1\nqality: 2", "f")
    told = lambda *keys: [str(error) for error in value.wrong_keys("it", *keys)]
    near = "f:2: it has no key 'qality'; allowed: a, quality; did you mean quality?"
    assert told(["a", "quality"]) == [near]
    assert told(["a"]) == ["f:2: it has no key 'qality'; allowed: a"]
    assert told(["a", "qality", "b"], ["a", "b"]) == ["f:1: it lacks the key 'b'"]
    assert told(["a", "qality", "c"], ["a"]) == []


@settings(derandomize=True, max_examples=many(1500), deadline=None)
@given(st.text(alphabet="ab1.:,-?!&*|>'\"%@`#{}[]~ \n\t\\<=", max_size=60))
def test_random_texts_are_read_or_refused(text: str) -> None:
    try:
        parse_yaml(text, "x.yaml")
    except ModelError as error:
        assert error.where.startswith("x.yaml") and error.what
