"""The state of a service, in one word and in words: by signed tables and its open incident."""
from typing import Dict, List, Mapping, NamedTuple, Optional, Sequence

from shsa_core.healing.incident import Incident, State as Step
from shsa_core.model.health import PublisherState
from shsa_core.model.kinds import Word
from shsa_core.text import shown
from shsa_view.facts import Publisher, Substitute


class Condition(Word):
    """States of a service. KEPT: it failed, nothing is done; FAILED: it failed, nobody needs it."""

    WELL = "well"
    SUBSTITUTED = "substituted"
    RETURNING = "returning"
    HEALING = "healing"
    NOT_HEALED = "not_healed"
    KEPT = "kept"
    FAILED = "failed"
    STARTING = "starting"
    UNKNOWN = "unknown"


LETTERS: Mapping[str, str] = {
    Condition.WELL: "w",
    Condition.SUBSTITUTED: "s",
    Condition.RETURNING: "s",
    Condition.HEALING: "h",
    Condition.NOT_HEALED: "f",
    Condition.KEPT: "f",
    Condition.FAILED: "f",
    Condition.STARTING: "u",
    Condition.UNKNOWN: "u",
}
"""The letters of a second in a strip."""

LISTED = 5
"""Names in a sentence."""
BY_STEP = {
    Step.HEALING: Condition.HEALING,
    Step.HEALED: Condition.SUBSTITUTED,
    Step.RETURNING: Condition.RETURNING,
    Step.UNHEALED: Condition.NOT_HEALED,
    Step.SAFE: Condition.NOT_HEALED,
    Step.KEPT: Condition.KEPT,
}


class Judgement(NamedTuple):
    """The state of a service, why, and its publisher (None: nobody, as far as is known)."""

    condition: Condition
    detail: str
    publisher: Optional[str]


def judge(
    node: str,
    alone: bool,
    publishers: Sequence[Publisher],
    substitutes: Sequence[Substitute],
    incident: Optional[Incident],
) -> Judgement:
    """Judge a service of `node`. `alone`: no other service is on its topic.

    `publishers` are those of its topic that a monitor which is heard tells of; `substitutes` all
    processes that healing runs.
    """
    ours = {each.node for each in substitutes}
    own = [p for p in publishers if p.publisher not in ours and (alone or p.publisher == node)]
    running = next((each.node for each in substitutes if each.publishing), None)
    healthy = [p.publisher for p in own if p.state == PublisherState.HEALTHY.value]
    failed = [p for p in own if p.state == PublisherState.FAILED.value]
    why = "; ".join(f"{p.publisher or 'nobody publishes'}: {p.detail}" for p in failed)
    publisher = running or (healthy[0] if healthy else None)
    if incident is not None and incident.state in BY_STEP:
        return Judgement(BY_STEP[incident.state], shown(incident.detail) or why, publisher)
    if running is not None:
        return Judgement(Condition.SUBSTITUTED, why or f"by {running}", publisher)
    if healthy:
        late = (f"{p.publisher}: {p.detail}" for p in own if p.publisher in healthy and p.detail)
        return Judgement(Condition.WELL, "; ".join(filter(None, (why, *late))), publisher)
    if failed:
        return Judgement(Condition.FAILED, why, publisher)
    if publishers:
        return Judgement(Condition.STARTING, "its first message is awaited", publisher)
    return Judgement(Condition.UNKNOWN, "no monitor tells of it", publisher)


def of_robot(
    needed: Mapping[str, Condition], others: Mapping[str, Condition], heard: bool
) -> Dict[str, str]:
    """Return the robot at a glance, by its needed services.

    `others`: the services that are watched besides; `heard`: whether monitor and reconfigurator
    are.
    """
    wrong = _named(needed, Condition.NOT_HEALED, Condition.KEPT)
    at_work = _named(needed, Condition.HEALING, Condition.FAILED)
    replaced = _named(needed, Condition.SUBSTITUTED, Condition.RETURNING)
    silent = _named(needed, Condition.UNKNOWN)
    starting = _named(needed, Condition.STARTING)
    rest = _rest({**others, **{name: needed[name] for name in silent + starting}})
    watched = f"{_count(len(needed) + len(others), 'service')} watched."
    if wrong or at_work:
        parts = [f"Not healed: {_list(wrong)}."] if wrong else []
        parts += [f"Being healed: {_list(at_work)}."] if at_work else []
        return {"state": "not_healed", "text": " ".join(parts)}
    if not heard:
        return {"state": "unknown", "text": "Not known: healing is not heard."}
    if replaced:
        verb = "has a substitute" if len(replaced) == 1 else "have substitutes"
        text = f"{_list(replaced)} {verb}. {rest or 'The rest is well.'}"
        return {"state": "substituted", "text": text}
    if silent:
        return {"state": "unknown", "text": f"Not known: {_list(silent)}."}
    if starting:
        return {"state": "starting", "text": f"Starting: {_list(starting)}."}
    well = "All that is needed is well" if rest else "All well"
    text = f"{well if needed else 'No service is needed, so none is healed'}. {rest or watched}"
    return {"state": "well", "text": text}


def _rest(rest: Mapping[str, Condition]) -> str:
    """Return which of the rest is not well, or not known to be; empty: all is well."""
    unknown = _named(rest, Condition.UNKNOWN, Condition.STARTING)
    wrong = [name for name in rest if rest[name] != Condition.WELL and name not in unknown]
    parts = [f"Not well: {_list(wrong)}."] if wrong else []
    return " ".join([*parts, *([f"Not heard yet: {_list(unknown)}."] if unknown else [])])


def _named(services: Mapping[str, Condition], *conditions: Condition) -> List[str]:
    return [name for name, each in services.items() if each in conditions]


def _list(names: Sequence[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return ", ".join(names[:LISTED]) + more


def _count(number: int, what: str) -> str:
    return f"{number} {what} is" if number == 1 else f"{number} {what}s are"
