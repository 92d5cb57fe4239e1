"""The machines that can be journaled; a new one is a line in MACHINES."""
import inspect
from functools import lru_cache
from importlib import import_module
from typing import Any, Callable, Dict, Mapping, get_type_hints

from shsa_core.journal.codec import Codec

MACHINES = {
    "monitoring": "monitoring.machine.Monitor",
    "healing": "healing.machine.Reconfigurator",
    "substitution": "substitution.machine.Substitute",
    "sharing": "substitution.sharing.Sharing",
}
"""The class of each machine; `events` in the same part has its unions."""


class MachineKind:
    """A class of machines, and the codecs of its events, its commands and its setup.

    A machine has `handle(event)`, which returns commands: the same for the same events in the same
    order. `make` is the class; its arguments are the setup, those `required` have no default.
    `events` and `commands` are unions. Raises TypeError if one of these cannot be written.
    """

    def __init__(self, name: str, make: Callable[..., Any], events: Any, commands: Any) -> None:
        self.name = name
        self.make = make
        self.events = Codec(events)
        self.commands = Codec(commands)
        arguments = inspect.signature(make).parameters
        hints = get_type_hints(getattr(make, "__init__") if isinstance(make, type) else make)
        self.setup = {each: Codec(hints[each]) for each in arguments}
        self.required = [n for n, each in arguments.items() if each.default is inspect._empty]

    def encode_setup(self, setup: Mapping[str, Any]) -> Dict[str, Any]:
        """Return a machine's arguments as JSON values. Raises TypeError for an unknown one."""
        unknown = set(setup) - set(self.setup)
        if unknown:
            raise TypeError(f"{self.name} takes no {', '.join(sorted(unknown))}")
        return {name: self.setup[name].encode(value) for name, value in setup.items()}


@lru_cache(maxsize=None)
def machine_kind(name: str) -> MachineKind:
    """Return the machine of this name in MACHINES. Only its part is imported. Raises KeyError."""
    part, module, class_name = MACHINES[name].split(".")
    machine = import_module(f"shsa_core.{part}.{module}")
    events = import_module(f"shsa_core.{part}.events")
    return MachineKind(name, getattr(machine, class_name), events.Event, events.Command)
