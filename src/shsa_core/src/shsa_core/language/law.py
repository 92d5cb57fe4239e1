"""What a relation computes its output by."""
from typing import Any, List, Mapping, Optional, Protocol, Tuple

from shsa_core.language.interval import Interval
from shsa_core.language.range_check import Trouble
from shsa_core.language.unit_check import Mismatch
from shsa_core.language.units import Unit


class Law(Protocol):
    """How a number is computed from others.

    By an expression, or by whatever else can say all of this of itself.
    """

    @property
    def text(self) -> str:
        """All of it in one line."""

    @property
    def entry(self) -> Mapping[str, Any]:
        """As it stands in an ontology file."""

    @property
    def names(self) -> Tuple[str, ...]:
        """Its inputs, properties and constants, in order of first use."""

    def mismatches(
        self, units: Mapping[str, Optional[Unit]], result: Optional[Unit]
    ) -> List[Mismatch]:
        """What cannot match if its inputs are in `units` and its output is to be in `result`.

        None: not known.
        """

    def troubles(
        self,
        ranges: Mapping[str, Interval],
        always: Optional[Mapping[str, Interval]] = None,
    ) -> List[Trouble]:
        """Where it may have no value while its inputs stay in their ranges.

        One without a range does not count. `ranges` are those where the relation's constraint
        holds, `always` those without it, as a law with a memory has seen them.
        """

    def body(self, inputs: Mapping[str, str]) -> List[str]:
        """The lines of the generated function for it; each input as it is called there."""
