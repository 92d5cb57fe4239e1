"""The secret by which healing knows its own: 32 random bytes that only its user can read."""
import os
import secrets
import stat
from contextlib import suppress

import rospkg

from shsa_core.errors import ShsaError
from shsa_core.files.regular import read_own

VARIABLE = "SHSA_SECRET"
"""The environment variable that names the file, for the processes that healing starts."""
LENGTH_B = 32


def default_path() -> str:
    """Return the file that counts where no other is named."""
    return os.path.join(rospkg.get_ros_home(), "shsa", "secret")


def obtain(path: str) -> bytes:
    """Return the secret in a file, which is made if it is not there. Raises ShsaError."""
    try:
        if not os.path.lexists(path):
            _make(path)
    except OSError as error:
        raise ShsaError(f"the secret {path} cannot be made: {error.strerror}") from error
    return read(path)


def read(path: str) -> bytes:
    """Return the secret in a file. Raises ShsaError if others could know it, or replace it."""
    user = os.geteuid()
    try:
        folder = os.stat(os.path.dirname(path) or ".")
        secret = read_own(path, LENGTH_B)
    except OSError as error:
        why = error.strerror or str(error)
        raise _refused(path, why, f"a file of user {user} alone, of mode 0600") from error
    if len(secret) != LENGTH_B:
        raise _refused(path, f"it has not {LENGTH_B} bytes", f"{LENGTH_B} random bytes")
    mode = stat.S_IMODE(folder.st_mode)
    if folder.st_uid not in (user, 0) or mode & 0o022:
        whose = f"its folder is of user {folder.st_uid} and has the mode {mode:04o}"
        raise _refused(path, whose, f"a folder that only user {user} or root can write, as 0700")
    return secret


def _refused(path: str, wrong: str, allowed: str) -> ShsaError:
    return ShsaError(f"the secret {path} is refused: {wrong}; allowed is {allowed}")


def _make(path: str) -> None:
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
        with suppress(FileNotFoundError):
            os.unlink(part)
