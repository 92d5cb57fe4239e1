"""A SOM and an ontology as drafts, from a survey: to be read and corrected by a person."""
import json
import math
import re
import textwrap
from dataclasses import dataclass, replace
from typing import Dict, Iterator, List, Optional, Sequence, Set, Tuple

import networkx as nx

from shsa_core.errors import ModelError
from shsa_core.files.document import parse_yaml
from shsa_core.files.som_file import read_tree
from shsa_core.analysis.duties import Pairs, duties_of, is_command
from shsa_core.model.names import Names
from shsa_core.model.field import ANGLES, is_distance, parse_field
from shsa_core.model.field_type import WHOLE
from shsa_core.model.som import Som
from shsa_core.text import shown
from shsa_learning.init.meanings import SLIDES
from shsa_learning.init.naming import property_name, service_names
from shsa_learning.init.survey import LOGS, Facts, Field, Publisher, Refused, Survey

UNKNOWN_NODE = "/unknown"
"""Stands for the node of what a recording does not tell of. All that it provides fails together."""
_ANONYMOUS = re.compile(r"_\d+_\d{10,}\Z")
_PLAIN = re.compile(r"(/[A-Za-z0-9_]+)+|[A-Za-z][A-Za-z0-9_/*^]*", re.ASCII)
_PLAIN_FIELD = re.compile(r"[A-Za-z][A-Za-z0-9_.]*", re.ASCII)
MOST_COMMENTS = 200
"""Lines that tell what was left out."""
STATES = ("bool", "uint8", "int8", "byte", "char")
"""They count what state something is in: others than those that were seen may come."""
SMALLEST, LARGEST = 1e-30, 1e30
"""Magnitudes beyond these are no measurement: nothing is usual of them."""
LONGEST = 200
"""Characters that are quoted of what others say."""

PROVIDES = "    provides:"
HEAD = """\
# A draft of a service-to-ontology mapping, made by `shsa init` from {source}.
# Healing tells what it would do by it, and does nothing, until `act: true` stands above its
# `services:`. Before you write that:
#  - Read each line. Names of properties are yours to choose; what two services tell of one
#    quantity gets one name. Rename it in the ontology as well.
#  - `usual` is what was seen, and as much again on either side as it was wide, but at least half
#    of the largest value: outside, people are warned. What the robot can do is what you know: say
#    that as `range`, outside of which a node fails. Places, angles, distances and counters have
#    neither here, nor has what only trembled: the robot may not have moved.
#  - `period: none` is event-driven: it is never silent. Where that is wrong, give a period in s.
#  - `contain: none`: the node is never killed, for what stands behind it.
#    `contain: node`: it is killed all the same. Without either, healing decides.
#  - `derived_from`: what a service is computed from; none of these is ever replaced by it.
#  - A topic is healed while somebody subscribes to it. `needed: true` or `needed: false` says
#    otherwise. docs/reference/som.md has all keys.
"""
ONTOLOGY_HEAD = """\
# A draft of an ontology, made by `shsa init` from {source}.
# Units are those that ROS fixes (REP 103, the message's definition). No unit: nobody knows.
# Relations say how one property follows from others: see docs/reference/ontology.md,
# and `shsa learn` learns them. What is learned holds as far as the recording went, and no further.
"""


Listed = Tuple[Pairs, Pairs, Pairs]
"""Publishers and subscribers of topics, and who serves ROS services, as the master lists them."""
UNLISTED: Listed = (frozenset(), frozenset(), frozenset())


@dataclass(frozen=True)
class Draft:
    """The texts of a SOM and an ontology, how much they have, and how much was left out."""

    som: str
    ontology: str
    services: int
    properties: int
    left_out: int


@dataclass(frozen=True)
class _Entry:
    """A service as text, and the properties that it provides, as those of the ontology."""

    som: Tuple[str, ...]
    ontology: Tuple[str, ...]
    names: Tuple[str, ...]


def draft(
    survey: Survey, source: str, notes: Sequence[str] = (), listed: Listed = UNLISTED
) -> Draft:
    """Draft both files; `source`: what the survey was made from; `notes`: more to be told."""
    refused = [each for each in survey.refused if each.topic not in LOGS]
    names = service_names([facts.publisher for facts in survey.facts])
    entries: List[_Entry] = []
    used: Set[str] = set()
    for facts in survey.facts:
        taken = set(used)
        entry = _entry(facts, names[facts.publisher], taken)
        why = _invalid(entry) if entry.names else _numberless(facts)
        if why:
            refused.append(Refused(*facts.publisher, why))
        else:
            entries.append(entry)
            used = taken
    said = [f"# {shown(note, LONGEST)}" for note in notes]
    head = HEAD.format(source=shown(source, LONGEST)).splitlines() + said
    services = _by_graph([line for entry in entries for line in entry.som], survey, listed)
    properties = [line for entry in entries for line in entry.ontology]
    som = [*head, "services:" if services else "services: {}", *services, *_left_out(refused)]
    ontology = ONTOLOGY_HEAD.format(source=shown(source, LONGEST)).splitlines()
    ontology += ["properties:" if properties else "properties: {}", *properties, "relations: {}"]
    count = sum(len(entry.names) for entry in entries)
    return Draft(_text(som), _text(ontology), len(entries), count, len(refused))


