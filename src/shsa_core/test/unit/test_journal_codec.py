"""The codec: every event and command goes through JSON without loss, and nothing else comes in."""
import json
import math
from dataclasses import dataclass, fields, is_dataclass
from typing import (
    Any,
    Callable,
    Dict,
    FrozenSet,
    List,
    Mapping,
    Tuple,
    Union,
    get_args,
    get_type_hints,
)

import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from shsa_testing import toy_machine as toy
from shsa_core.dispatch import members
from shsa_core.errors import ModelError
from shsa_core.journal.codec import Codec
from shsa_core.journal.machines import MACHINES, machine_kind
from shsa_core.language.expression import Condition, Law, parse_constraint, parse_law
from shsa_core.model.checks import REGISTRY, Check, OutOfRange, Stuck
from shsa_core.model.ontology import Constant, Ontology, Property, TransferFunction
from shsa_core.model.service import Service
from shsa_core.model.som import Som
from shsa_testing.thorough import many

EXPRESSIONS = st.sampled_from(["a + b*2", "sqrt(a)", "a if b > 1 else 0", "derivative(a)", "1e-3"])


def of(hint: Any) -> st.SearchStrategy:
    """Random values of a type."""
    return st.from_type(hint)


def record(cls: Any) -> st.SearchStrategy:
    """Random objects of a dataclass, every field that its constructor takes at random."""
    hints = get_type_hints(cls)
    return st.builds(cls, **{each.name: of(hints[each.name]) for each in fields(cls) if each.init})


st.register_type_strategy(
    Check, st.sampled_from(sorted(REGISTRY)).flatmap(lambda n: record(REGISTRY[n]))
)
st.register_type_strategy(Service, record(Service))
st.register_type_strategy(
    Som, st.lists(record(Service), max_size=3, unique_by=lambda service: service.name).map(Som)
)
st.register_type_strategy(Law, EXPRESSIONS.map(parse_law))  # type: ignore[type-abstract]
NAMES = st.sampled_from("abc")
QUALITIES = st.sampled_from([1.0, 0.9, 1 / 3])
st.register_type_strategy(
    TransferFunction,
    st.builds(
        TransferFunction,
        NAMES,
        NAMES,
        st.lists(NAMES, max_size=2).map(tuple),
        st.none() | EXPRESSIONS.map(parse_law),
        QUALITIES,
        st.none() | st.just(parse_constraint("a > 10 and b < 3")),
        st.text(),
        st.text(),
    ),
)
st.register_type_strategy(
    Ontology,
    st.builds(
        Ontology,
        st.dictionaries(NAMES, record(Property)),
        st.dictionaries(NAMES, record(Constant)),
        st.lists(of(TransferFunction), max_size=3).map(tuple),
    ),
)


def same(one: Any, other: Any) -> bool:
    """Return whether two values are the same in every detail, NaN included."""
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return list(one) == list(other) and all(same(one[key], other[key]) for key in one)
    if type(one) is not type(other):
        return False
    if isinstance(one, float) and math.isnan(one):
        return math.isnan(other)
    if is_dataclass(one):
        names = [each.name for each in fields(one) if each.init]
        return all(same(getattr(one, name), getattr(other, name)) for name in names)
    if isinstance(one, Som):
        return same(tuple(one), tuple(other))
    if isinstance(one, (tuple, list)):
        return len(one) == len(other) and all(same(*pair) for pair in zip(one, other))
    return bool(one == other) and (isinstance(one, frozenset) or repr(one) == repr(other))


def through_json(codec: Codec, value: Any) -> Any:
    text = json.dumps(codec.encode(value), allow_nan=False)
    return codec.decode(json.loads(text), "file:1", "the event")


THOROUGH = settings(max_examples=many(50), deadline=None, suppress_health_check=list(HealthCheck))


@pytest.mark.parametrize("cls", [*get_args(toy.Event), *get_args(toy.Command), Ontology, Som])
def test_nothing_is_lost(cls: Any) -> None:
    union = {**dict.fromkeys(get_args(toy.Event), toy.Event), Ontology: Ontology, Som: Som}
    codec = Codec(union.get(cls, toy.Command))

    @THOROUGH
    @given(of(cls) if cls in (Ontology, Som) else record(cls))
    def check(value: Any) -> None:
        assert same(through_json(codec, value), value)

    check()


@pytest.mark.parametrize("machine", list(MACHINES))
def test_nothing_of_what_a_machine_hears_and_says_is_lost(machine: str) -> None:
    kind = machine_kind(machine)
    part = MACHINES[machine].split(".", maxsplit=1)[0]
    events = __import__(f"shsa_core.{part}.events", fromlist=["Event"])
    for codec, union in ((kind.events, events.Event), (kind.commands, events.Command)):
        for cls in members(union):

            @settings(THOROUGH, max_examples=many(20))
            @given(record(cls))
            def check(value: Any) -> None:
                assert same(through_json(codec, value), value)

            check()


def test_equal_sets_are_equal_text() -> None:
    codec = Codec(toy.Event)
    names = [f"/node_{n}" for n in range(100)]
    one, other = (frozenset(order) for order in (names, reversed(names)))
    assert codec.encode(toy.Added(1.0, names=one))["names"] == sorted(names)
    assert codec.encode(toy.Added(1.0, names=one)) == codec.encode(toy.Added(1.0, names=other))


@pytest.mark.parametrize("number", [math.inf, -math.inf, math.nan, -0.0, 5, 1e-320, 2**60, 0.1])
def test_numbers_stay_exactly_what_they_are(number: float) -> None:
    codec = Codec(toy.Event)
    assert same(through_json(codec, toy.Tick(number)), toy.Tick(number))


