"""`shsa learn`: a relation learned from recordings, or why there is none."""
import argparse
import datetime
import json
import os
from typing import TYPE_CHECKING, Any, Dict, List, Sequence

from tabulate import tabulate

from shsa_core.cli._common import say
from shsa_core.errors import ModelError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.regular import read_text
from shsa_core.files.som_file import read_som
from shsa_core.model.ontology import Ontology
from shsa_learning.cli._common import whole_number
from shsa_learning.cli._namespace import add_namespace

if TYPE_CHECKING:
    from shsa_learning.learn.learner import Learned
    from shsa_learning.learn.rows import Data

BAR = "{desc}: {percentage:3.0f} %|{bar}| {elapsed}, {remaining} left"
QUIET: Dict[str, Any] = {"leave": False, "disable": None}
MODELS = ("auto", "terms", "linear", "polynomial", "svr", "mlp")


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "learn",
        help="learn a relation from recordings",
        description="Learns how a property follows from others, from rosbags and CSV files, and "
        "how far that is from the truth on data that it has not seen. It refuses, with the "
        "figures, where the data does not carry it.",
    )
    parser.add_argument("property", metavar="PROPERTY", help="what is to be learned")
    parser.add_argument(
        "--data",
        metavar="FILE",
        nargs="+",
        required=True,
        help="rosbags (with --som), CSV files (one a source, the first column is the time in s), "
        "and folders of these",
    )
    parser.add_argument("--som", metavar="FILE", help="the service-to-ontology mapping")
    add_namespace(parser)
    parser.add_argument(
        "--dask",
        metavar="ADDRESS",
        default="",
        help="have the workers of this scheduler of dask read the bags, under the same paths",
    )
    parser.add_argument(
        "--from",
        metavar="P,...",
        dest="inputs",
        type=_names,
        default=(),
        help="the inputs (whatever may be one)",
    )
    parser.add_argument("--model", choices=MODELS, default="auto", help="its form (auto)")
    parser.add_argument(
        "--terms", type=whole_number(1), default=5, help="the most terms of a short model (5)"
    )
    parser.add_argument("--seed", type=whole_number(0), default=0, help="of what is drawn (0)")
    parser.add_argument(
        "--ontology", metavar="FILE", help="its relations compete; with --write it gets the new one"
    )
    parser.add_argument("--write", action="store_true", help="write the relation into --ontology")
    parser.add_argument("--report", metavar="PAGE", help="write one HTML page about it")
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def _names(text: str) -> Sequence[str]:
    names = tuple(dict.fromkeys(name.strip() for name in text.split(",")))
    if not all(names):
        raise argparse.ArgumentTypeError(f"{text!a} is no list of properties: a,b,c")
    return names


def run(args: argparse.Namespace) -> int:
    """Print what was learned, and write what was asked for. Returns 0, or 1 if it is refused."""
    # For small matrices threads cost more than they give; numpy looks for this as it is loaded.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    # What fits and what reads bags takes a second to load, which no other command should wait for.
    from tqdm import tqdm

    from shsa_learning.learn.evaluation import knowledge, laws
    from shsa_learning.learn.learner import learn
    from shsa_learning.learn.relation import relation_of, with_relation
    from shsa_learning.learn.rows import gather
    from shsa_learning.recordings.data import files, read

    if args.write and not args.ontology:
        raise ModelError("--write", "needs --ontology, the file that gets the relation")
    before, ontology = _ontology(args)
    som = read_som(args.som, args.namespace) if args.som else None
    size = sum(os.path.getsize(path) for path in files(args.data) if os.path.isfile(path))
    with tqdm(total=size, desc="reading", unit="B", unit_scale=True, **QUIET) as bar:
        recordings = read(args.data, som, ontology if before else None, bar.update, args.dask)
    data = gather(recordings, args.property, args.inputs, som)
    with tqdm(total=1.0, desc="learning", bar_format=BAR, **QUIET) as bar:
        learned = learn(
            data,
            args.model,
            args.seed,
            laws(ontology, data.table),
            _provenance(args, data),
            bar.update,
            args.terms,
            knowledge(ontology, data.table),
        )
    relation = relation_of(learned) if learned.accepted else None
    answer = document(learned)
    if args.report:
        from shsa_learning.cli._learn_page import page

        with open(args.report, "w", encoding="utf-8") as stream:
            stream.write(page(learned, data.outliers, data.notes))
    if args.json:
        print(json.dumps(answer, indent=2))
    else:
        for line in summary(learned, data):
            say(line)
    if relation is not None and args.write:
        _write(args.ontology, before, with_relation(ontology, relation))
        if not args.json:
            say(f"{args.ontology} has it as the relation {relation.relation}")
    return 0 if learned.accepted else 1


