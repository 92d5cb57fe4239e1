"""Targets of fuzzing: each takes bytes, and raises if something is wrong with its code.

A refusal by a ShsaError is right; anything else that is raised is a fault, and so is a hang, or
whatever the interpreter was made to do. A new target is a function here with @target, and a folder
of inputs in `corpus/`. `test_fuzz.py` runs them in every test, `tools/fuzz` as long as one likes.
"""
import functools
import json
import math
import pathlib
import sys
import tempfile
from typing import Callable, Dict, List, Tuple

ROOT = pathlib.Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT / "src" / "shsa_core" / "test" / "unit"))

import audit  # noqa: E402

from shsa_core import message_types  # noqa: E402
from shsa_core.analysis.check import function_errors  # noqa: E402
from shsa_learning.check import check_laws  # noqa: E402
from shsa_learning.incident_log import read_log  # noqa: E402
from shsa_core.codegen.checked_code import check_code  # noqa: E402
from shsa_core.codegen.program import compile_program  # noqa: E402
from shsa_core.errors import ModelError, ShsaError  # noqa: E402
from shsa_core.files.ontology_file import load_ontology  # noqa: E402
from shsa_core.files.parameters import read_settings  # noqa: E402
from shsa_core.files.som_file import load_som, merge_parameters, som_parameters  # noqa: E402
from shsa_core.model.names import Names  # noqa: E402
from shsa_core.healing.settings import Settings  # noqa: E402
from shsa_core.journal.machines import MACHINES, machine_kind  # noqa: E402
from shsa_learning.replay import Journal  # noqa: E402
from shsa_core.language.expression import parse_law  # noqa: E402
from shsa_learning.units.mismatches import check_units  # noqa: E402
from shsa_learning.units.unit import parse_unit  # noqa: E402
from shsa_core.model.field import parse_field  # noqa: E402
from shsa_core.model.som import Som  # noqa: E402
from shsa_core.ros.messages.fields import Decoder  # noqa: E402
from shsa_core.substitution import signals  # noqa: E402
from shsa_core.text import shown  # noqa: E402
from shsa_learning.explain import words as in_words  # noqa: E402
from shsa_learning.init.knowledge_base import read_knowledge_base  # noqa: E402
from shsa_learning.recordings.csv_files import read_csv  # noqa: E402
from shsa_rover.frame import Parser, encode  # noqa: E402

Target = Callable[[bytes], None]
CORPUS = ROOT / "test" / "corpus"
TARGETS: Dict[str, Target] = {}
FORBIDDEN = {"exec", "os.system", "os.exec", "os.fork", "subprocess.Popen", "socket.connect"}
"""Events of the interpreter that no reader may cause."""
_FOLDER = tempfile.TemporaryDirectory(prefix="shsa_fuzz_")
_FILE = pathlib.Path(_FOLDER.name) / "input"
_ODOMETRY = "nav_msgs/Odometry"

# Loaded now, so that whatever is loaded later is so by an input.
message_types.message_class(_ODOMETRY)
parse_unit("m/s")
for _each in MACHINES:
    machine_kind(_each)


def target(function: Target) -> Target:
    """Adds a target, by the name of its function."""

    def audited(data: bytes) -> None:
        with audit.recorded() as events:
            try:
                function(data)
            except ShsaError as error:
                assert all(line.isprintable() for line in str(error).split("\n")), "not printable"
        done = FORBIDDEN.intersection(events)
        assert not done, f"the interpreter was made to do {done}"

    TARGETS[function.__name__] = audited
    return audited


def corpus(name: str) -> List[bytes]:
    """Return the stored inputs of a target: good ones, and those that it once failed at."""
    return [path.read_bytes() for path in sorted((CORPUS / name).iterdir())]


@functools.lru_cache(maxsize=None)
def _known() -> Som:
    return load_som(str(CORPUS / "som" / "good"))[0]


def _written(data: bytes) -> str:
    _FILE.write_bytes(data)
    return str(_FILE)


def _text(data: bytes) -> str:
    return data.decode("utf-8", "surrogateescape")


@target
def ontology(data: bytes) -> None:
    """The text of an ontology: what is read is checked, and is its own text's law."""
    model, errors = load_ontology(_written(data))
    assert all(isinstance(each, ModelError) for each in errors)
    for function in model.functions:
        assert function.output in model.properties
        assert function.law is None or parse_law(function.law.text) == function.law
    list(check_units(model))
    list(function_errors(model))
    list(check_laws(model))


