"""Message types as they are built on this computer; ROS is loaded when the first is asked for.

A name may come from anybody on the graph. So a module is loaded only where a file lies that the
generator of messages wrote, and nothing else is taken from it than a class of messages.
"""
import importlib
import os
import re
import sys
from importlib.machinery import PathFinder
from typing import Any, Dict, Mapping

from shsa_core.errors import ShsaError
from shsa_core.text import shown

NAME = re.compile(r"([A-Za-z][A-Za-z0-9_]{0,99})/([A-Za-z][A-Za-z0-9_]{0,99})")


def message_class(name: str) -> Any:
    """The class of the message type `name`; raises ShsaError if it is not built here."""
    parts = NAME.fullmatch(name)
    if parts is None:
        raise ShsaError(
            f"'{shown(name, 100)}' is no message type: one is written like std_msgs/Float64"
        )
    package, base = parts.groups()
    if not is_built(package, "msg", f"_{base}"):
        raise ShsaError(f"message type {name} is not known here: build its package and source it")
    try:
        found: Any = getattr(importlib.import_module(f"{package}.msg"), base)
    except Exception as error:  # whatever the module of a broken package raises
        raise ShsaError(f"message type {name} cannot be loaded: {error}") from error
    message: Any = importlib.import_module("genpy").Message
    is_one = isinstance(found, type) and issubclass(found, message)
    if not is_one or getattr(found, "_type", "") != name:
        raise ShsaError(f"message type {name} cannot be loaded: what has its name is none")
    return found


def is_built(package: str, kind: str, module: str) -> bool:
    """Return whether a package has a generated module, `kind`: msg or srv. Nothing is loaded."""
    folders = [os.path.join(folder, package, kind) for folder in sys.path]
    return PathFinder.find_spec(module, folders) is not None


def layout(name: str) -> Mapping[str, str]:
    """The fields of the message type `name` and their types; raises ShsaError if it is not here."""
    return layout_of(message_class(name))


def layout_of(found: Any) -> Dict[str, str]:
    """The fields of a message class and their types."""
    return dict(zip(found.__slots__, found._slot_types))
