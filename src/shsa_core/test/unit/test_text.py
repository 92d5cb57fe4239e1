"""Text from outside reaches terminals, logs, pages and messages on one printable line."""
import json
import logging
import pathlib
from types import SimpleNamespace
from typing import Any, List

import pytest
from hypothesis import given, settings, strategies as st

from shsa_core.analysis.registrations import NOTHING
from shsa_core.cli._common import say
from shsa_core.cli.main import main
from shsa_core.errors import ModelError, ModelErrors, ShsaError
from shsa_core.healing.incident import Incident
from shsa_core.model.kinds import Kind
from shsa_core.model.service import Provision, Service
from shsa_core.text import LONGEST, LONGEST_LINE, shown

EVIL = "\x1b[2J\x1b]0;owned\x07\r\n\u202e\x00\x9b31m"
"""Clears the screen, renames the window, begins a line, turns the direction of the writing."""


@pytest.mark.parametrize(
    "text, printed",
    [
        ("plain, with blanks", "plain, with blanks"),
        ("Ω und ß", "Ω und ß"),
        ("a\x1b[31mb", r"a\x1b[31mb"),
        ("a\nb\tc\r", r"a\nb\tc\r"),
        ("\x9b\u202e\u2028\ufeff", r"\x9b\u202e\u2028\ufeff"),
        ("\udc80", r"\udc80"),
        ("\x00", r"\x00"),
        (7, "7"),
        ("", ""),
    ],
)
def test_what_is_not_printable_is_shown_as_its_number(text: object, printed: str) -> None:
    assert shown(text) == printed


@settings(derandomize=True, deadline=None)
@given(st.text(), st.integers(0, 30))
def test_it_is_printable_bounded_and_stays_as_it_is(text: str, most: int) -> None:
    once = shown(text, most)
    assert once.isprintable() and len(once) <= 10 * most + 3
    assert shown(once, len(once)) == once


def test_what_is_too_long_is_cut() -> None:
    assert shown("a" * LONGEST) == "a" * LONGEST
    assert shown("a" * 10**7) == "a" * LONGEST + "..."


def test_every_error_is_on_one_printable_line() -> None:
    assert shown(EVIL).isprintable()
    for error in (ShsaError(EVIL), ModelError(EVIL, EVIL)):
        assert str(error).isprintable() and "owned" in str(error)
    assert len(str(ShsaError("x" * 10**6))) < LONGEST_LINE + 10
    several = ModelErrors([ModelError("a:1", EVIL), ModelError("b:2", EVIL)])
    lines = str(several).split("\n")
    assert len(lines) == 2 and all(line.isprintable() for line in lines)


def hostile_lines() -> List[str]:
    """An ontology and a SOM, each text in them as hostile as the file lets it be."""
    evil = json.dumps(EVIL)  # YAML reads it as JSON does
    return [
        f"properties:\n  a: {{unit: {evil}, symbol: {evil}, {evil}: 1}}\n  {evil}:\n  b:\n"
        "constants:\n  c: {value: 1}\n"
        f"relations:\n  r: {{b: {{not_executable: {evil}, inputs: [a]}}, {evil}: a}}\n"
        f"  {evil}: {{a: {evil}}}\n{evil}: 1\n",
        "services:\n  s:\n    topic: /a\n    type: std_msgs/Float64\n    node: /n\n    period: 1\n"
        f"    needed: true\n    provides: {{a: {{field: data}}, {evil}: {{field: {evil}}}}}\n"
        f"  {evil}: {{topic: {evil}}}\n  t: {{{evil}: 1, node: {evil}, type: {evil}}}\n",
    ]


@pytest.fixture
def hostile(tmp_path: pathlib.Path) -> List[str]:
    paths = [tmp_path / f"{name}{EVIL[:3]}.yaml" for name in ("ontology", "som")]
    for path, text in zip(paths, hostile_lines()):
        path.write_text(text)
    return [str(path) for path in paths]


