"""Files opened as nothing else: no pipe that keeps one waiting, no device, and no other's file.

And who else can write a file, as it may say which program is run.
"""
import grp
import os
import pwd
import stat
from typing import Any, BinaryIO, Callable, Dict, Iterator, List

from shsa_core.errors import ModelError

MAX_BYTES = 100_000_000
MAX_LINKS = 40
_OTHERS: Dict[int, str] = {
    stat.S_IFIFO: "it is a pipe, and no file",
    stat.S_IFSOCK: "it is a socket, and no file",
    stat.S_IFCHR: "it is a device, and no file",
    stat.S_IFBLK: "it is a device, and no file",
    stat.S_IFDIR: "Is a directory",
}


def open_to_read(path: str) -> BinaryIO:
    """Return a file, opened; it never waits. Raises ModelError if it is none, or cannot be read."""
    try:
        _refuse_others(path, os.stat(path))  # before: opening some devices does something
        flags = os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
        file = open(os.open(path, flags), "rb")
    except (OSError, ValueError) as error:
        raise _unreadable(path, error) from error
    try:
        _refuse_others(path, os.fstat(file.fileno()))
    except ModelError:
        file.close()
        raise
    return file


def read_text(path: str, most: int = MAX_BYTES) -> str:
    """Return the text of a file of UTF-8, of `most` bytes. Raises ModelError with file and line."""
    with open_to_read(path) as file:
        try:
            raw = file.read(most + 1) if os.fstat(file.fileno()).st_size <= most else b""
        except OSError as error:
            raise _unreadable(path, error) from error
        if len(raw) > most or os.fstat(file.fileno()).st_size > most:
            raise ModelError(path, f"is larger than {most} bytes")
    try:
        text = raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ModelError(_line(path, raw, error.start), "is not UTF-8 text") from error
    if "\0" in text:
        raise ModelError(_line(path, raw, raw.index(b"\0")), "holds a zero byte; it is no text")
    return text


def open_to_append(path: str) -> int:
    """Return the descriptor of a file of ours alone, to write at its end. Raises OSError."""
    flags = os.O_WRONLY | os.O_APPEND | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY
    descriptor = os.open(path, flags | os.O_CLOEXEC, 0o600)
    try:
        if _ours(descriptor).st_nlink != 1:
            raise OSError("it has another name as well")
    except OSError:
        os.close(descriptor)
        raise
    return descriptor


def read_own(path: str, most: int) -> bytes:
    """Return what is in a file of ours that is closed to others; it never waits. Raises OSError."""
    flags = os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY | os.O_CLOEXEC
    with open(os.open(path, flags), "rb") as file:
        if _ours(file.fileno()).st_mode & 0o077:
            raise OSError("others can read or write it")
        data = file.read(most + 1)
    if len(data) > most:
        raise OSError(f"it is larger than {most} bytes")
    return data


def _ours(descriptor: int) -> os.stat_result:
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        raise OSError("it is no file")
    if status.st_uid != os.geteuid():
        raise OSError("it is the file of another user")
    return status


def _refuse_others(path: str, status: os.stat_result) -> None:
    kind = stat.S_IFMT(status.st_mode)
    if kind != stat.S_IFREG:
        raise ModelError(path, f"cannot be read: {_OTHERS.get(kind, 'it is no file')}")


def _unreadable(path: str, error: Exception) -> ModelError:
    why = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
    return ModelError(path, f"cannot be read: {why}")


def _line(path: str, raw: bytes, place: int) -> str:
    line = raw.count(b"\n", 0, place) + 1
    return f"{path}:{line}"


def written_by_others(path: str) -> str:
    """Return why somebody but us and root can change or replace a file; empty: nobody can."""
    for place in _places(path if path.startswith("/") else os.path.join(os.getcwd(), path)):
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
