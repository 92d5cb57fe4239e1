"""A node's settings, read from its parameters."""
import dataclasses
from typing import Any, Dict, List, Mapping, Tuple, Type, TypeVar

from shsa_core.errors import ModelError
from shsa_core.files.document import Value, from_parameters

Settings = TypeVar("Settings")
ONE_OF = "one_of"
"""The key in a field's metadata for the words that are allowed."""
MOST = "most"
"""The key in a field's metadata for the highest number that is allowed, where it is another."""
HIGHEST = 1e6


def read_settings(
    kind: Type[Settings], parameters: object, where: str
) -> Tuple[Settings, List[ModelError]]:
    """The settings of a dataclass among some parameters, and what is wrong with them.

    Where something is, the default stays.

    `where` is the parameters' namespace. Other parameters are left alone.
    """
    given: Dict[str, Any] = {}
    errors: List[ModelError] = []
    if not isinstance(parameters, Mapping):
        text = f"must be a mapping of settings, not a {type(parameters).__name__}"
        return kind(), [ModelError(where, text)]
    for field in dataclasses.fields(kind):  # type: ignore[arg-type]
        if field.name in parameters:
            try:
                value = from_parameters(parameters[field.name], f"{where}/{field.name}")
                given[field.name] = _read(value, field)
            except ModelError as error:
                errors.append(error)
    return kind(**given), errors


def _read(value: Value, field: "dataclasses.Field[Any]") -> object:
    words = field.metadata.get(ONE_OF)
    if words is not None:
        if value.data not in words:
            allowed = ", ".join(words)
            raise value.error(f"{field.name} must be one of {allowed}, not {value.describe()}")
        return value.data
    number, most = value.number(field.name), field.metadata.get(MOST, HIGHEST)
    if not 0.0 <= number <= most:
        raise value.error(f"{field.name} must be 0 to {most:g}, not {number:g}")
    if isinstance(field.default, float):
        return number
    if number != int(number):
        raise value.error(f"{field.name} must be a whole number, not {number:g}")
    return int(number)
