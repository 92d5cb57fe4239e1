"""`shsa replay`: makes the decisions of a journal again."""
import argparse
import json
from math import inf
from statistics import median
from typing import Any, Dict, Iterator, List, Optional, Tuple

from shsa_core.cli._output import say
from shsa_core.cli._short import in_short
from shsa_core.journal.lines import Answer
from shsa_core.journal.reader import Journal, Step, replay


def add_parser(subparsers: Any) -> None:
    """Adds the command."""
    parser = subparsers.add_parser(
        "replay",
        help="make the decisions of a journal again",
        description="Runs the events of a journal through the same machine again and prints each "
        "decision: when, about what, which commands, how long it took. Exit status 1 if a decision "
        "is another one than was recorded, raises an error or leaves an invariant broken.",
    )
    parser.add_argument("journal", metavar="JOURNAL", help="the file that a node's --journal names")
    parser.add_argument("--json", action="store_true", help="print one JSON document")
    parser.add_argument(
        "--from",
        dest="first",
        metavar="T",
        type=float,
        default=-inf,
        help="s after the first event",
    )
    parser.add_argument(
        "--until", dest="last", metavar="T", type=float, default=inf, help="s after the first event"
    )
    parser.add_argument(
        "--only", metavar="TOPIC", help="what names this topic, or this service or node"
    )
    parser.add_argument(
        "--all", action="store_true", help="print events as well that were answered by nothing"
    )


class _Summary:
    """What is said at the end; of all events, whichever were printed."""

    def __init__(self) -> None:
        self.start: Optional[float] = None
        self.seconds: List[float] = []
        self.decisions = 0
        self.slowest: Optional[Step] = None
        self.differences: List[Step] = []
        self.errors: List[Step] = []
        self.broken: List[Step] = []
        self.unknown = 0

    def add(self, step: Step) -> float:
        """Counts a step; its time after the first event in s."""
        if self.start is None:
            self.start = step.event.time
        self.seconds.append(step.seconds)
        self.decisions += bool(step.commands)
        self.unknown += step.then is None
        if self.slowest is None or step.seconds > self.slowest.seconds:
            self.slowest = step
        for list_, counts in (
            (self.differences, step.differs),
            (self.errors, bool(step.error)),
            (self.broken, bool(step.broken)),
        ):
            if counts:
                list_.append(step)
        return float(step.event.time - self.start)

    @property
    def good(self) -> bool:
        """Whether every decision is the recorded one, and a sound one."""
        return not (self.differences or self.errors or self.broken)

    def as_dict(self) -> Dict[str, Any]:
        """The summary for programs."""
        return {
            "events": len(self.seconds),
            "decisions": self.decisions,
            "identical": not self.differences,
            "first_difference": self.differences[0].where if self.differences else None,
            "errors": len(self.errors),
            "broken": len(self.broken),
            "median_seconds": median(self.seconds) if self.seconds else None,
            "slowest_seconds": self.slowest.seconds if self.slowest else None,
        }

    def lines(self) -> Iterator[str]:
        """The summary for people."""
        yield f"{len(self.seconds)} events, {self.decisions} decisions"
        if self.slowest is not None and self.start is not None:
            event = self.slowest.event
            when = f"{type(event).__name__} at {event.time - self.start:.3f} s"
            yield f"median {_us(median(self.seconds))}, slowest {_us(self.slowest.seconds)}: {when}"
        if self.unknown:
            yield "the answer to the last event is not in the journal"
        for what, steps in (
            ("differ from the recording", self.differences),
            ("raise an error", self.errors),
            ("leave an invariant broken", self.broken),
        ):
            if steps:
                yield f"{len(steps)} decisions {what}, first that of {steps[0].where}"
        if not self.differences:
            yield "identical to the recording"


def run(args: argparse.Namespace) -> int:
    """Prints the decisions.

    Returns 0, or 1 if one differs, raises an error or leaves an invariant broken.
    """
    journal = Journal(args.journal)
    summary = _Summary()
    if not args.json:
        say(f"{journal.kind.name}, recorded from {journal.begun}")
    decisions = []
    for step in replay(journal):
        moment = summary.add(step)
        if not _wanted(args, journal, step, moment):
            continue
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
            "summary": summary.as_dict(),
        }
        print(json.dumps(document, indent=2))
    else:
        say(f"end: {journal.end}")
        say("\n".join(summary.lines()))
    return 0 if summary.good else 1


def _wanted(args: argparse.Namespace, journal: Journal, step: Step, moment: float) -> bool:
    """Whether the options ask for a step."""
    if not args.first <= moment <= args.last:
        return False
    if not (args.all or step.commands or step.differs or step.error or step.broken):
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
    for problem in _problems(step):
        yield f"{'':14}!! {problem}"


def _problems(step: Step) -> Iterator[str]:
    if step.error:
        yield f"raises {step.error}"
    if step.broken:
        yield f"broken: {step.broken}"
    if step.then is not None and step.differs:
        same = step.then.names == step.now.names
        yield f"recorded: {_answer(step.then)}{', with other contents' if same else ''}"


def _answer(answer: Answer) -> str:
    return ", ".join(answer.names) or "nothing"


def _as_dict(journal: Journal, step: Step, moment: float) -> Dict[str, Any]:
    encoded: Tuple[Any, ...] = tuple(_encoded(journal, step))
    return {
        "time": moment,
        "where": step.where,
        "event": encoded[0],
        "commands": encoded[1:],
        "seconds": step.seconds,
        "differs": step.differs,
        "recorded": step.then.names if step.then is not None else None,
        "error": step.error,
        "broken": step.broken,
    }


def _us(seconds: float) -> str:
    return f"{seconds * 1e6:.0f} us"
