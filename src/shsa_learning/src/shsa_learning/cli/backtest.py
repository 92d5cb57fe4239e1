"""`shsa backtest`: every derivation of a property on recorded data."""
import argparse
import json
import math
from typing import TYPE_CHECKING, Any, Dict, Iterable, List, Optional, Tuple

from shsa_core.cli._common import say
from shsa_core.errors import ModelError
from shsa_core.model.error import Error
from shsa_core.model.ontology import Ontology
from shsa_learning.cli._common import (
    Table,
    add_models,
    check_property,
    read_models,
    show,
    whole_number,
)

if TYPE_CHECKING:
    from shsa_learning.backtest.backtest import Ranking, Trial

SHOWN = 10
"""Derivations in a table; all are in --json."""
PICTURES = (".png", ".svg", ".pdf")


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "backtest",
        help="try every derivation of a property on recorded data",
        description="Runs every substitute of a measured property over recorded data and compares "
        "it with what was measured: how far it is off, how late, and how often it has no value. "
        "Says what would have been chosen, and what should have been. Exit status 1 if there is "
        "nothing to be tried.",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("property", metavar="PROPERTY", nargs="?", help="what is tried")
    what.add_argument("--all", action="store_true", help="all that was measured (the default)")
    add_models(parser)
    parser.add_argument(
        "--data",
        metavar="FILE",
        nargs="+",
        required=True,
        help="rosbags, and CSV files: a column `time` in s, the others named after properties",
    )
    parser.add_argument(
        "--limit",
        type=whole_number(1),
        default=200,
        metavar="N",
        help="of each property try N derivations at most, those of the highest quality (200)",
    )
    parser.add_argument("--plot", metavar="FILE", help="draw an image: .png, .svg or .pdf")
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(args: argparse.Namespace) -> int:
    """Print what each derivation is worth. Returns 0, or 1 if there was nothing to be tried."""
    if args.plot is not None and not args.plot.endswith(PICTURES):
        raise ModelError("--plot", f"{args.plot} does not end in {', '.join(PICTURES)}")
    # Libraries of numbers, which only this command needs, take longer to load than others to run.
    from shsa_learning.backtest.backtest import Backtest
    from shsa_learning.recordings.data import read
    from shsa_learning.recordings.reservoir import ALL_ROWS

    ontology, som = read_models(args)
    if args.property is not None:
        check_property(args.property, ontology, som)
    recordings = read(args.data, som, ontology, most=ALL_ROWS)
    backtest = Backtest(ontology, som, recordings)
    notes = [f"{each.name}: {note}" for each in recordings for note in each.notes]
    missing = [source.path for source in backtest.unrecorded]
    if missing:
        notes.append(f"not recorded, so that nothing is derived from it: {', '.join(missing)}")
    rankings: "List[Ranking]" = []
    for target in backtest.targets(args.property):
        rankings.append(backtest.rank(target, args.limit, _watch))
    tried = [each for each in rankings if each.best is not None]
    if not rankings:
        what = "nothing that the SOM provides was"
        if args.property is not None:
            what = f"{args.property} was not"
        notes.append(f"{what} measured in the data, so nothing can be compared")
    if args.json:
        document = {
            "data": [each.name for each in recordings],
            "properties": [_document(each) for each in rankings],
            "notes": notes,
        }
        print(json.dumps(_plain(document), indent=2, allow_nan=False))
    else:
        for each in rankings:
            _print(each, ontology)
        for note in notes:
            say(f"Note: {note}.")
    if args.plot is not None and tried:
        from shsa_learning.cli._backtest_picture import draw

        draw(backtest, tried, ontology, args.plot)
    return 0 if tried else 1


