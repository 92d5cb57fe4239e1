"""What the cores share: one idiom of dispatch, and the command to tell people something."""
from dataclasses import dataclass
from enum import Enum
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


class Level(Enum):
    """The urgency of a line of the log."""

    DEBUG = "debug"
    INFO = "info"
    WARN = "warn"
    ERROR = "error"


@dataclass(frozen=True)
class Log:
    """Tell people, in plain words."""

    level: Level
    text: str
