"""Reads the parameters of monitor and reconfigurator into their settings."""
import dataclasses
from typing import Any, List, Tuple, Type, TypeVar

from shsa_core.errors import ModelError
from shsa_core.files.document import from_parameters
from shsa_core.files.readers import Key, Keys, number_in, one_of, read_keys, whole_number
from shsa_core.model.kinds import Method

Settings = TypeVar("Settings")
HIGHEST = 1e6
_time = number_in(0.0, HIGHEST, f"0 to {HIGHEST:g}")
_count = whole_number(int(HIGHEST), 0)
PARAMETERS: Keys = {
    "hold_off": Key(
        _time, "s for which a returned node must stay healthy before its substitute stops"
    ),
    "startup_grace": Key(_time, "s that a service may take to come up"),
    "minimum_deadline": Key(
        _time, "s; a shorter silence is no failure, unless its service has a `deadline`"
    ),
    "method": Key(
        one_of(Method),
        "the search: `best`, or `depth_first` (`orr` in the paper), the first one found",
    ),
    "pool": Key(whole_number(100, 0), "idle processes that the warm services share"),
    "hot_hosts": Key(
        whole_number(1000, 0),
        "hot substitutes with a process each; further ones share processes of this many; "
        "0: each has its own",
    ),
    "node_restarts": Key(_count, "how often a failed node is started again, by `policy`"),
    "switches": Key(
        _count, "relapses in a row after which a node is kept out; 0: they do not count"
    ),
}
"""The settings that a parameter may change."""


def names_of(kind: Type[Any]) -> List[str]:
    """Return the names of the parameters that a class of settings has."""
    fields = {field.name for field in dataclasses.fields(kind)}
    return [name for name in PARAMETERS if name in fields]


def read_settings(
    kind: Type[Settings], parameters: object, where: str
) -> Tuple[Settings, List[ModelError]]:
    """Return settings by the parameters in `where`, by default where one is wrong, and what is."""
    keys = {name: PARAMETERS[name] for name in names_of(kind)}
    try:
        given, errors = read_keys(from_parameters(parameters, where), "the settings", keys)
    except ModelError as error:
        return kind(), list(error.errors)
    return kind(**given), errors
