"""Which properties of a recording can be expressed by which others, for a first ontology."""
from dataclasses import replace
from typing import Callable, Iterator, List, NamedTuple, Optional, Sequence

from shsa_core.errors import ShsaError
from shsa_core.model.ontology import Ontology
from shsa_core.model.relation import TransferFunction
from shsa_core.model.som import Som
from shsa_learning.learn.learner import learn
from shsa_learning.learn.relation import relation_of, with_relation
from shsa_learning.learn.rows import gather
from shsa_learning.learn.screening import screen
from shsa_learning.recordings.recording import Recording

ALTERNATIVES = 2
"""Relations a property: the second has none of the first one's inputs."""
MODEL = "polynomial"
"""Signed products: short, and quickly fitted. `shsa learn` tries all that there is."""


class Outcome(NamedTuple):
    """What was learned of a property: a relation, or why there is none."""

    property: str
    relation: Optional[TransferFunction]
    why: str


def express(
    recordings: Sequence[Recording],
    som: Som,
    source: str,
    step: Callable[[], object] = lambda: None,
) -> Iterator[Outcome]:
    """Relations for each property of the SOM that was recorded; `step` is called once for each.

    `source`: where the recordings are from, in words.
    """
    known = {name for recording in recordings for name in recording.properties}
    for name in dict.fromkeys(each.property for each in som.sources):
        if name in known:
            yield from _alternatives(recordings, som, name, source)
        step()


def with_all(ontology: Ontology, outcomes: Sequence[Outcome]) -> Ontology:
    """The ontology with all relations that were learned."""
    for outcome in outcomes:
        if outcome.relation is not None:
            ontology = with_relation(ontology, outcome.relation)
    return ontology


def _alternatives(
    recordings: Sequence[Recording], som: Som, name: str, source: str
) -> Iterator[Outcome]:
    used: List[str] = []
    for number in range(1, ALTERNATIVES + 1):
        try:
            chosen = screen(gather(recordings, name, (), som).table, used)
            if not chosen:
                if not used:
                    yield Outcome(name, None, "nothing that was recorded tells enough of it")
                return
            data = gather(recordings, name, chosen, som)
            learned = learn(data, MODEL, source=source)
            used += chosen
            if not learned.accepted:
                inputs = ", ".join(chosen)
                yield Outcome(name, None, f"from {inputs}: {'; '.join(learned.reasons)}")
                continue
            relation = relation_of(learned, data.table)
        except ShsaError as error:
            yield Outcome(name, None, str(error))
            return
        alone = (
            relation if number == 1 else replace(relation, relation=f"{relation.relation}_{number}")
        )
        yield Outcome(name, alone, "")
