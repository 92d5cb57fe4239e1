"""The exceptions of self-healing; every one of them is a ShsaError."""
from typing import Sequence, Tuple

from shsa_core.text import LONGEST_LINE, shown

LISTED = 20  # names in a message


class ShsaError(Exception):
    """Anything that self-healing refuses or cannot do; the message says what and why.

    What it quotes may come from anybody, so it is printable and not endless.
    """

    missing: Tuple[str, ...] = ()  # what would have been needed

    def __init__(self, message: object = "") -> None:
        super().__init__(shown(message, LONGEST_LINE))


class ModelError(ShsaError):
    """An ontology, SOM or parameter is not valid.

    Args:
        where: the file and line (``rover.yaml:12``) or the parameter's name.
        what: what was wrong, and what is allowed.
    """

    def __init__(self, where: str, what: str) -> None:
        self.where = shown(where, LONGEST_LINE)
        self.what = shown(what, LONGEST_LINE)
        super().__init__(f"{self.where}: {self.what}")
        self.errors: Tuple[ModelError, ...] = (self,)


class ModelErrors(ModelError):
    """Everything that is wrong with a model, a line each: `errors`, one at least.

    Where and what are those of the first.
    """

    def __init__(self, errors: Sequence[ModelError]) -> None:
        super().__init__(errors[0].where, errors[0].what)
        self.errors = tuple(each for error in errors for each in error.errors)
        self.args = ("\n".join(map(str, self.errors)),)


class ExpressionError(ShsaError):
    """An expression uses something that the language of relations does not have."""


class GenerationError(ShsaError):
    """No code can be generated for a substitute."""


class CodeError(ShsaError):
    """A substitute's code is not what the generator could have produced."""


class NoSubstitute(ShsaError):
    """Nothing that is available can replace a property.

    Args:
        properties: the properties that were asked for.
        missing: the properties without which every derivation ended.
        tried: how many substitutes there are, but have failed already.
        lost: those of the properties that nothing derives; unsaid: all.
        refused: why the best that is available is not used.
    """

    def __init__(
        self,
        properties: Sequence[str],
        missing: Sequence[str],
        tried: int = 0,
        lost: Sequence[str] = (),
        refused: str = "",
    ) -> None:
        wanted = ", ".join(properties)
        lacking = listed(missing) or "any relation that yields it"
        why = f"none is left after the {tried} that failed" if tried else f"missing {lacking}"
        self.in_the_way = tuple(lost) if len(lost) < len(properties) else ()
        if self.in_the_way:
            why = f"{listed(self.in_the_way)} cannot be derived, {why}"
        super().__init__(f"no substitute for {wanted}: {refused or why}")
        self.properties = tuple(properties)
        self.missing = tuple(missing)
        self.refused = refused


def listed(names: Sequence[str], most: int = LISTED) -> str:
    """Some names for a message: the first ones, and how many more there are."""
    more = len(names) - most
    return ", ".join(names[:most]) + (f" and {more} more" if more > 0 else "")
