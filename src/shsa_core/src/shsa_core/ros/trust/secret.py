"""The secret by which healing knows its own: 32 random bytes that only its user can read."""
import os
import secrets
import stat
from contextlib import suppress

import rospkg

from shsa_core.errors import ShsaError

VARIABLE = "SHSA_SECRET"
"""The environment variable that names the file, for the processes that healing starts."""
LENGTH_B = 32


def default_path() -> str:
    """Return the file that counts where no other is named."""
    return os.path.join(rospkg.get_ros_home(), "shsa", "secret")


def obtain(path: str) -> bytes:
    """Return the secret in a file, which is made if it is not there.

    Several may do so at once: one of them makes it, all read it. Raises ShsaError as `read` does.
    """
    try:
        if not os.path.lexists(path):
            _make(path)
    except OSError as error:
        raise ShsaError(f"the secret {path} cannot be made: {error.strerror}") from error
    return read(path)


def read(path: str) -> bytes:
    """Return the secret in a file. Raises ShsaError if others could know it, or replace it."""
    try:
        folder = os.stat(os.path.dirname(path) or ".")
        # Without O_NONBLOCK a fifo would hold us up.
        descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    except OSError as error:
        raise ShsaError(f"the secret {path} cannot be read: {error.strerror}") from error
    try:
        _check(path, os.fstat(descriptor), folder)
        secret = os.read(descriptor, LENGTH_B + 1)
    finally:
        os.close(descriptor)
    if len(secret) != LENGTH_B:
        raise _refused(path, f"it has not {LENGTH_B} bytes", f"{LENGTH_B} random bytes")
    return secret


def _check(path: str, status: os.stat_result, folder: os.stat_result) -> None:
    user = os.geteuid()
    mode = stat.S_IMODE(status.st_mode)
    if not stat.S_ISREG(status.st_mode):
        raise _refused(path, "it is not a file", "a regular file")
    if status.st_uid != user:
        raise _refused(path, f"it belongs to user {status.st_uid}", f"a file of user {user}, ours")
    if mode & 0o077:
        raise _refused(path, f"others have rights on it: its mode is {mode:04o}", "0600")
    mode = stat.S_IMODE(folder.st_mode)
    if folder.st_uid not in (user, 0) or mode & 0o022:
        whose = f"its folder is of user {folder.st_uid} and has the mode {mode:04o}"
        raise _refused(path, whose, f"a folder that only user {user} or root can write, as 0700")


def _refused(path: str, wrong: str, allowed: str) -> ShsaError:
    return ShsaError(f"the secret {path} is refused: {wrong}; allowed is {allowed}")


def _make(path: str) -> None:
    """Make the file, whole at once: it is never seen in part."""
    folder = os.path.dirname(path) or "."
    os.makedirs(folder, 0o700, exist_ok=True)
    part = f"{path}.{secrets.token_hex(8)}"
    flags = os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW | os.O_CLOEXEC
    try:
        with open(os.open(part, flags, 0o600), "wb") as file:
            file.write(secrets.token_bytes(LENGTH_B))
            file.flush()
            os.fsync(file.fileno())
        with suppress(FileExistsError):  # another one was faster
            os.link(part, path)
    finally:
        if os.path.lexists(part):
            os.unlink(part)