@target
def som(data: bytes) -> None:
    """The text of a SOM; what is valid says the same as parameters."""
    found, _ = load_som(_written(data))
    merged, errors = merge_parameters(found, som_parameters(found))
    assert not errors and merged == found


@target
def knowledge_base(data: bytes) -> None:
    """The text of a knowledge base of the predecessor library."""
    read_knowledge_base(_written(data))


@target
def parameters(data: bytes) -> None:
    """Read what somebody puts onto the parameter server, as JSON."""
    value = _json(data)
    known = _known()
    merged, _ = merge_parameters(known, value)
    assert set(merged.services) == set(known.services)
    for name, service in merged.services.items():
        old = known.services[name]
        assert (service.topic, service.type, service.node) == (old.topic, old.type, old.node)
        assert (service.policy, service.contain) == (old.policy, old.contain)
        assert service.last_resort.command == old.last_resort.command
    merge_parameters(Som(), value)
    read_settings(Settings, value, "/reconfigurator")


def code(data: bytes) -> None:
    """A substitute's code: what is accepted computes a number, or none."""
    text = _text(data)
    try:
        with audit.recorded() as events:
            check_code(text, 2, 1)
    except ShsaError:
        return
    finally:
        assert not FORBIDDEN.intersection(events)
    program = compile_program(text, 2, 1)
    for number, values in enumerate(((1.0, 2.0), (0.0, -1e308), (1e-308, 3.0), (math.nan, 1.0))):
        found = program.step(values, float(number))
        assert found is None or all(math.isfinite(each) for each in found)


TARGETS["code"] = code  # audited only as far as it is read: what is accepted is run


@target
def frames(data: bytes) -> None:
    """A serial line: every byte is accounted for, every frame is one."""
    for checked in (False, True):
        parser = Parser(checked)
        cut = len(data) // 2
        found = parser.feed(data[:cut]) + parser.feed(data[cut:])
        used = sum(len(encode(frame.channels, checked)) for frame in found)
        assert used + parser.counters.dropped_bytes + parser.pending_bytes == len(data)
        assert all(encode(frame.channels, checked) in data for frame in found)


@target
def names(data: bytes) -> None:
    """Names of nodes, fields and message types, and any text that is shown."""
    text = _text(data)
    assert shown(text).isprintable()
    mine = Names("/")
    if mine.avoid(text):
        assert text.isascii() and mine.fresh("x") != text
    readers: List[Callable[[str], object]] = [parse_field, message_types.message_class]
    for read in readers:
        try:
            read(text)
        except ShsaError:
            continue


@target
def header(data: bytes) -> None:
    """Read the header that a publisher sends as it connects, as JSON."""
    value = _json(data)
    if isinstance(value, dict) and all(isinstance(each, str) for each in value.values()):
        Decoder(_ODOMETRY, {"type": "", "md5sum": "", **value}, ["twist.twist.linear.x"])


@target
def message(data: bytes) -> None:
    """The bytes of a message."""
    kind = message_types.message_class(_ODOMETRY)
    fields = ["twist.twist.linear.x", "pose.covariance[35]", "yaw(pose.pose.orientation)"]
    values = Decoder(_ODOMETRY, {"type": _ODOMETRY, "md5sum": kind._md5sum}, fields).values(data)
    assert len(values) == len(fields)


@target
def journal(data: bytes) -> None:
    """A journal: what is read of it are events of the machine that it names."""
    for _ in Journal(_written(data)).entries():
        pass


@target
def incident_log(data: bytes) -> None:
    """The incident log: each line is an incident that can be told, or is noted."""
    incidents, notes = read_log(_written(data))
    assert len(incidents) + len(notes) <= data.count(b"\n") + 1
    for each in incidents:
        assert in_words.title(each) and in_words.summary(each) and len(in_words.steps(each)) == 8


@target
def wired(data: bytes) -> None:
    """The signals of a substitute, as they come to it in its environment."""
    for each in signals.decode(_text(data)):
        for signal in each:
            assert signal.period is None or 0.0 < signal.period < math.inf


@target
def csv_file(data: bytes) -> None:
    """A recording as a CSV file."""
    series, _ = read_csv(_written(data))
    assert all(math.isfinite(each.begin) and len(each) for each in series)


def _json(data: bytes) -> object:
    try:
        return json.loads(_text(data))
    except (ValueError, RecursionError):
        return data


def words(name: str) -> Tuple[bytes, ...]:
    """Parts of the stored inputs of a target, to be put together anew."""
    found = {part for each in corpus(name) for part in each.replace(b"\n", b" \n").split(b" ")}
    return tuple(sorted(found))
