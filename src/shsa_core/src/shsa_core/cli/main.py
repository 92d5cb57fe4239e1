"""The command line `shsa COMMAND`. Each other module of this package is a command."""
import argparse
import importlib
import os
import pkgutil
import signal
import sys
from typing import Any, Dict, List, Optional, Tuple

import shsa_core.cli
from shsa_core import __version__
from shsa_core.cli._output import say
from shsa_core.errors import NoSubstitute, ShsaError

PLUGINS = {
    "inject": "shsa_injection.cli",
    "chaos": "shsa_injection.cli",
    "top": "shsa_view.cli",
}
"""Commands of packages that need not be installed, and where each is."""
DONE, NO, WRONG = 0, 1, 2  # exit statuses
INTERRUPTED, CLOSED_PIPE = 128 + signal.SIGINT, 128 + signal.SIGPIPE  # as the shell tells them


def main(arguments: Optional[List[str]] = None) -> int:
    """Run a command. Returns 0 if it is done, 1 if the answer is no, 2 if it was called wrongly."""
    parser, commands = command_line()
    if "_ARGCOMPLETE" in os.environ:  # the shell asks for completions
        import argcomplete

        argcomplete.autocomplete(parser)
    given = parser.parse_args(arguments)
    try:
        status: int = commands[given.command].run(given)
        sys.stdout.flush()
        return status
    except NoSubstitute as none:
        return _say(none, NO)
    except BrokenPipeError:  # whoever read our output has enough of it, as `head` does
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return CLOSED_PIPE
    except KeyboardInterrupt:
        return INTERRUPTED
    except (ShsaError, OSError) as error:
        return _say(error, WRONG)


def command_line() -> Tuple[argparse.ArgumentParser, Dict[str, Any]]:
    """The parser of all commands, and their modules by the commands' names."""
    parser = argparse.ArgumentParser(
        prog="shsa", description="Self-healing by structural adaptation, from the command line."
    )
    parser.add_argument("--version", action="version", version=f"shsa {__version__}")
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND")
    subparsers.required = True
    commands: Dict[str, Any] = {}
    for module in pkgutil.iter_modules(shsa_core.cli.__path__):
        if module.name != "main" and not module.name.startswith("_"):
            command: Any = importlib.import_module("shsa_core.cli." + module.name)
            command.add_parser(subparsers)
            commands[module.name.rstrip("_")] = command
    for name, package in PLUGINS.items():
        commands[name] = _plugin(name, package)
        commands[name].add_parser(subparsers)
    return parser, commands


class _NotInstalled:
    """Stands for a command whose package is not installed."""

    def __init__(self, name: str, package: str, why: str) -> None:
        self._name = name
        self._text = f"needs the package {package}, which is not installed ({why})"

    def add_parser(self, subparsers: Any) -> None:
        """Take any words: nobody here can tell whether they are right."""
        parser = subparsers.add_parser(self._name, prefix_chars="\0", add_help=False)
        parser.add_argument("words", nargs="*")

    def run(self, args: argparse.Namespace) -> int:
        """Raises ShsaError."""
        raise ShsaError(f"{self._name} {self._text}")


def _plugin(name: str, package: str) -> Any:
    """The module of a command in another package; where that cannot be loaded, what says so."""
    try:
        return importlib.import_module(f"{package}.{name}")
    except ImportError as error:
        return _NotInstalled(name, package.split(".")[0], str(error))


def _say(error: Exception, status: int) -> int:
    say(f"shsa: {error}", error=True)
    return status
