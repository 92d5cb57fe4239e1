"""What a relation computes its output by."""
from typing import List, Mapping, Optional, Protocol, Tuple

from shsa_core.language.interval import Interval
from shsa_core.language.range_check import Trouble
from shsa_core.language.unit_check import Mismatch
from shsa_core.language.units import Unit


class Law(Protocol):
    """How a number is computed from others.

    By an expression, or by whatever else can say all of this of itself.
    """

    @property
    def key(self) -> str:
        """What it stands under in an ontology file."""

    @property
    def text(self) -> str:
        """As it is written there."""

    @property
    def names(self) -> Tuple[str, ...]:
        """Its inputs, properties and constants, in order of first use."""

    def mismatches(
        self, units: Mapping[str, Optional[Unit]], result: Optional[Unit]
    ) -> List[Mismatch]:
        """What cannot match if its inputs are in `units` and its output is to be in `result`.

        None: not known.
        """

    def troubles(self, ranges: Mapping[str, Interval]) -> List[Trouble]:
        """Where it may have no value while its inputs stay in their ranges.

        One without a range does not count.
        """

    def code(self, inputs: Mapping[str, str]) -> str:
        """The generated code's expression for it; each input as it is called there."""
