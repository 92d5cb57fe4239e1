"""Refuses arguments that a launch file does not take: roslaunch ignores them without a word.

roslaunch runs this as the command of a <param> while it reads shsa.launch, before any node starts.
"""
import glob
import os
import re
import subprocess
import sys
from subprocess import DEVNULL, PIPE
from typing import Dict, Iterator, List, Tuple
from xml.etree import ElementTree

from shsa_core.text import nearest

_ANY = "*"
"""Stands for the arguments of an included file whose path cannot be told."""
_PROGRAMS = ("roslaunch", "rostest")
_ARGUMENT = re.compile(r"([A-Za-z]\w*):=(.*)\Z", re.DOTALL)
_FOUND = re.compile(r"find\W+(\w+)\W.*?([\w.-]+)\Z", re.DOTALL)


def unknown(command: List[str]) -> List[Tuple[str, List[str]]]:
    """Return the arguments of a roslaunch command that none of its files takes, and what they take.

    Nothing where the command is another one, or where its files cannot be found.
    """
    names = [os.path.basename(word) for word in command[:2]]
    start = next((at for at, name in enumerate(names, 1) if name in _PROGRAMS), None)
    words = command[start:] if start else []
    given = {found[1]: found[2] for found in map(_ARGUMENT.match, words) if found}
    plain = [word for word in words if ":=" not in word and not word.startswith("-")]
    files = [word for word in plain if os.path.isfile(word)]
    for package, name in zip(plain, plain[1:]):
        files += [] if os.path.isfile(name) else _resource(package, name)
    taken = sorted({name for file in files for name in _taken(file, given)})
    if not files or _ANY in taken:
        return []
    return [(name, taken) for name in given if name not in taken]


def _taken(file: str, given: Dict[str, str]) -> Iterator[str]:
    """Yield the arguments of a launch file, and of those that it passes all arguments on to."""
    root = ElementTree.parse(file).getroot()
    places = (*root.iterfind("arg"), *root.iterfind(".//group/arg"))
    arguments = {str(each.get("name")): each for each in places}
    yield from (name for name, each in arguments.items() if each.get("value") is None)
    for include in root.iter("include"):
        if include.get("pass_all_args") != "true":
            continue
        path = include.get("file", "")
        for name, each in arguments.items():
            path = path.replace(f"$(arg {name})", given.get(name, each.get("default", "")))
        own = {each.get("name") for each in include.iterfind("arg")}
        path = path.replace("$(dirname)", os.path.dirname(file)).rstrip("')")
        found = _FOUND.search(path)
        if found is None and not os.path.isfile(path):
            yield _ANY
        for each in _resource(*found.groups()) if found else filter(os.path.isfile, [path]):
            yield from (name for name in _taken(each, given) if name not in own)


def _resource(package: str, name: str) -> List[str]:
    find = subprocess.run(["rospack", "find", package], stdout=PIPE, stderr=DEVNULL, check=False)
    folder = find.stdout.decode().strip()
    return glob.glob(f"{folder}/**/{name}", recursive=True)[:1] if folder else []


def main() -> None:
    """Exit with an error if the roslaunch that runs this has an unknown argument."""
    try:
        with open(f"/proc/{os.getppid()}/cmdline", encoding="utf-8", errors="replace") as file:
            command = file.read().split("\0")[:-1]
    except OSError:
        command = []  # of another user: nobody knows its arguments
    refused = unknown(command)
    for name, taken in refused:
        known = f"{', '.join(taken)}{nearest(name, taken)}"
        print(f"There is no argument {name}; there are {known}", file=sys.stderr)
    print(" ".join(word for word in command if _ARGUMENT.match(word)))
    sys.exit(1 if refused else 0)
