"""The one idiom of dispatch: complete by construction."""
from dataclasses import dataclass
from typing import Union

import pytest

from shsa_core.dispatch import Table, table


@dataclass
class Base:
    """What others are made of."""


class Middle(Base):
    """No more than what joins two."""


class One(Middle):
    """A leaf."""


class Two(Base):
    """Another one."""


def test_of_a_class_each_that_is_made_of_it_has_its_handler() -> None:
    assert set(table(Base, {One: id, Two: id})) == {One, Two}
    with pytest.raises(TypeError, match="there is a needless handler of Middle"):
        table(Base, {One: id, Middle: id, Two: id})


def test_each_class_of_a_union_has_its_handler() -> None:
    handlers: Table[int] = table(Union[int, str], {int: abs, str: len})
    assert (handlers[int](-1), handlers[str]("four")) == (1, 4)
    assert table(int, {int: abs})[int](-1) == 1


def test_a_missing_and_a_needless_handler_are_named() -> None:
    with pytest.raises(TypeError, match="there is no handler of bytes, str"):
        table(Union[int, str, bytes], {int: hash})
    with pytest.raises(TypeError, match="there is a needless handler of str"):
        table(int, {int: hash, str: hash})