def _text(lines: Sequence[str]) -> str:
    return "\n".join(lines) + "\n"


def _by_graph(services: List[str], survey: Survey, listed: Listed) -> List[str]:
    """Return the services with what the graph tells of their nodes.

    What a service publishes may be computed from what its node subscribes to: a substitute that
    reads the one for the other would hear itself. One with duties is not killed.
    """
    if not services:
        return []
    publishers = listed[0] | {(each.topic, each.node) for each in survey.refused}
    publishers |= {(each.publisher.topic, each.publisher.node) for each in survey.facts}
    read, _ = read_tree(parse_yaml(_text(["services:", *services]), "the draft"))
    reads = _reads(read, listed[1])
    som = read.with_services(
        replace(each, derived_from=tuple(reads.predecessors(each.name))) for each in read
    )
    duties = duties_of(som, Names("/"), publishers, *listed[1:])
    told: List[List[str]] = []
    for service in som:
        lines = []
        reason = " and ".join(duties.get(service.node, ()))
        if reason:
            why = f"it {shown(reason, LONGEST)}, which nothing takes over"
            lines.append(f"    contain: none  # {why}")
        if service.derived_from:
            names = ", ".join(service.derived_from)
            why = "its node subscribes to them: keep those that it is computed from"
            lines.append(f"    derived_from: [{names}]  # {why}")
        told.append(lines)
    found = iter(told)
    return [new for line in services for new in (*(next(found) if line == PROVIDES else ()), line)]


def _reads(som: Som, subscribers: Pairs) -> "nx.DiGraph[str]":
    """Return an edge from each service to those whose node subscribes to it; without loops.

    A node does not compute what it measures from its commands. Of other loops nobody knows where
    they are open.
    """
    reads: "nx.DiGraph[str]" = nx.DiGraph()
    reads.add_nodes_from(each.name for each in som)
    for service in som:
        others = [each for each in som if each.node != service.node and not is_command(each)]
        heard = [each.name for each in others if (each.topic, service.node) in subscribers]
        reads.add_edges_from((name, service.name) for name in heard)
    loops = map(reads.subgraph, list(nx.strongly_connected_components(reads)))
    reads.remove_edges_from([edge for loop in loops for edge in loop.edges])
    return reads


def _invalid(entry: _Entry) -> str:
    """Return why a service cannot stand in a SOM; empty if it can."""
    try:
        _, errors = read_tree(parse_yaml(_text(["services:", *entry.som]), "the draft"))
    except ModelError as error:
        return error.what
    return errors[0].what if errors else ""


def _numberless(facts: Facts) -> str:
    """Return why a publisher is no service, and how often it publishes."""
    parts = "; ".join(f"{each.path} is {each.why}" for each in facts.left_out[:3])
    return f"it holds no number with a field ({_rhythm(facts)}){': ' if parts else ''}{parts}"


def _left_out(refused: Sequence[Refused]) -> Iterator[str]:
    if refused:
        yield "# Left out:"
    for each in refused[:MOST_COMMENTS]:
        of = f"{each.topic} ({each.type})" if each.type else each.topic
        by = f" of {each.node}" if each.node else ""
        yield f"#   {shown(of, LONGEST)}{shown(by, LONGEST)}: {shown(each.why, 2 * LONGEST)}"
    if len(refused) > MOST_COMMENTS:
        yield f"#   and {len(refused) - MOST_COMMENTS} more"


def _entry(facts: Facts, name: str, used: Set[str]) -> _Entry:
    publisher = facts.publisher
    lines = [
        f"  {name}:",
        f"    topic: {_quoted(publisher.topic)}",
        f"    type: {_quoted(publisher.type)}",
        f"    node: {_quoted(publisher.node)}{_about_node(publisher)}",
        f"    period: {'none' if facts.period is None else repr(facts.period)}  # {_rhythm(facts)}",
        *(["    latched: true"] if facts.latched else []),
        PROVIDES,
    ]
    provided = {field for field in facts.fields if not _useless(field)}
    if not provided:
        provided = {field for field in facts.fields if not _never_finite(field)}
    names: List[str] = []
    ontology: List[str] = []
    useless: Dict[str, List[str]] = {}
    for field in facts.fields:
        number = field.number
        if field not in provided:
            useless.setdefault(_useless(field), []).append(number.field)
            continue
        names.append(property_name(name, number.words, used))
        unit = f"unit: {_quoted(number.meaning.unit)}" if number.meaning.unit else ""
        lines.append(f"      {names[-1]}: {_provision(facts, field)}{_comment(field)}")
        slides = "; if it slides: m, m/s or N" if publisher.type == SLIDES and unit else ""
        ontology.append(f"  {names[-1]}: {{{unit}}}  # {publisher.topic} {number.field}{slides}")
    for part in facts.left_out:
        useless.setdefault(shown(part.why, LONGEST), []).append(shown(part.path, LONGEST))
    for why, fields in useless.items():
        lines += _wrapped(f"{why}: {', '.join(fields)}")
    return _Entry(tuple(lines), tuple(ontology), tuple(names))


