"""Each warning and error that healing can log has an entry in the page on troubleshooting."""
import ast
import itertools
import re
from pathlib import Path
from typing import Dict, Iterator, List, Optional

import pytest
from listings import ROOT, seen

from shsa_core.healing.kill import Outcome

HEALING = [ROOT / "src" / name / "src" / name for name in ("shsa_core", "shsa_gate")]
STEERING = ROOT / "src" / "shsa_rover" / "src" / "shsa_rover" / "ros" / "velocity_commands.py"
"""A rover that is not stopped is no matter of healing, but people look here."""
PAGE = ROOT / "docs" / "howto" / "troubleshooting.md"
LOGGED = re.compile(r"log(warn|err|fatal)(_|$)|^_?warn$")
CALLED = re.compile(r"log(|_?warn|_?err|_?fatal)\w*\(|warn\(", re.IGNORECASE)
"""Is in each module that logs such a text."""
LEVELS = ("WARN", "WARNING", "ERROR")
ENTRIES = re.findall(r"^\| `([^`]+)` \|", PAGE.read_text("utf-8"), re.MULTILINE)


def logged(path: Path) -> Iterator[str]:
    """Yield the texts of a module's warnings and errors, with `...` for what varies."""
    code = path.read_text("utf-8")
    if not CALLED.search(code):
        return  # all tests wait until this file is read, in each process that runs some
    for scope in ast.walk(ast.parse(code)):
        if isinstance(scope, ast.FunctionDef):
            calls = [node for node in ast.walk(scope) if isinstance(node, ast.Call)]
            found = [text for text in map(said, calls) if text is not None]
            named = assigned(scope) if found else {}
            for text in found:
                yield from texts(text, named)


def said(call: ast.Call) -> Optional[ast.expr]:
    """Return the text that a call logs as a warning or an error; None: it does not."""
    name = getattr(call.func, "attr", getattr(call.func, "id", ""))
    if name == "Log":
        return call.args[1] if getattr(call.args[0], "attr", "") in LEVELS else None
    if (
        name == "log" and getattr(call.args[-1], "attr", "") != "INFO"
    ):  # a service's: its topic first
        return ast.JoinedStr([ast.Constant("...: ", None), call.args[0]])
    if not LOGGED.search(name) or not call.args:
        return None
    return call.args["throttle" in name]


def assigned(scope: ast.AST) -> Dict[str, List[ast.expr]]:
    """Return what is assigned to each name in a function."""
    found: Dict[str, List[ast.expr]] = {}
    for node in ast.walk(scope):
        if isinstance(node, (ast.Assign, ast.AugAssign)):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            for target in targets:
                if isinstance(target, ast.Name):
                    found.setdefault(target.id, []).append(node.value)
    return found


def texts(node: ast.expr, named: Dict[str, List[ast.expr]]) -> Iterator[str]:
    """Yield what an expression may read: a literal, or what its name stands for."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        yield re.sub(r"%[srd]|%\.?\d*[fg]", "...", node.value)
    elif isinstance(node, ast.JoinedStr):
        parts = [list(texts(part, named)) or ["..."] for part in node.values]
        yield from map("".join, itertools.product(*parts))
    elif isinstance(node, ast.FormattedValue):
        yield from texts(node.value, named) if isinstance(node.value, ast.Name) else ()
    elif isinstance(node, ast.IfExp):
        yield from texts(node.body, named)
        yield from texts(node.orelse, named)
    elif isinstance(node, ast.Name):
        for value in named.get(node.id, []):
            yield from texts(value, {})


KILLS = [f"...: ... {each}: ..." for each in (Outcome.UNREACHED, Outcome.UNSURE, Outcome.ANOTHER)]
SAYING = [STEERING, *(path for each in HEALING for path in each.rglob("*.py"))]
TEXTS = {text for path in SAYING for text in logged(path)}
FOUND = sorted(text for text in (*TEXTS, *KILLS) if re.search("[a-z]{3}", text))


@pytest.mark.parametrize("text", FOUND)
def test_a_log_line_has_an_entry(text: str) -> None:
    assert [entry for entry in ENTRIES if seen(entry, text)]


@pytest.mark.parametrize("entry", ENTRIES)
def test_an_entry_is_of_a_log_line(entry: str) -> None:
    assert [text for text in FOUND if seen(entry, text)]