@pytest.mark.parametrize(
    "command",
    [
        "check {0} --som {1}",
        "check {0}",
        "find a --ontology {0} --som {1}",
        "replay {0}",
    ],
)
def test_no_command_prints_what_a_file_wants_to_do_to_the_terminal(
    hostile: List[str], command: str, capsys: Any
) -> None:
    assert main([word.format(*hostile) for word in command.split()]) in (1, 2)
    printed = "".join(capsys.readouterr())
    assert "owned" in printed or "replay" in command
    assert all(line.isprintable() for line in printed.split("\n"))


def test_what_is_valid_and_hostile_is_printed_plainly(tmp_path: pathlib.Path, capsys: Any) -> None:
    """A text that stands for a function may be any: no check refuses it."""
    ontology, som = tmp_path / "o.yaml", tmp_path / "s.yaml"
    evil = json.dumps(EVIL)
    ontology.write_text(
        f"properties:\n  a: {{symbol: {evil}}}\n  b:\n"
        f"relations:\n  r: {{a: {{not_executable: {evil}, inputs: [b]}}}}\n"
    )
    services = "services:\n"
    for name in "ab":
        services += f"  {name}: {{topic: /{name}, type: std_msgs/Float64, node: /n{name}, "
        services += f"period: 1, needed: true, provides: {{{name}: {{field: data}}}}}}\n"
    som.write_text(services)
    files = ["--ontology", str(ontology), "--som", str(som)]
    main(["check", str(ontology), "--som", str(som)])
    main(["find", "a", "--explain", *files])
    main(["check", str(ontology), "--som", str(som), "--json"])
    printed = "".join(capsys.readouterr())
    assert "owned" in printed
    assert all(line.isprintable() for line in printed.replace("\t", " ").split("\n"))


def test_lines_are_printed_as_lines(capsys: Any) -> None:
    say("a\nb\x1b")
    say("c\nd", error=True)
    assert tuple(capsys.readouterr()) == ("a\nb\\x1b\n", "c\nd\n")


def test_diagnostics_are_printable() -> None:
    diagnostics = pytest.importorskip("shsa_core.ros.diagnostics")
    service = Service("s", "/a", "std_msgs/Float64", "/n", 1.0, (Provision("a", "data"),))
    incident = Incident(1, "s", "/a", ("a",), EVIL, Kind.OTHER, EVIL * 1000, 0.0)
    told = SimpleNamespace(answers=True, hung=[EVIL], known=NOTHING, kept_at=0.0)
    row, *_ = diagnostics.healing_rows(([service], {"s": incident}, told, (), {}, False))
    texts = [row.message, *(value.value for value in row.values)]
    assert any("owned" in text for text in texts)
    assert all(text.isprintable() and len(text) < 20_000 for text in texts)


def test_a_node_logs_on_one_printable_line() -> None:
    log_queue = pytest.importorskip("shsa_core.ros.rospy_patches.log_queue")
    heard: List[logging.LogRecord] = []

    class Hearing(logging.Handler):
        def emit(self, record: logging.LogRecord) -> None:
            heard.append(record)

    loggers = [logging.getLogger(), logging.getLogger("rosout")]
    before = [logger.handlers for logger in loggers]
    for logger in loggers:
        logger.handlers = [Hearing()]
    try:
        log = log_queue.LogQueue()
        logging.getLogger("rosout").error("%s fails: %d%%", EVIL, 7)
        logging.getLogger("rospy.topics").error("x" * 10**6)
        log.close()
    finally:
        for logger, handlers in zip(loggers, before):
            logger.handlers = handlers
    texts = [record.getMessage() for record in heard]
    assert len(texts) >= 3 and texts[0].endswith("fails: 7%") and "owned" in texts[0]
    assert all(text.isprintable() and len(text) < LONGEST_LINE + 10 for text in texts)
