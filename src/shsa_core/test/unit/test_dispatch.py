"""The one idiom of dispatch: complete by construction."""
from typing import Union

import pytest

from shsa_core.dispatch import Table, table


def test_each_class_of_a_union_has_its_handler() -> None:
    handlers: Table[int] = table(Union[int, str], {int: abs, str: len})
    assert (handlers[int](-1), handlers[str]("four")) == (1, 4)
    assert table(int, {int: abs})[int](-1) == 1


def test_a_missing_and_a_needless_handler_are_named() -> None:
    with pytest.raises(TypeError, match="there is no handler of bytes, str"):
        table(Union[int, str, bytes], {int: hash})
    with pytest.raises(TypeError, match="there is a needless handler of str"):
        table(int, {int: hash, str: hash})
