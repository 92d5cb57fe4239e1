"""The truth of a substitute: its program beside its original, while that was well."""
import builtins
import math
from dataclasses import dataclass, replace
from typing import Optional, Tuple

import numpy as np

from shsa_core.errors import ShsaError
from shsa_core.healing.incident import Incident
from shsa_core.model.error import Error
from shsa_core.model.service import Source
from shsa_core.model.som import Som
from shsa_core.model.substitution import Program
from shsa_learning.backtest.rehearsal import Played, Rehearsal, recorded
from shsa_learning.figures import error_of
from shsa_learning.recordings.recording import Recording

LEAST_POINTS = 20
"""With fewer nothing is said."""
WITHIN = 0.9
"""If so much of the points lie within the expected p95, the substitute is as true as expected."""
WORSE = 1.25
"""Times the expected rms: more is worse than expected, where no p95 is known."""


@dataclass(frozen=True, eq=False)
class Truth:
    """One value that a substitute gave, beside its original.

    `played`: what its program yields of the recorded inputs, and what the original measured, in
    time; `error`: of the points where both are there, against the original; `expected`: what was
    promised; `within`: the share of points within the expected p95, None: none was promised.
    """

    property: str
    played: Played
    error: Error
    expected: Optional[Error]
    within: Optional[float]

    @builtins.property  # a truth has a `property` of its own
    def verdict(self) -> str:
        """In words."""
        if self.expected is None:
            return "nothing was promised"
        if self.within is None:
            good = self.error.rms <= WORSE * self.expected.rms
        else:
            good = self.within >= WITHIN
        return "as true as promised" if good else "less true than promised"


def compare(som: Som, incident: Incident, recording: Recording) -> Tuple[Truth, ...]:
    """Compare the program of an incident with its original on a recording, output by output.

    The original's values count before its failure and after its return; the program is run over the
    inputs as they were recorded, as its substitute would have run. Raises ShsaError, with why, if
    they cannot be compared.
    """
    if not incident.code or not incident.outputs:
        raise ShsaError("no substitute computed anything")
    service = som.services.get(incident.service)
    if service is None:
        raise ShsaError(f"the SOM has no service {incident.service}")
    program = Program(incident.inputs, incident.code, incident.outputs)
    sources = [_source(som, path, incident) for path in incident.inputs]
    found = []
    for place, path in enumerate(incident.outputs):
        output = next((each for each in service.sources if each.output == path), None)
        if output is None:
            raise ShsaError(f"the SOM's {service.name} has no {path}")
        if recorded(recording, output) is None:
            raise ShsaError(f"{path} of the original is not in the recording")
        played = _calibrated(
            Rehearsal(recording, output).run(sources, program, place), incident, place
        )
        found.append(_truth(output.property, played, _expected(incident, place)))
    return tuple(found)


def _source(som: Som, path: str, incident: Incident) -> Source:
    """Return the source of an input; of several on one topic, one that was available."""
    known = [source for source in som.sources if source.path == path]
    there = [source for source in known if source.service.name not in incident.unavailable]
    for source in there or known:
        return source
    raise ShsaError(f"the SOM has no {path}, which the substitute read")


def _expected(incident: Incident, place: int) -> Optional[Error]:
    return incident.errors[place] if place < len(incident.errors) else None


def _calibrated(played: Played, incident: Incident, place: int) -> Played:
    if place >= min(len(incident.gains), len(incident.offsets)):
        return played
    gain, offset = incident.gains[place], incident.offsets[place]
    return played._replace(values=gain * played.values + offset)


@np.errstate(over="ignore", invalid="ignore")  # a law can yield any finite number
def _truth(name: str, played: Played, expected: Optional[Error]) -> Truth:
    both = np.isfinite(played.values) & np.isfinite(played.measured)
    if int(both.sum()) < LEAST_POINTS:
        raise ShsaError(
            f"{name}: {both.sum()} values of the original, while it was well, have one of the "
            f"substitute's program beside them; {LEAST_POINTS} are needed"
        )
    off = (played.values - played.measured)[both]
    error = error_of(off, float(np.std(played.measured[both])))
    if not math.isfinite(error.rms):
        raise ShsaError(f"{name}: the law yields numbers that are too large")
    bound = None if expected is None else expected.p95
    within = None if bound is None else float(np.mean(np.abs(off) <= bound))
    return Truth(name, played, replace(error, source="the recording"), expected, within)
