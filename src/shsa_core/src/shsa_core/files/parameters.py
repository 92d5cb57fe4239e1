"""Reads the parameters of monitor and reconfigurator into their settings."""
import dataclasses
from typing import Any, Dict, List, Mapping, Tuple, Type, TypeVar

from shsa_core.errors import ModelError
from shsa_core.files.document import Value, from_parameters

Settings = TypeVar("Settings")
PARAMETERS = {
    "hold_off": "s for which a returned node must stay healthy before its substitute stops",
    "startup_grace": "s that a service may take to come up",
    "minimum_deadline": "s; a shorter silence is no failure, unless its service has a `deadline`",
    "method": "the search: `best`, or `depth_first` (`orr` in the paper), the first one found",
    "pool": "idle processes that the warm services share",
    "hot_hosts": "hot substitutes with a process each; further ones share processes of this many; "
    "0: each has its own",
    "node_restarts": "how often a failed node is started again, by `policy`",
    "switches": "relapses in a row after which a node is kept out; 0: they do not count",
}
"""The settings that a parameter may change, and what each means."""
HIGHEST = 1e6


def names_of(kind: Type[Any]) -> List[str]:
    """Return the names of the parameters that a class of settings has."""
    fields = {field.name for field in dataclasses.fields(kind)}
    return [name for name in PARAMETERS if name in fields]


def read_settings(
    kind: Type[Settings], parameters: object, where: str
) -> Tuple[Settings, List[ModelError]]:
    """Return the settings that a node's parameters ask for, and what is wrong with these.

    `where` is the parameters' namespace. Where one is wrong the default stays.
    """
    if not isinstance(parameters, Mapping):
        text = f"must be a mapping of settings, not a {type(parameters).__name__}"
        return kind(), [ModelError(where, text)]
    names = from_parameters(dict.fromkeys(parameters), where)
    errors = list(names.wrong_keys("the node", names_of(kind)))
    given: Dict[str, Any] = {}
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        if field.name in parameters and field.name in PARAMETERS:
            try:
                value = from_parameters(parameters[field.name], f"{where}/{field.name}")
                given[field.name] = _read(value, field)
            except ModelError as error:
                errors.append(error)
    return kind(**given), errors


def _read(value: Value, field: "dataclasses.Field[Any]") -> object:
    words = field.metadata.get("one_of")
    if words is not None:
        if value.data not in words:
            allowed = ", ".join(words)
            raise value.error(f"{field.name} must be one of {allowed}, not {value.describe()}")
        return value.data
    number, most = value.number(field.name), field.metadata.get("most", HIGHEST)
    if not 0.0 <= number <= most:
        raise value.error(f"{field.name} must be 0 to {most:g}, not {number:g}")
    if isinstance(field.default, float):
        return number
    if number != int(number):
        raise value.error(f"{field.name} must be a whole number, not {number:g}")
    return int(number)
