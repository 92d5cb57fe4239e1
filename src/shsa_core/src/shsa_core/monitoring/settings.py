"""The monitor's settings, where a service has none of its own."""
from dataclasses import dataclass

from shsa_core.model.service import Deadlines


@dataclass(frozen=True)
class Settings:
    """`startup_grace`: s until a service that has never been there has failed; `deadlines`: how long one may be silent."""

    startup_grace: float = 15.0
    deadlines: Deadlines = Deadlines()
