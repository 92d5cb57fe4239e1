"""The command line: `rosrun shsa_core shsa COMMAND`. Each other module of this package is a command."""
import argparse
import importlib
import pkgutil
import sys
from typing import List, Optional

import shsa_core.cli
from shsa_core.errors import NoSubstitute, ShsaError

DONE, NO, WRONG = 0, 1, 2  # exit statuses


def main(arguments: Optional[List[str]] = None) -> int:
    """Runs one command. Returns 0 if it is done, 1 if the answer is no, 2 if it was called wrongly."""
    parser = argparse.ArgumentParser(
        prog="shsa", description="Self-healing by structural adaptation, from the command line."
    )
    subparsers = parser.add_subparsers(dest="command", metavar="COMMAND")
    subparsers.required = True
    commands = {}
    for module in pkgutil.iter_modules(shsa_core.cli.__path__):
        if module.name != "main" and not module.name.startswith("_"):
            command = importlib.import_module("shsa_core.cli." + module.name)
            command.add_parser(subparsers)  # type: ignore
            commands[module.name.rstrip("_")] = command
    given = parser.parse_args(arguments)
    try:
        return commands[given.command].run(given)  # type: ignore
    except NoSubstitute as none:
        print(f"shsa: {none}", file=sys.stderr)
        return NO
    except (ShsaError, OSError) as error:
        print(f"shsa: {error}", file=sys.stderr)
        return WRONG
