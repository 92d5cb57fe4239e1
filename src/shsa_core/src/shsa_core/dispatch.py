"""One idiom of dispatch, for the three cores and their shells: a table from classes to methods."""
from dataclasses import is_dataclass
from typing import Any, Callable, Dict, Mapping, Tuple, Type, TypeVar, get_args

Result = TypeVar("Result")
Table = Dict[Type[Any], Callable[[Any], Result]]


def members(kind: Any) -> Tuple[Type[Any], ...]:
    """Return the classes of a union, or made of a dataclass, of which no other is made."""
    made = get_args(kind) or (kind.__subclasses__() if is_dataclass(kind) else ())
    return tuple(leaf for each in made for leaf in members(each)) or (kind,)


def table(union: Any, handlers: Mapping[Type[Any], Callable[[Any], Result]]) -> "Table[Result]":
    """The handlers of a union of classes, or of those that are made of one, one for each.

    Raises TypeError if one is missing or too many.
    """
    wanted = set(members(union))
    for what, classes in (("no", wanted - set(handlers)), ("a needless", set(handlers) - wanted)):
        if classes:
            names = ", ".join(sorted(each.__name__ for each in classes))
            raise TypeError(f"there is {what} handler of {names}")
    return dict(handlers)
