"""One idiom of dispatch, for the three cores and their shells: a table from classes to methods."""
from typing import Any, Callable, Dict, Mapping, Type, TypeVar, get_args

Result = TypeVar("Result")
Table = Dict[Type[Any], Callable[[Any], Result]]


def table(union: Any, handlers: Mapping[Type[Any], Callable[[Any], Result]]) -> "Table[Result]":
    """The handlers of a union of classes, one for each.

    Raises TypeError if one is missing or too many.
    """
    wanted = set(get_args(union)) or {union}
    for what, classes in (("no", wanted - set(handlers)), ("a needless", set(handlers) - wanted)):
        if classes:
            names = ", ".join(sorted(each.__name__ for each in classes))
            raise TypeError(f"there is {what} handler of {names}")
    return dict(handlers)