def _wrapped(text: str) -> List[str]:
    """Return a comment among the values of a service."""
    return textwrap.wrap(text, 100, initial_indent="      # ", subsequent_indent="      #   ")


def _quoted(text: str) -> str:
    """Return the text so that YAML reads it as it is."""
    return text if _PLAIN.fullmatch(text) else json.dumps(text)


def _about_node(publisher: Publisher) -> str:
    if publisher.node == UNKNOWN_NODE:
        return "  # nobody tells who published it: fill in"
    if _ANONYMOUS.search(publisher.node):
        return "  # a name that changes with each start: give the node a fixed one"
    return ""


def _rhythm(facts: Facts) -> str:
    rhythm = facts.rhythm
    if rhythm.period is None:
        return facts.why
    told = f"{rhythm.count} messages, every {rhythm.period:.3g} s"
    if facts.why:
        return f"{told}, but {facts.why}" if facts.why not in told else told
    return f"{told}; 95 % of them within {rhythm.jitter:.2g} s of that"


def _never_finite(field: Field) -> bool:
    return field.spread is not None and field.spread.lowest is None


def _useless(field: Field) -> str:
    """Return why the values of a field tell nothing; empty: they do, or there are none."""
    spread = field.spread
    if spread is None:
        return ""
    if spread.lowest is None:
        return "always NaN" if spread.nan == 1.0 else "never a finite number"
    return f"always {spread.lowest:.6g}" if spread.constant else ""


def _provision(facts: Facts, field: Field) -> str:
    """Return the entry of a value in the SOM."""
    text = field.number.field
    told = [f"field: {text if _PLAIN_FIELD.fullmatch(text) else json.dumps(text)}"]
    limits = _usual(field)
    if limits is not None:
        told.append(f"usual: [{limits[0]!r}, {limits[1]!r}]")
    spread = field.spread
    distance = is_distance(facts.publisher.type, text)
    if spread is not None and spread.nan + spread.infinite > 0.0 and not distance:
        told.append("checks: {not_a_number: false}")
    return f"{{{', '.join(told)}}}"


def _usual(field: Field) -> Optional[Tuple[float, float]]:
    """Return what is usual of a value, from what was seen; None where it may go on."""
    spread, number = field.spread, field.number
    if spread is None or spread.lowest is None or spread.highest is None:
        return None
    if (
        spread.constant
        or spread.one_way
        or spread.trembles
        or number.kind in STATES
        or not number.meaning.bounded
    ):
        return None
    if parse_field(number.field).function in ANGLES:
        return None
    if not SMALLEST < max(abs(spread.lowest), abs(spread.highest)) < LARGEST:
        return None
    low, high = widened(spread.lowest, spread.highest)
    if number.kind in WHOLE:
        low, high = max(low, WHOLE[number.kind][0]), min(high, WHOLE[number.kind][1])
    return (low, high) if low < high else None


def widened(lowest: float, highest: float) -> Tuple[float, float]:
    """Return a range around what was seen, with two digits.

    On either side it is as much wider as that was wide, and at least half of the largest value.
    """
    margin = max(highest - lowest, 0.5 * max(abs(lowest), abs(highest)))
    step = 10.0 ** (math.floor(math.log10(margin)) - 1)
    low, high = round((lowest - margin) / step, 6), round((highest + margin) / step, 6)
    return float(f"{math.floor(low) * step:.12g}"), float(f"{math.ceil(high) * step:.12g}")


def _comment(field: Field) -> str:
    """Return a comment with what was seen of a value."""
    spread = field.spread
    if spread is None:
        return "  # nothing was heard of it"
    if spread.constant:
        return f"  # always {spread.lowest:.6g} while this was made"
    parts = [
        f"{spread.lowest:.4g} to {spread.highest:.4g}",
        f"90 % of it {spread.p5:.4g} to {spread.p95:.4g}",
    ]
    if spread.one_way:
        parts.append("it never turned back")
    elif spread.trembles:
        parts.append("it only trembled")
    for share, what in ((spread.nan, "NaN"), (spread.infinite, "infinite")):
        if share > 0.0:
            parts.append(f"{100.0 * share:.2g} % {what}")
    unit = field.number.meaning.unit
    return f"  # {unit + ': ' if unit else ''}{', '.join(parts)}"
