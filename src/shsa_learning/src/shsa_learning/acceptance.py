"""Tells how right healing would have been, by the incidents on which it only advised."""
import re
from typing import Dict, Iterable, List, NamedTuple, Optional, Sequence, Tuple

from shsa_core.derivations.calibrator import SOURCE as COMPARED
from shsa_core.errors import ModelError, ModelErrors, listed
from shsa_core.files.document import parse_yaml
from shsa_core.files.regular import read_text
from shsa_core.files.som_file import read_tree
from shsa_core.healing.incident import Incident
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Service
from shsa_core.model.som import Som

BRIEF_S = 3.0
"""A failure that is over so soon needs no substitute: a cold one takes as long to publish."""
_ACT = re.compile(r"^act:.*$", re.MULTILINE)
_FIRST_KEY = re.compile(r"^(?=[a-z])", re.MULTILINE)
REMEDIES: Dict[Kind, str] = {
    Kind.SILENT: "give it a longer `deadline`, or `period: none` if it has no rhythm",
    Kind.RATE_LOW: "correct `period` by `rostopic hz`",
    Kind.RATE_HIGH: "correct `period` by `rostopic hz`",
    Kind.OUT_OF_RANGE: "widen `range` to what the datasheet says",
    Kind.STUCK: "say `checks: {stuck: false}` if the value may rest",
    Kind.NOT_A_NUMBER: "say `checks: {not_a_number: false}` if NaN has a meaning",
    Kind.JUMP: "allow a larger `jump`, or none",
    Kind.WITNESS: "give its relations the errors that `shsa backtest` measures",
    Kind.STALE_STAMP: "set the clocks, or say `checks: {stale_stamp: false}`",
    Kind.FUTURE_STAMP: "set the clocks, or say `checks: {future_stamp: false}`",
    Kind.FRAME: "say `checks: {frame: false}` if its frames change",
    Kind.LENGTH: "say `checks: {length: false}` if its arrays get shorter",
    Kind.FORMULA: "allow in the `formula` what was seen",
    Kind.NEVER_PUBLISHED: "start it sooner, or give `startup_grace`",
}


class Advice(NamedTuple):
    """The advised incidents of a service.

    `returned`: those after which its node did well again by itself. `right`: those that lasted, and
    had a substitute that is better than a constant. `kills`: those in which its node would have
    been ended; `needless`: those of them in which a live node returned. `notes`: how the substitute
    agreed with the original, and what to change.
    """

    service: str
    incidents: int
    returned: int
    right: int
    kills: int
    needless: int
    notes: Tuple[str, ...]

    def __str__(self) -> str:
        if not self.incidents:
            return f"{self.service}: nothing was advised"
        killed = f", its node ended {self.kills} times" if self.kills else ""
        needless = f" ({self.needless} needlessly)" if self.needless else ""
        text = f"{self.service}: right {self.right} of {self.incidents} times{killed}{needless}"
        text += f", back by itself {self.returned} times" if self.returned else ""
        return "\n    ".join((text, *self.notes))


def advice(som: Som, incidents: Iterable[Incident]) -> List[Advice]:
    """Return what was advised on each service that may be healed."""
    advised: Dict[str, List[Incident]] = {each.name: [] for each in som if each.needed is not False}
    for incident in incidents:
        if "healing advises" in incident.decision and incident.service in advised:
            advised[incident.service].append(incident)
    return [_of(som.services[name], told) for name, told in advised.items()]


def _of(service: Service, told: Sequence[Incident]) -> Advice:
    notes: Dict[str, None] = {}
    brief = [each for each in told if _lasted(each) < BRIEF_S]
    for kind in dict.fromkeys(each.kind for each in brief):
        longest = max(_lasted(each) for each in brief if each.kind is kind)
        what = REMEDIES.get(kind, "see what happened with `shsa explain`")
        notes[f"{kind}: over by itself within {longest:.1f} s: {what}"] = None
    names = {source.output: source.property for source in service.sources}
    for each in [each for each in told if each.inputs][-1:]:
        for path, error in zip(each.outputs, each.errors):
            notes[_agreement(names.get(path, path), error)] = None
    for each in told:
        if not each.inputs:
            lacks = listed(each.missing) or "any relation that yields its values"
            notes[f"no substitute: {lacks} is missing; `shsa find {service.topic}`"] = None
    back = [each for each in told if each.returned is not None]
    kills = [each for each in told if " is killed" in each.decision]
    right = [each for each in told if each.inputs and each not in brief and not _poor(each)]
    needless = sum(each in back and each.kind is not Kind.NODE_GONE for each in kills)
    if 2 * len(right) < len(told):
        notes["acting would have been wrong more often: say `policy: advise` until then"] = None
    counts = len(told), len(back), len(right), len(kills), needless
    return Advice(service.name, *counts, tuple(notes))


def _poor(incident: Incident) -> bool:
    """Tell if the substitute errs as much as who always says the mean."""
    known = (each for each in incident.errors if each is not None and each.baseline is not None)
    return any(each.rms >= (each.baseline or 0.0) for each in known)


def _agreement(name: str, error: Optional[Error]) -> str:
    """Return how a value that would be published agreed with the original's, in words."""
    if error is None:
        return f"{name}: nothing is known of the substitute's error"
    if error.source != COMPARED:
        text = f"{name}: the substitute's RMS error is expected to be {error.rms:.3g}"
        return f"{text}; it was never compared with the original"
    most = "" if error.p95 is None else f", 95 % by at most {error.p95:.3g}"
    return f"{name}: differed from the original by {error.rms:.3g} RMS{most} ({error.n} times)"


def _lasted(incident: Incident) -> float:
    """Return how long the original was missed in s; infinite: it did not come back by itself."""
    back = incident.returned
    return float("inf") if back is None else back - incident.detected


def with_act(path: str) -> str:
    """Return the text of a SOM file, with `act: true` at its top. Raises ModelError."""
    text = read_text(path)
    if _ACT.search(text):
        changed = _ACT.sub("act: true", text, count=1)
    else:
        changed = _FIRST_KEY.sub("act: true\n", text, count=1)
    som, errors = read_tree(parse_yaml(changed, path))
    if errors:
        raise ModelErrors(errors)
    if not som.act:
        raise ModelError(path, "`act: true` cannot be written here: add it by hand")
    return changed