def _ontology(args: argparse.Namespace) -> Any:
    """Read the ontology file and its text; one that is to be written need not exist."""
    if not args.ontology or args.write and not os.path.exists(args.ontology):
        return "", Ontology({}, {}, ())
    return read_text(args.ontology), read_ontology(args.ontology)


def _write(path: str, before: str, ontology: Ontology) -> None:
    from shsa_learning.saving import save_ontology

    now = read_text(path) if os.path.exists(path) else ""
    if now != before:
        raise ModelError(path, "was changed while this learned; nothing is written")
    save_ontology(ontology, path)


def _provenance(args: argparse.Namespace, data: "Data") -> str:
    """Files, duration, date and seed, in words."""
    files = ", ".join(os.path.basename(path) for path in args.data)
    today = datetime.date.today().isoformat()
    return f"{files}: {data.table.duration:.0f} s, {today}, seed {args.seed}"


def document(learned: "Learned") -> Dict[str, Any]:
    """Return the answer for programs."""
    error, model = learned.error, learned.model
    span = learned.span
    return {
        "property": learned.target,
        "accepted": learned.accepted,
        "model": model.choice.recipe.rung if model else None,
        "function": model.function if model else None,
        "constraint": model.constraint if model else None,
        "inputs": list(model.inputs) if model else [],
        "terms": [part._asdict() for part in model.parts] if model else [],
        "rms": error.rms if error else None,
        "nrmse": error.rms / span if error else None,
        "bias": error.bias if error else None,
        "p95": error.p95 if error else None,
        "delay": error.delay if error else None,
        "baseline_nrmse": error.baseline / span if error and error.baseline else None,
        "worst_block_nrmse": learned.worst / span if error else None,
        "blocks": learned.blocks,
        "reason": "; ".join(learned.reasons),
        "left_out": dict(learned.left_out),
        "skipped": list(learned.skipped),
    }


def summary(learned: "Learned", data: "Data") -> List[str]:
    """Return the answer in words, line by line."""
    lines = []
    if learned.accepted and learned.model and learned.error:
        model = learned.model
        lines += [
            f"{learned.target} by {model.name} from {', '.join(model.inputs)}",
            f"function    {model.function}",
            f"constraint  {model.constraint}",
        ]
    else:
        lines.append(f"{learned.target} is not learned:")
        lines += [f"  {reason}" for reason in learned.reasons]
    if learned.model and learned.error:
        lines += _figures(learned)
    lines += [f"left out: {name}: {why}" for name, why in learned.left_out.items()]
    lines += [f"skipped: {failed}" for failed in learned.skipped]
    lines += [f"outliers left out: {count} of {name}" for name, count in data.outliers.items()]
    return lines + [f"note: {note}" for note in data.notes]


def _figures(learned: "Learned") -> List[str]:
    error, span, model = learned.error, learned.span, learned.model
    assert error is not None and model is not None and error.p95 is not None
    assert error.baseline is not None
    rows = [
        (
            rung.recipe.named(learned.ladder),
            f"{100.0 * rung.rms / span:.2f}",
            f"{100.0 * rung.standard_error / span:.2f}",
        )
        for rung in model.choice.rungs
    ]
    table = tabulate(rows, ("model", "NRMSE / %", "error of the difference"), disable_numparse=True)
    return [
        f"error on {learned.blocks} blocks that it had not seen: RMS {error.rms:.4g} "
        f"({100.0 * error.rms / span:.2f} % of the range), bias {error.bias:.3g}, 95 % within "
        f"{error.p95:.4g}; the mean has {100.0 * error.baseline / span:.2f} %, its worst block "
        f"{100.0 * learned.worst / span:.2f} %; it lags by {error.delay:.2g} s",
        *table.split("\n"),
    ]
