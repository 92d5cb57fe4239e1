"""The reference as Markdown, made from the code and from the files that are installed with it.

Each function is one part of a page in docs/reference; nothing in these is written by hand.
"""
import argparse
import csv
import dataclasses
import re
from dataclasses import MISSING
from pathlib import Path
from typing import Any, Callable, Dict, Iterable, List, Optional, Sequence, Tuple, Type
from xml.etree import ElementTree

from shsa_core.cli.main import command_line
from shsa_core.files import keys
from shsa_core.files.parameters import PARAMETERS, names_of
from shsa_core.files.readers import Keys
from shsa_core.healing.transitions import TRANSITIONS
from shsa_core.healing.settings import Settings as HealingSettings
from shsa_core.language.functions import CALLS, STATEFUL
from shsa_core.language.temporal import OPERATORS
from shsa_core.model.checks import LEARNED, REGISTRY, Checks, Limit
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Provision, Service
from shsa_core.monitoring.settings import Settings as MonitoringSettings
from shsa_injection.vocabulary import FAULTS

ROOT = Path(__file__).resolve().parent.parent
MESSAGES = ROOT / "src" / "shsa_msgs"
WIDTH = 100
REQUIRED = "required"


def table(titles: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of Markdown."""
    lines = [titles, ["---"] * len(titles), *rows]
    shown = ("|".join(cell.replace("|", "\\|") for cell in line) for line in lines)
    return "".join(f"|{line}|\n" for line in shown)


def code(text: object) -> str:
    """A text in its own letters; nothing for an empty one."""
    return f"`{text}`" if str(text) else ""


def key_table(table_of: Keys, kind: Optional[Type[Any]] = None) -> str:
    """The keys of a mapping; `kind`: the class that has their defaults."""
    fields = {} if kind is None else {each.name: each for each in dataclasses.fields(kind)}
    rows = []
    for name, key in table_of.items():
        field = fields.get(name)
        default = "" if field is None or field.default is MISSING else _plain(field.default)
        level = "basic" if key.basic else "expert"
        rows.append(
            (code(name), level, key.reader.form, key.means, REQUIRED if key.required else default)
        )
    return table(("key", "for", "written", "what", "default"), rows)


BASIC_ARGUMENTS = (
    *("ontology", "som", "dry_run", "host", "journal", "incident_log", "secret", "view"),
)
"""The arguments of shsa.launch that a first robot needs."""


def basics() -> str:
    """All that a first robot needs to set."""
    places = {
        "the SOM": {"act": keys.SOM["act"]},
        "a service in the SOM": keys.SERVICE,
        "a value of it, under `provides`": keys.VALUE,
        "a property or constant in the ontology": {**keys.PROPERTY, **keys.CONSTANT},
        "a relation": keys.FUNCTION,
    }
    names = {at: [n for n, key in each.items() if key.basic] for at, each in places.items()}
    names["an argument of `shsa.launch`"] = list(BASIC_ARGUMENTS)
    return table(("of", "names"), [(at, " ".join(map(code, each))) for at, each in names.items()])


def som_checks() -> str:
    """The checks of a value, and of a message."""
    rows = []
    for name, check in REGISTRY.items():
        place = "a value" if name in keys.VALUE_CHECKS else "the service"
        row = (code(name), place, check.tells, _limit(check.default))
        rows.append((*row, _limit(check.usual)))
    return table(("check", "of", "fails if", "default", "`true` means"), rows)


def functions() -> str:
    """The functions of the language; those with a memory at the end."""
    rows = [
        (code(f"{name}({each.takes})"), each.tells, "yes" if name in STATEFUL else "")
        for name, each in CALLS.items()
    ]
    return table(("function", "what", "memory"), [*rows, ("`dt`", "s since the last one", "")])


def operators() -> str:
    """The operators of formulas."""
    rows = [(code(f"{name}({takes})"), tells) for name, (takes, tells) in OPERATORS.items()]
    return table(("operator", "true if"), rows)


def kinds() -> str:
    """The kinds of failure, as the message has them."""
    tells = {name.lower(): comment for _, name, comment in _constants(MESSAGES / "msg/Failure.msg")}
    rows = []
    for kind in Kind:
        check = REGISTRY.get(kind.value)
        tuned = "always on" if check is None else f"by {code('checks')}: {_limit(check.default)}"
        rows.append((code(kind), tells[kind.value], tuned))
    return table(("kind", "what", "found"), rows)


def transitions() -> str:
    """Every transition of a service."""
    rows = [
        (state.value, trigger.value, ", ".join(sorted(end.value for end in ends)))
        for (state, trigger), (_, ends) in TRANSITIONS.items()
    ]
    return table(("state", "when", "next state"), rows)


def injected() -> str:
    """The faults that can be injected."""
    rows = [(code(word), str(each.place), each.tells) for word, each in FAULTS.items()]
    return table(("fault", "made in", "what"), rows)


def parameters() -> str:
    """The parameters of monitor and reconfigurator."""
    nodes = {"monitor": MonitoringSettings(), "reconfigurator": HealingSettings()}
    rows = []
    for name, key in PARAMETERS.items():
        having = [node for node, settings in nodes.items() if name in names_of(type(settings))]
        default = getattr(nodes[having[0]], name)
        rows.append((code("~" + name), ", ".join(having), key.means, _plain(default)))
    return table(("parameter", "of", "what", "default"), rows)


def launch_files() -> str:
    """Every launch file with its arguments."""
    return "\n".join(_launch_file(path) for path in sorted(ROOT.glob("src/*/launch/*.launch")))


def paper() -> str:
    """Return what the paper says, where it is done, and the test that shows it."""
    with open(ROOT / "docs" / "data" / "paper.csv", newline="", encoding="utf-8") as file:
        lines = list(csv.DictReader(file))
    rows = [
        (
            *(each["section"], each["statement"], each["done"], code(_short(each["where"]))),
            *(code(_short(each["test"])), each["remark"]),
        )
        for each in lines
    ]
    return table(("section", "statement", "done", "where", "shown by", "remark"), rows)


def _short(path: str) -> str:
    """Return a path from its package on."""
    return re.sub(r"^src/(\w+)/(src/\1/)?", r"\1/", path)


def messages() -> str:
    """Every message, service and action with its fields."""
    files = sorted(path for each in ("msg", "srv", "action") for path in MESSAGES.glob(f"{each}/*"))
    return "\n".join(_message_file(path) for path in files)


def commands() -> str:
    """The help of every command."""
    parser = command_line()[0]
    (subparsers,) = (each for each in parser._actions if each.choices and not each.option_strings)
    parts = [_help("", parser)]
    parts += [_help(name, each) for name, each in sorted(dict(subparsers.choices or {}).items())]
    return "\n".join(parts)


PARTS: Dict[str, Callable[[], str]] = {
    "som": lambda: key_table(keys.SOM),
    "som_service": lambda: key_table(keys.SERVICE, Service),
    "som_value": lambda: key_table(keys.VALUE, Provision),
    "som_counts": lambda: key_table(keys.COUNTS, Checks),
    "som_deadline": lambda: key_table(keys.DEADLINE),
    "som_last_resort": lambda: key_table(keys.LAST_RESORT),
    "som_placement": lambda: key_table(keys.PLACEMENT),
    "som_host": lambda: key_table(keys.HOST),
    "ontology_sections": lambda: key_table(keys.ONTOLOGY),
    "ontology_property": lambda: key_table(keys.PROPERTY),
    "ontology_constant": lambda: key_table(keys.CONSTANT),
    "ontology_relation": lambda: key_table(keys.FUNCTION),
    "error_figures": lambda: key_table(keys.ERROR),
    **{
        each.__name__: each
        for each in (
            *(basics, som_checks, operators, functions, kinds, transitions, injected, parameters),
            *(launch_files, messages, commands, paper),
        )
    },
}
"""Every part by its name, as pages ask for it."""


def _plain(value: object) -> str:
    """A default as it would be written in a file; nothing where there is none."""
    if value is None or value == "" or isinstance(value, tuple) or dataclasses.is_dataclass(value):
        return ""
    if isinstance(value, bool):
        return code(str(value).lower())
    return code(f"{value:g}" if isinstance(value, float) else value)


def _limit(limit: Optional[Limit]) -> str:
    if limit is None:
        return "off"
    if limit is True:
        return "on"
    return "learned" if limit == LEARNED else code(f"{limit:g}")


def _launch_file(path: Path) -> str:
    package = path.parent.parent.name
    comment = re.search(r"<!--(.*?)-->", path.read_text("utf-8"), re.DOTALL)
    about = " ".join(comment.group(1).split()) if comment else ""
    rows = [
        (code(arg.get("name")), _text(arg.get("doc", "")), _given(arg.get("default")))
        for arg in ElementTree.parse(str(path)).getroot().findall("arg")
        if "value" not in arg.keys()
    ]
    shown = table(("argument", "what", "default"), rows)
    return f"### {path.name}\n\n`roslaunch {package} {path.name}`. {_text(about)}\n\n{shown}"


def _given(default: Optional[str]) -> str:
    return REQUIRED if default is None else code(default)


def _text(words: str) -> str:
    """Words that have no Markdown in them, as Markdown."""
    return re.sub(r"([*_<>\[\]`$\\])", r"\\\1", words)


def _message_file(path: Path) -> str:
    names = {"msg": ("",), "srv": ("Request", "Response"), "action": ("Goal", "Result", "Feedback")}
    lines = path.read_text("utf-8").split("\n---\n")
    parts = [f"### {path.stem}\n", f"`shsa_msgs/{path.stem}`. {_text(_about(path))}\n"]
    for title, part in zip(names[path.parent.name], lines):
        fields = list(_fields(part))
        if title:
            parts.append(f"**{title}**\n")
        shown = table(
            ("field", "type", "what"), [(code(n), code(t), _text(c)) for t, n, c in fields]
        )
        parts.append(shown if fields else "No fields.\n")
    constants = [(code(name.lower()), comment) for _, name, comment in _constants(path)]
    if constants:
        parts.append(table(("word", "what"), [(name, _text(what)) for name, what in constants]))
    return "\n".join(parts)


def _about(path: Path) -> str:
    """The comment at the head of a message file."""
    words = []
    for line in path.read_text("utf-8").splitlines():
        if not line.startswith("#"):
            break
        words.append(line.strip("# "))
    return " ".join(words)


def _fields(part: str) -> Iterable[Tuple[str, str, str]]:
    """Type, name and comment of each field."""
    for line in part.splitlines():
        definition, _, comment = line.partition("#")
        words = definition.split()
        if len(words) == 2 and "=" not in definition:
            yield words[0], words[1], comment.strip()


def _constants(path: Path) -> List[Tuple[str, str, str]]:
    """Type, name and comment of each constant: of a text, the comment is the line above."""
    found, above = [], ""
    for line in path.read_text("utf-8").splitlines():
        match = re.match(r"(\w+) (\w+) *= *([^#]*)(?:#(.*))?", line)
        if match:
            found.append((match.group(1), match.group(2), (match.group(4) or above).strip()))
        above = line.strip("# ") if line.startswith("#") else ""
    return found


def _help(name: str, parser: argparse.ArgumentParser) -> str:
    form: Any = parser.formatter_class
    parser.formatter_class = lambda prog: form(prog, width=WIDTH)
    title = f"shsa {name}".strip()
    return f"## {title}\n\n```text\n{parser.format_help().rstrip()}\n```\n"
