"""`shsa replay`: the decisions of a journal, made again."""
import argparse
import json
from dataclasses import MISSING, fields, is_dataclass
from enum import Enum
from math import inf
from statistics import median
from typing import Any, Callable, Dict, Iterator, List, Optional

from shsa_core.cli._common import say
from shsa_learning.replay import Journal, Step, replay

DIFFER = "differ from the recording"
PROBLEMS: Dict[str, Callable[[Step], bool]] = {
    DIFFER: lambda step: step.differs,
    "raise an error": lambda step: bool(step.error),
    "leave an invariant broken": lambda step: bool(step.broken),
}
WIDTH, TEXT_WIDTH, ITEMS = 110, 60, 3
"""Of an event or a command in one line: characters, those of a text, items of a list."""


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "replay",
        help="make the decisions of a journal again",
        description="Runs the events of a journal through the same machine again and prints each "
        "decision: when, about what, which commands, how long it took. Exit status 1 if a decision "
        "is another one than was recorded, raises an error or leaves an invariant broken.",
    )
    parser.add_argument("journal", metavar="JOURNAL", help="the file that a node's --journal names")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    for option, name, default in (("--from", "first", -inf), ("--until", "last", inf)):
        parser.add_argument(
            option,
            dest=name,
            metavar="T",
            type=float,
            default=default,
            help="s after the first event",
        )
    parser.add_argument(
        "--only", metavar="TOPIC", help="what names this topic, or this service or node"
    )
    parser.add_argument(
        "--all", action="store_true", help="print events as well that were answered by nothing"
    )


class _Summary:
    """Counts of all events, whichever were printed."""

    def __init__(self) -> None:
        self.start: Optional[float] = None
        self.seconds: List[float] = []
        self.decisions = 0
        self.slowest: Optional[Step] = None
        self.problems: Dict[str, List[str]] = {what: [] for what in PROBLEMS}
        self.unknown = False

    def add(self, step: Step) -> float:
        """Count a step; return its time after the first event, in s."""
        if self.start is None:
            self.start = step.event.time
        self.seconds.append(step.seconds)
        self.decisions += bool(step.commands)
        self.unknown |= step.then is None
        if self.slowest is None or step.seconds > self.slowest.seconds:
            self.slowest = step
        for what, has in PROBLEMS.items():
            self.problems[what] += [step.where] if has(step) else []
        return float(step.event.time - self.start)

    def document(self) -> Dict[str, Any]:
        """Return it for programs."""
        differences, errors, broken = self.problems.values()
        return {
            "events": len(self.seconds),
            "decisions": self.decisions,
            "identical": not differences,
            "first_difference": differences[0] if differences else None,
            "errors": len(errors),
            "broken": len(broken),
            "median_seconds": median(self.seconds) if self.seconds else None,
            "slowest_seconds": self.slowest.seconds if self.slowest else None,
        }

    def lines(self) -> Iterator[str]:
        """Yield it for people."""
        yield f"{len(self.seconds)} events, {self.decisions} decisions"
        if self.slowest is not None and self.start is not None:
            event = self.slowest.event
            when = f"{type(event).__name__} at {event.time - self.start:.3f} s"
            yield f"median {_us(median(self.seconds))}, slowest {_us(self.slowest.seconds)}: {when}"
        if self.unknown:
            yield "the answer to the last event is not in the journal"
        for what, steps in self.problems.items():
            if steps:
                yield f"{len(steps)} decisions {what}, first that of {steps[0]}"
        if not self.problems[DIFFER]:
            yield "identical to the recording"


