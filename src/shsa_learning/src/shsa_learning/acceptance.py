"""Tells how right healing would have been, by the incidents on which it only advised."""
import re
from typing import Dict, Iterable, List, NamedTuple, Sequence, Tuple

from shsa_core.errors import ModelError, ModelErrors, listed
from shsa_core.files.document import parse_yaml
from shsa_core.files.regular import read_text
from shsa_core.files.som_file import read_tree
from shsa_core.healing.incident import Incident
from shsa_core.model.kinds import Kind
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
    Kind.NEVER_PUBLISHED: "start it sooner, or give `startup_grace`",
}


class Advice(NamedTuple):
    """The advised incidents of a service.

    `right`: those that lasted, and had a substitute. `kills`: those in which its node would have
    been ended; `needless`: those of them that were over by themselves. `notes`: what the substitute
    errs, and what to change.
    """

    service: str
    incidents: int
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
        return "\n    ".join((text, *self.notes))


def advice(som: Som, incidents: Iterable[Incident]) -> List[Advice]:
    """Return what was advised on each service that may be healed."""
    advised: Dict[str, List[Incident]] = {each.name: [] for each in som if each.needed is not False}
    for incident in incidents:
        if "healing advises" in incident.decision and incident.service in advised:
            advised[incident.service].append(incident)
    return [_of(service, told) for service, told in advised.items()]


def _of(service: str, told: Sequence[Incident]) -> Advice:
    notes: Dict[str, None] = {}
    brief = [each for each in told if _lasted(each) < BRIEF_S]
    for kind in dict.fromkeys(each.kind for each in brief):
        longest = max(_lasted(each) for each in brief if each.kind is kind)
        what = REMEDIES.get(kind, "see what happened with `shsa explain`")
        notes[f"{kind}: over by itself within {longest:.1f} s: {what}"] = None
    for each in told[-1:]:
        known = [(n, e.rms) for n, e in zip(each.properties, each.errors) if e is not None]
        for name, rms in known:
            notes[f"the substitute's RMS error of {name} is expected to be {rms:.3g}"] = None
    for each in told:
        if not each.inputs:
            lacks = listed(each.missing) or "any relation that yields its values"
            notes[f"no substitute: {lacks} is missing; `shsa find --service {service}`"] = None
    kills = [each for each in told if " is killed" in each.decision]
    right = [each for each in told if each.inputs and each not in brief]
    needless = sum(each in brief for each in kills)
    return Advice(service, len(told), len(right), len(kills), needless, tuple(notes))


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
