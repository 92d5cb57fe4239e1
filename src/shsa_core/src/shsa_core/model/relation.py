"""One direction of a relation between properties (Section III of the paper)."""
from dataclasses import dataclass, field
from typing import Optional, Tuple

from shsa_core.language.expression import Condition, Law
from shsa_core.model.error import Error


@dataclass(frozen=True)
class TransferFunction:
    """One direction of a relation: computes the property `output` from the properties `inputs`.

    `inputs` are the properties that the law or the constraint names, in order of first use;
    constants are not among them. `law` is None where the file has a function that cannot be
    executed: it takes part in the search and is refused at generation. `quality` is in (0, 1].
    Where `constraint` is false there is no output. `text` is the function as it was written,
    `error` that of its output with inputs as good as usual (None: not known), `where` the file and
    line.
    """

    relation: str
    output: str
    inputs: Tuple[str, ...]
    law: Optional[Law]
    quality: float = 1.0
    constraint: Optional[Condition] = None
    text: str = ""
    where: str = field(default="", compare=False, repr=False)
    error: Optional[Error] = None