def _plain(value: Any) -> Any:
    """Return a document for JSON: numbers that are not finite are null."""
    if isinstance(value, dict):
        return {key: _plain(each) for key, each in value.items()}
    if isinstance(value, list):
        return [_plain(each) for each in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _watch(work: Iterable[Any], total: int, what: str) -> Iterable[Any]:
    """Shows on a terminal how far the work is."""
    from tqdm import tqdm

    shown: Iterable[Any] = tqdm(work, desc=what, total=total, disable=None, leave=False)
    return shown


def _document(ranking: "Ranking") -> Dict[str, Any]:
    """Return all that was found of a property, for programs."""
    target = ranking.target
    return {
        "property": target.property,
        "service": target.service.name,
        "output": target.path,
        "baseline": ranking.baseline,
        "seconds": ranking.seconds,
        "points": ranking.points,
        "derivations": [_trial(each) for each in ranking.trials],
        "refused": [each._asdict() for each in ranking.refused],
        "complete": ranking.complete,
        "chosen": _place(ranking, ranking.chosen),
        "best": _place(ranking, ranking.best),
        "rank_correlation": {"predicted": ranking.by_prediction, "quality": ranking.by_quality},
    }


def _place(ranking: "Ranking", trial: "Optional[Trial]") -> Optional[int]:
    """Return the place of a trial among the derivations, from 0."""
    return ranking.trials.index(trial) if trial is not None else None


def _trial(trial: "Trial") -> Dict[str, Any]:
    document: Dict[str, Any] = {
        "relations": list(trial.relations),
        "inputs": list(trial.program.inputs),
        "code": trial.program.code,
        "quality": trial.quality,
        "place": trial.place,
        "predicted": _figures(trial.predicted),
        "covered": trial.covered,
        "real": None,
        "share": 0.0,
    }
    if trial.score is not None:
        score = trial.score
        real = {**(_figures(score.error) or {}), "nrmse": score.nrmse, "charged": score.charged}
        if score.resolution is None:
            real["delay"] = None
        real["delay_resolution"] = score.resolution
        worst = score.worst._asdict()
        document.update({"real": real, "share": score.share, "worst_minute": worst})
    return document


def _figures(error: Optional[Error]) -> Optional[Dict[str, Any]]:
    if error is None:
        return None
    names = ("rms", "bias", "p95", "delay", "baseline", "n")
    return {name: getattr(error, name) for name in names}


def _print(ranking: "Ranking", ontology: Ontology) -> None:
    """Print the trials of a property as a table, and what follows from them."""
    target = ranking.target
    unit = _unit(target.property, ontology)
    title = (
        f"{target.property} of {target.service.name} ({target.path}): "
        f"{ranking.points} values in {ranking.seconds:.0f} s. Who says their mean errs "
        f"{ranking.baseline:.3g}{unit}"
    )
    columns = (
        *("", "by", "from", f"error{unit}", "bias", "95 %", "late, s", "worst 60 s"),
        *("output, %", "predicted", "quality"),
    )
    numbered = list(enumerate(ranking.trials, 1))
    shown = [(n, each) for n, each in numbered if n <= SHOWN or each is ranking.chosen]
    rows = [_row(number, trial) for number, trial in shown]
    show(Table(title, columns, rows, "nothing derives it from what was recorded."))
    more = len(numbered) - len(shown)
    if more > 0:
        say(f"and {more} more; --json has all")
    if not ranking.complete:
        say("There are more derivations than were tried; see --limit.")
    for refused in ranking.refused[:SHOWN]:
        say(f"Not executable: {', '.join(refused.relations)}: {refused.why}")
    if ranking.best is None:
        say()
        return
    chosen, best = ranking.chosen or ranking.best, ranking.best
    if chosen is best:
        say(f"Healing would choose the best: {_by(best)}, which errs {_error(best)}{unit}.")
    else:
        say(f"Healing would choose {_by(chosen)}, which errs {_error(chosen)}{unit}.")
        say(f"It should choose {_by(best)}, which errs {_error(best)}{unit}.")
    told = (("its prediction", ranking.by_prediction), ("1 - quality", ranking.by_quality))
    ranks = [f"{value:+.2f} with {what}" for what, value in told if value is not None]
    if ranks:
        say(f"Rank correlation of the error: {', '.join(ranks)}.")
    say()


def _unit(property: str, ontology: Ontology) -> str:
    unit = ontology.properties[property].unit if property in ontology.properties else ""
    return f" {unit}" if unit else ""


def _row(number: int, trial: "Trial") -> Tuple[str, ...]:
    services = dict.fromkeys(source.service.name for source in trial.derivation.sources())
    predicted = "" if trial.predicted is None else f"{trial.predicted.rms:.3g}"
    head = str(number), _by(trial), ", ".join(services)
    if trial.score is None:
        return (*head, "", "", "", "", "", "0", predicted, f"{trial.quality:.3g}")
    error, worst = trial.score.error, trial.score.worst
    late = "?" if trial.score.resolution is None else f"{error.delay:.3g}"
    return (
        *head,
        *(f"{error.rms:.3g}", f"{error.bias:+.2g}", f"{error.p95:.3g}", late),
        *(f"{worst.rms:.3g}", f"{100.0 * trial.score.share:.0f}", predicted),
        f"{trial.quality:.3g}",
    )


def _by(trial: "Trial") -> str:
    return ", ".join(trial.relations) or "the same property elsewhere"


def _error(trial: "Trial") -> str:
    return "not known, as it had no output," if trial.score is None else _rms(trial.score.error)


def _rms(error: Error) -> str:
    return f"{error.rms:.3g}"