def test_a_member_of_a_family_keeps_its_class() -> None:
    codec = Codec(toy.Event)
    data = codec.encode(toy.Added(1.0, check=Stuck(2.0)))
    assert data["check"] == {"class": "Stuck", "limit": 2.0}
    assert codec.decode(data, "", "").check == Stuck(2.0) != OutOfRange(2.0)


def test_a_constraint_is_a_condition() -> None:
    constraint = parse_constraint("a > 10 and b < 3")
    assert through_json(Codec(Condition), constraint) == constraint


Change = Callable[[Dict[str, Any]], object]


@pytest.mark.parametrize(
    "change, told",
    [
        (lambda d: d.update({"class": "System"}), "no class 'System'; there are Added,"),
        (lambda d: d.update({"class": ["Added"]}), "no class ['Added']"),
        (lambda d: d.pop("class"), "no class None"),
        (lambda d: d.update(__class__="x"), "Added has no field '__class__'"),
        (lambda d: d.pop("time"), "the event is no Added"),
        (lambda d: d.update(time="1"), "the event.time must be a number, not '1'"),
        (lambda d: d.update(time=True), "the event.time must be a number, not True"),
        (lambda d: d.update(text=1), "the event.text must be a value of the type str, not 1"),
        (lambda d: d.update(colour=3), "the event.colour must be one of 1, 2, not 3"),
        (lambda d: d.update(colour=[]), "the event.colour must be one of 1, 2, not []"),
        (lambda d: d.update(key=["a"]), "the event.key must be a list of 2"),
        (lambda d: d.update(key=["a", 1]), "the event.key[1] must be a value of the type bool"),
        (lambda d: d.update(either="x"), "the event.either must be a number, not 'x'"),
        (lambda d: d.update(either=[]), "the event.either must be a number, not []"),
        (lambda d: d.update(point=[1]), "the event.point must be an object, not [1]"),
        (lambda d: d.update(point=[]), "the event.point must be an object, not []"),
        (lambda d: d.update(points=1), "the event.points must be a list, not 1"),
        (lambda d: d.update(points=[1]), "the event.points[0] must be an object, not 1"),
        (lambda d: d.update(points=[{"x": 1, "z": 2}]), "points[0]: Point has no field 'z'"),
        (lambda d: d.update(names="ab"), "the event.names must be a list, not 'ab'"),
        (lambda d: d.update(names=["a", 1]), "the event.names[1] must be a value of the type str"),
        (lambda d: d.update(named={"a": "b"}), "the event.named.a must be a value of the type int"),
        (
            lambda d: d.update(check={"class": "Point"}),
            "the event.check: there is no class 'Point'",
        ),
        (lambda d: d.update(check=7 * "123456789 "), "must be an object, not '123456789"),
    ],
)
def test_what_the_program_could_not_have_written_is_refused(change: Change, told: str) -> None:
    codec = Codec(toy.Event)
    data = codec.encode(toy.Added(1.0))
    change(data)
    with pytest.raises(ModelError) as refused:
        codec.decode(data, "journal:7", "the event")
    assert str(refused.value).startswith("journal:7: ") and told in str(refused.value)


@pytest.mark.parametrize(
    "text", ["__import__('os').system('id')", "a.b", "lambda: 0", "open('x')", "", "a[0]"]
)
def test_an_expression_is_checked_when_it_is_read(text: str) -> None:
    with pytest.raises(ModelError):
        Codec(Law).decode(["function", text], "journal:1", "the setup")
    with pytest.raises(ModelError):
        Codec(Condition).decode(text, "journal:1", "the setup")


@pytest.mark.parametrize("data", ["a", "a===", "\u00e4", 5, None, ["AA=="]])
def test_bytes_are_base_64_and_nothing_else(data: Any) -> None:
    codec = Codec(bytes)
    assert codec.encode(b"\0\xff") == "AP8="
    with pytest.raises(ModelError, match="no bytes|type str"):
        codec.decode(data, "journal:1", "the event")
    with pytest.raises(TypeError, match="none of bytes"):
        codec.encode("text")


def test_a_law_that_is_not_in_the_language_is_refused() -> None:
    for text in ("a.b", "h = a", "h = a; b", "h = a; h = b; h", "x = a; x", "; a", "a;", ";"):
        with pytest.raises(ModelError, match="^journal:1: the setup is no Law: "):
            Codec(Law).decode(text, "journal:1", "the setup")


def test_a_field_that_has_a_default_may_be_missing() -> None:
    data = {"class": "Added", "time": 1.5}
    assert Codec(toy.Event).decode(data, "", "") == toy.Added(1.5)


NOT_EVENTS = [toy.Show(1.0), None, toy.Added(1.0, either=object())]  # type: ignore[arg-type]


@pytest.mark.parametrize("value", NOT_EVENTS)
def test_what_is_not_of_its_type_is_not_written(value: Any) -> None:
    with pytest.raises(TypeError):
        Codec(toy.Event).encode(value)


@dataclass(frozen=True)
class Free:
    anything: object


def _two_of_one_name() -> List[Any]:
    def make() -> Any:
        @dataclass(frozen=True)
        class Twin:
            x: int

        return Twin

    return [make(), make()]


@pytest.mark.parametrize(
    "hint", [Free, Any, FrozenSet[toy.Point], Tuple[Free, ...], Dict[int, str]]
)
def test_a_type_without_a_form_is_refused_at_once(hint: Any) -> None:
    with pytest.raises(TypeError):
        Codec(hint)


def test_two_classes_of_one_name_cannot_be_told_apart() -> None:
    with pytest.raises(TypeError, match="two classes have one name"):
        Codec(Union[tuple(_two_of_one_name())])