def run(args: argparse.Namespace) -> int:
    """Print the decisions. Returns 1 if one differs, raises an error or breaks an invariant."""
    journal = Journal(args.journal)
    summary = _Summary()
    if not args.json:
        say(f"{journal.kind.name}, recorded from {journal.begun}")
    decisions, matched = [], False
    for step in replay(journal):
        moment = summary.add(step)
        if not _wanted(args, journal, step, moment):
            continue
        matched = True
        if args.json:
            decisions.append(_as_dict(journal, step, moment))
        else:
            say("\n".join(_lines(step, moment)))
    if args.json:
        document = {
            "machine": journal.kind.name,
            "begun": journal.begun,
            "end": journal.end,
            "decisions": decisions,
            "summary": summary.document(),
        }
        print(json.dumps(document, indent=2))
    else:
        if args.only is not None and not matched:
            say(f"no decision that is asked for names {args.only}")
        say(f"end: {journal.end}")
        say("\n".join(summary.lines()))
    return 1 if any(summary.problems.values()) else 0


def _wanted(args: argparse.Namespace, journal: Journal, step: Step, moment: float) -> bool:
    says = args.all or step.commands or step.differs or step.error or step.broken
    if not says or not args.first <= moment <= args.last:
        return False
    return args.only is None or any(_names(each, args.only) for each in _encoded(journal, step))


def _encoded(journal: Journal, step: Step) -> Iterator[Any]:
    yield journal.kind.events.encode(step.event)
    for command in step.commands:
        yield journal.kind.commands.encode(command)


def _names(data: Any, name: str) -> bool:
    if isinstance(data, dict):
        return any(_names(each, name) for each in data.values())
    if isinstance(data, list):
        return any(_names(each, name) for each in data)
    return bool(data == name)


def _lines(step: Step, moment: float) -> Iterator[str]:
    yield f"{moment:10.3f} s  {in_short(step.event)}  [{_us(step.seconds)}]"
    for command in step.commands:
        yield f"{'':14}-> {in_short(command)}"
    if step.error:
        yield f"{'':14}!! raises {step.error}"
    if step.broken:
        yield f"{'':14}!! broken: {step.broken}"
    if step.then is not None and step.differs:
        same = step.then.names == step.now.names
        names = ", ".join(step.then.names) or "nothing"
        yield f"{'':14}!! recorded: {names}{', with other contents' if same else ''}"


def _as_dict(journal: Journal, step: Step, moment: float) -> Dict[str, Any]:
    event, *commands = _encoded(journal, step)
    return {
        "time": moment,
        "where": step.where,
        "event": event,
        "commands": commands,
        "seconds": step.seconds,
        "differs": step.differs,
        "recorded": step.then.names if step.then is not None else None,
        "error": step.error,
        "broken": step.broken,
    }


def _us(seconds: float) -> str:
    return f"{seconds * 1e6:.0f} us"


def in_short(value: Any) -> str:
    """Return the class and its fields on one line, without the time and without defaults."""
    words = [type(value).__name__, *_words(value)]
    return _cut(" ".join(words), WIDTH)


def _words(value: Any) -> List[str]:
    words = []
    for each in fields(value):
        content = getattr(value, each.name)
        usual = each.default is not MISSING and content == each.default
        if each.init and each.name != "time" and content is not None and not usual:
            words.append(_field(each.name, content))
    return [word for word in words if word]


def _field(name: str, content: Any) -> str:
    if isinstance(content, bool):
        return name if content else f"not {name}"
    text = _text(content)
    return f"{name}={text}" if isinstance(content, (int, float, tuple)) and text else text


def _text(content: Any) -> str:
    if isinstance(content, Enum):
        return str(content.value)
    if isinstance(content, float):
        return f"{content:.6g}"
    if isinstance(content, (tuple, list)):
        shown = [_text(each) for each in content[:ITEMS]]
        more = [f"+{len(content) - ITEMS}"] if len(content) > ITEMS else []
        return f"[{', '.join(shown + more)}]" if content else ""
    if is_dataclass(content):
        return f"({_cut(' '.join(_words(content)), TEXT_WIDTH)})"
    if hasattr(content, "__len__") and not isinstance(content, str):
        return f"{type(content).__name__} of {len(content)}"
    return _cut(" ".join(str(content).split()), TEXT_WIDTH)


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else text[: width - 3] + "..."
