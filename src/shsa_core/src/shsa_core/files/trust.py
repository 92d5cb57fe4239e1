"""Refuses files that others can write: they say which program is run."""
import grp
import os
import pwd
import stat
from typing import Any, Callable, Iterator, List

from shsa_core.errors import ModelError
from shsa_core.model.som import Som

MAX_LINKS = 40


def refuse_others_commands(som: Som, path: str) -> None:
    """Raise ModelError if a SOM starts programs, and others can write its file."""
    names = [each.name for each in som if each.last_resort.command or each.policy.restarts]
    why = written_by_others(path) if names else ""
    if why:
        raise ModelError(path, f"it starts programs ({', '.join(names)}), and {why}")


def written_by_others(path: str) -> str:
    """Return why somebody but us and root can change or replace a file; empty: nobody can."""
    for place in _places(os.path.abspath(path)):
        try:
            why = _reason(place)
        except OSError as error:
            return f"{place} cannot be looked at: {error.strerror}"
        if why:
            return why
    return ""


def _places(path: str) -> Iterator[str]:
    """Return the file, and every folder and link on the way to it."""
    here, rest, links = "/", path.split("/"), 0
    yield here
    while rest:
        part = rest.pop(0)
        if part in ("", "."):
            continue
        if part == "..":
            here = os.path.dirname(here)
            continue
        here = os.path.join(here, part)
        yield here
        if os.path.islink(here) and links < MAX_LINKS:
            links += 1
            target = os.readlink(here)
            here = "/" if target.startswith("/") else os.path.dirname(here)
            rest = target.split("/") + rest


def _reason(place: str) -> str:
    status = os.lstat(place)
    if status.st_uid not in (0, os.geteuid()):
        owner = _name(pwd.getpwuid, status.st_uid)
        return f"{place} belongs to {owner}, who is neither root nor who runs this"
    mode = status.st_mode
    if stat.S_ISLNK(mode) or (stat.S_ISDIR(mode) and mode & stat.S_ISVTX):
        return ""  # in a folder like /tmp nobody can replace what is another's
    if mode & stat.S_IWOTH:
        return f"everybody can write {place}: chmod o-w {place}"
    if mode & stat.S_IWGRP and not _alone(status.st_gid, status.st_uid):
        return (
            f"the group {_name(grp.getgrgid, status.st_gid)} can write {place}: chmod g-w {place}"
        )
    return ""


def _alone(group: int, user: int) -> bool:
    # as is a group of the user's own
    try:
        members: List[int] = [pwd.getpwnam(each).pw_uid for each in grp.getgrgid(group).gr_mem]
    except KeyError:
        return False
    members += [each.pw_uid for each in pwd.getpwall() if each.pw_gid == group]
    return set(members) <= {user, 0, os.geteuid()}


def _name(found: Callable[[int], Any], number: int) -> str:
    try:
        return str(found(number)[0])
    except KeyError:
        return str(number)
