"""The reconfigurator's settings: times and limits."""
import dataclasses
from dataclasses import dataclass
from typing import Any, Dict, List, Mapping, Tuple

from shsa_core.errors import ModelError
from shsa_core.healing.plans import METHODS
from shsa_core.files.document import Value, from_parameters


@dataclass(frozen=True)
class Settings:
    """The reconfigurator's settings; times in s.

    `hold_off`: how long a returned original must stay healthy before the substitute is stopped.
    `hold_off_limit`: what `hold_off` doubles up to while an original keeps failing within it.
    `switches`: after how many such failures in one incident it is kept out; 0: never.
    `healings`: how often a topic may be healed in a minute before it is given up; 0: any number will do.
    `start_timeout`: how long a substitute may take from its start to its first message.
    `takeover_timeout`: the same for a process that runs already; then another one gets its work.
    `restarts`: how often a substitute that died is started again with the same plan.
    `node_restarts`, `restart_pause`: how often a node is started again, and the first pause, which doubles.
    `restart_timeout`: how long a node that was started again may take to its first message.
    `stable`: how long a node must be well until its restarts are forgotten.
    `retry`: after how long a topic that could not be healed is tried anew; doubles up to `retry_limit`.
    `method`: the search, `best` or `orr`.
    `pool`: how many idle processes the warm topics share.
    """

    hold_off: float = 2.0
    hold_off_limit: float = 60.0
    switches: int = 3
    healings: int = 0
    start_timeout: float = 5.0
    takeover_timeout: float = 2.0
    restarts: int = 2
    node_restarts: int = 3
    restart_pause: float = 0.5
    restart_timeout: float = 10.0
    stable: float = 60.0
    retry: float = 2.0
    retry_limit: float = 60.0
    method: str = "best"
    pool: int = 2


def read_settings(
    parameters: Mapping[str, object], where: str
) -> Tuple[Settings, List[ModelError]]:
    """The settings among some parameters, and what is wrong with them: there the default stays.

    `where` is the parameters' namespace. Other parameters are left alone.
    """
    given: Dict[str, Any] = {}
    errors: List[ModelError] = []
    for each in dataclasses.fields(Settings):
        if each.name in parameters:
            try:
                value = from_parameters(parameters[each.name], f"{where}/{each.name}")
                given[each.name] = _read(value, each.name, each.default)
            except ModelError as error:
                errors.append(error)
    return Settings(**given), errors


def _read(value: Value, name: str, default: object) -> object:
    if isinstance(default, str):
        if value.data not in METHODS:
            raise value.error(f"{name} must be one of {', '.join(METHODS)}, not {value.describe()}")
        return value.data
    number = value.number(name)
    if number < 0.0:
        raise value.error(f"{name} must not be below 0, not {number:g}")
    if isinstance(default, float):
        return number
    if number != int(number):
        raise value.error(f"{name} must be a whole number, not {number:g}")
    return int(number)
