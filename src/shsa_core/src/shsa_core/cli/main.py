"""The command line `shsa COMMAND`.

Each package `shsa_*` may bring commands: the modules of its `cli`, but for this one and those that
begin with an underscore. A command has `add_parser(subparsers)` and `run(args)`, which returns the
exit status.
"""
import argparse
import importlib
import importlib.util
import os
import pkgutil
import signal
import sys
from typing import Any, Dict, List, Optional, Tuple

from shsa_core import __version__
from shsa_core.cli._common import say
from shsa_core.errors import NoSubstitute, ShsaError

_LEARNING = (
    *("accept", "add", "backtest", "check", "doctor", "explain", "find"),
    *("import", "init", "learn", "maintenance", "plot", "replay", "report"),
)
ELSEWHERE = {
    **dict.fromkeys(_LEARNING, "shsa_learning"),
    **dict.fromkeys(("chaos", "inject"), "shsa_injection"),
    "top": "shsa_view",
}
"""The packages of commands that need not be installed: for those who look for one."""
DONE, NO, WRONG = 0, 1, 2  # exit statuses
INTERRUPTED, CLOSED_PIPE = 128 + signal.SIGINT, 128 + signal.SIGPIPE  # as the shell tells them


def main(arguments: Optional[List[str]] = None) -> int:
    """Run a command. Returns 0 if it is done, 1 if the answer is no, 2 if it was called wrongly."""
    words = sys.argv[1:] if arguments is None else arguments
    try:
        parser, commands, missing = command_line(words[0] if words else "")
        if "_ARGCOMPLETE" in os.environ:  # the shell asks for completions
            import argcomplete

            argcomplete.autocomplete(parser)
        if words and words[0] in missing:
            return _fail(f"{words[0]} needs {missing[words[0]]}", WRONG)
        given = parser.parse_args(words)
        status: int = commands[given.command].run(given)
        sys.stdout.flush()
        return status
    except NoSubstitute as none:
        return _fail(none, NO)
    except BrokenPipeError:  # whoever read our output has enough of it, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CLOSED_PIPE
    except KeyboardInterrupt:
        return INTERRUPTED
    except (ShsaError, OSError) as error:
        return _fail(error, WRONG)


def command_line(only: str = "") -> Tuple[argparse.ArgumentParser, Dict[str, Any], Dict[str, str]]:
    """Return parser, commands by name, and the needs of missing ones; load `only` if it is one."""
    parser = argparse.ArgumentParser(
        prog="shsa", description="Self-healing by structural adaptation, from the command line."
    )
    parser.add_argument("--version", action="version", version=f"shsa {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND")
    subparsers.required = True
    commands: Dict[str, Any] = {}
    missing = {name: f"the package {package}" for name, package in ELSEWHERE.items()}
    modules = _modules()
    for name, module in [(only, modules[only])] if only in modules else sorted(modules.items()):
        try:
            command: Any = importlib.import_module(module)
        except ImportError as error:
            missing[name] = f"what its package lacks: {error}"
            continue
        command.add_parser(subparsers)
        commands[name] = command
        missing.pop(name, None)
    return parser, commands, missing


def _modules() -> Dict[str, str]:
    found = {}
    for package in {each.name for each in pkgutil.iter_modules() if each.name.startswith("shsa_")}:
        spec = importlib.util.find_spec(f"{package}.cli")
        for module in pkgutil.iter_modules(spec.submodule_search_locations if spec else []):
            if module.name != "main" and not module.name.startswith("_"):
                found[module.name.rstrip("_")] = f"{package}.cli.{module.name}"
    return found


def _fail(error: Any, status: int) -> int:
    file = getattr(error, "filename", None)  # of an OSError
    say(f"shsa: {file}: {error.strerror}" if file else f"shsa: {error}", error=True)
    return status
