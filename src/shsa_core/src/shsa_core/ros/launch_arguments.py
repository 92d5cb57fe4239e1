"""Refuses arguments that a launch file does not take: roslaunch ignores them without a word.

roslaunch runs this as the command of a <param> while it reads shsa.launch, before any node starts.
"""
import os
import re
import sys
from typing import Dict, Iterator, List, Set, Tuple
from xml.etree import ElementTree

from rospkg import ResourceNotFound

from shsa_core.text import nearest

_ANY = "*"
"""Stands for the arguments of an included file whose path cannot be told."""
_PROGRAMS = ("roslaunch", "rostest")
_ARGUMENT = re.compile(r"([A-Za-z]\w*):=(.*)\Z", re.DOTALL)


def unknown(command: List[str]) -> List[Tuple[str, List[str]]]:
    """Return the arguments of a roslaunch command that none of its files takes, and what they take.

    Nothing where the command is another one, or where its files cannot be found.
    """
    names = [os.path.basename(word) for word in command[:2]]
    start = next((at for at, name in enumerate(names, 1) if name in _PROGRAMS), None)
    words = command[start:] if start else []
    given = {found[1]: found[2] for found in map(_ARGUMENT.match, words) if found}
    if not given:
        return []
    from roslib.packages import find_resource  # it takes longer than all else

    plain = [word for word in words if ":=" not in word and not word.startswith("-")]
    files = [word for word in plain if os.path.isfile(word)]
    for package, name in zip(plain, plain[1:]):
        try:
            files += [] if os.path.isfile(name) else find_resource(package, name)[:1]
        except ResourceNotFound:
            continue
    taken: Set[str] = set()
    for name in (name for file in files for name in _taken(file, given)):
        if taken.issuperset(given):
            return []  # no other file need be found, and read
        taken.add(name)
    if not files or _ANY in taken:
        return []
    return [(name, sorted(taken)) for name in given if name not in taken]


def _taken(file: str, given: Dict[str, str]) -> Iterator[str]:
    """Yield the arguments of a launch file, and of those that it passes all arguments on to."""
    root = ElementTree.parse(file).getroot()
    places = (*root.iterfind("arg"), *root.iterfind(".//group/arg"))
    arguments = {str(each.get("name")): each for each in places}
    yield from (name for name, each in arguments.items() if each.get("value") is None)
    values = {name: each.get("default", "") for name, each in arguments.items()}
    context = {"arg": {**values, **given}, "filename": file}
    for include in root.iter("include"):
        if include.get("pass_all_args") != "true":
            continue
        # Not for who passes nothing on: it takes 0.4 s.
        from roslaunch.substitution_args import ArgException, SubstitutionException, resolve_args

        own = {each.get("name") for each in include.iterfind("arg")}
        try:
            included = resolve_args(include.get("file", ""), context)
            yield from (name for name in _taken(included, given) if name not in own)
        except (ArgException, SubstitutionException, ResourceNotFound, OSError):
            yield _ANY


def main() -> None:
    """Exit with an error if the roslaunch that runs this has an unknown argument."""
    try:
        with open(f"/proc/{os.getppid()}/cmdline", encoding="utf-8", errors="replace") as file:
            command = file.read().split("\0")[:-1]
    except OSError:
        command = []  # of another user: nobody knows its arguments
    refused = unknown(command)
    for name, taken in refused:
        known = f"{nearest(name, taken) or '.'} There are {', '.join(taken)}"
        print(f"There is no argument {name}{known}", file=sys.stderr)
    print(" ".join(word for word in command if _ARGUMENT.match(word)))
    sys.exit(1 if refused else 0)
