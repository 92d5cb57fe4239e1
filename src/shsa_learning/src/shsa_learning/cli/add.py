"""`shsa add`: services that the running system gets, beside those of its SOM file."""
import argparse
import os
from typing import Any, Dict, List

from ruamel.yaml.comments import CommentedMap

from shsa_core import message_types
from shsa_core.cli._common import say
from shsa_core.errors import ModelError
from shsa_core.files.som_file import added_path, read_som
from shsa_learning.cli._namespace import add_namespace
from shsa_learning.check import check_files
from shsa_learning.saving import dump, load
from shsa_learning.type_check import available


def add_parser(subparsers: Any) -> None:
    """Add the command."""
    parser = subparsers.add_parser(
        "add",
        help="add services to a running system, change and remove them",
        description="Checks the services of a file as those of the SOM, keeps them in a file "
        "beside it (S.added.yaml), and has healing read both. A service that was added before is "
        "changed. The SOM itself is never written. Exit status 1 if they are not valid.",
    )
    parser.add_argument("services", metavar="FILE", nargs="?", help="a SOM of these services alone")
    parser.add_argument("--som", metavar="S", required=True, help="the SOM of the running system")
    parser.add_argument("--ontology", metavar="O", required=True, help="its ontology")
    parser.add_argument(
        "--remove",
        metavar="SERVICE",
        action="append",
        default=[],
        help="take away one that was added; may be given several times",
    )
    add_namespace(parser)


def run(args: argparse.Namespace) -> int:
    """Write the file beside the SOM, and have it read. Returns 0, or 1 if it is not taken."""
    if args.services is None and not args.remove:
        raise ModelError("add", "name a FILE of services, or one to --remove")
    path = added_path(args.som)
    before = load(path) if os.path.lexists(path) else {}
    services: Dict[str, Any] = dict(before.get("services") or {})
    for name in args.remove:
        if services.pop(name, None) is None:
            raise ModelError(name, f"is no service of {path}")
    if args.services is not None:
        read_som(args.services, args.namespace)
        services.update(load(args.services)["services"])
    _keep(services, path)
    errors = _errors(args)
    if errors:
        _keep(before.get("services") or {}, path)
        say("\n".join(errors))
        return 1
    say(f"{path}: {', '.join(services) or 'nothing is added any more'}")
    say("healing reads it within a second or two, where it runs")
    return 0


def _keep(services: Dict[str, Any], path: str) -> None:
    if services:
        dump(CommentedMap(services=services), path)
    elif os.path.lexists(path):
        os.unlink(path)


def _errors(args: argparse.Namespace) -> List[str]:
    types = message_types if available() else None
    found = check_files(args.ontology, args.som, types, args.namespace)
    return [str(each) for each in found if each.level == "error"]
