"""Which series may be inputs for a target, and why the others may not.

What knows the target by another way than the world would be right on every recording, and gone or
wrong with the target. What the target itself is computed from is no such leak: it is measured
without the target, so a relation from it is a true one.
"""
from typing import List, NamedTuple, Optional, Sequence, Tuple

from shsa_core.errors import ShsaError, listed
from shsa_core.model.som import Som
from shsa_learning.recordings.duplicates import duplicate
from shsa_learning.recordings.recording import Recording, Series


class LeftOut(NamedTuple):
    """A series that may not be an input, and why."""

    series: Series
    why: str


class Offer(NamedTuple):
    """What a target may be learned from: `inputs`, at most one a property is needed.

    `left_out`: all others of the recording; `notes`: what else should be known of the inputs.
    """

    target: Series
    inputs: Tuple[Series, ...]
    left_out: Tuple[LeftOut, ...]
    notes: Tuple[str, ...]

    def of(self, property: str) -> Series:
        """The first input of a property. Raises ShsaError, with the reason, if there is none."""
        found = next((each for each in self.inputs if each.property == property), None)
        if found is not None:
            return found
        why = next((each.why for each in self.left_out if each.series.property == property), None)
        if why is None:
            known = listed([each.property for each in self.inputs]) or "nothing"
            raise ShsaError(f"{property} was not recorded beside {self.target}; there is {known}")
        raise ShsaError(f"{property} may not be an input for {self.target.property}: {why}")


def offer(
    recording: Recording, target: Series, som: Optional[Som] = None, asked: Sequence[str] = ()
) -> Offer:
    """What `target`, a series of the recording, may be learned from.

    `asked`: properties that somebody named, who knows that they are measured apart from the target
    though they are in its file.
    """
    inputs: List[Series] = []
    left_out: List[LeftOut] = []
    for series in recording.series:
        if series is target:
            continue
        why = _why_not(series, target, som or Som(), asked)
        if why:
            left_out.append(LeftOut(series, why))
        else:
            inputs.append(series)
    notes = []
    service = (som or Som()).services.get(target.service)
    for series in inputs:
        if service is not None and series.service in service.upstream:
            notes.append(f"{target.property} is computed from {series}: that is what is learned")
        if _one_source(series, target):
            notes.append(
                f"{series.property} and {target.property} are of one file, {target.source}: they "
                "must be of nodes that do not fail together"
            )
    return Offer(target, tuple(inputs), tuple(left_out), tuple(notes))


def _one_source(series: Series, target: Series) -> bool:
    """Whether nothing but their columns tells two series of a file apart."""
    return series.source == target.source and not (series.service and target.service)


def _why_not(series: Series, target: Series, som: Som, asked: Sequence[str]) -> str:
    """Why a series may not be an input; empty if it may."""
    if series.service and series.service == target.service:
        return f"it is of the same source as the target, {target.source}"
    if _one_source(series, target) and series.property not in asked:
        return (
            f"it is of the same source as the target, {target.source}; a file is one source, "
            "unless --from names the inputs, or --som says which nodes its columns are of"
        )
    if series.property == target.property:
        return "it is the target, measured once more: it is passed on as it is"
    if series.node and series.node == target.node:
        return f"it is of {series.node}, which is lost with the target"
    own, other = som.services.get(target.service), som.services.get(series.service)
    if own is not None and other is not None:
        shared = [cause for cause in other.wrong_with if cause in own.wrong_with]
        if shared:
            return f"it fails with the target: {shared[0]}"
        if own.name in other.upstream:
            return f"it is derived from the target: {other.name} is computed from {own.name}"
    same = duplicate(target, series)
    return f"it is a duplicate: {same}" if same is not None else ""
