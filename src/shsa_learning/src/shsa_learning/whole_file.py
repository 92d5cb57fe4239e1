"""Writes files as a whole or not at all: a full disk or Ctrl-C leaves what was there."""
import os
import tempfile


def write_whole(path: str, text: str) -> None:
    """Write a file; a link to it stays one, and its mode stays. Raises OSError."""
    path = os.path.realpath(path)
    handle, temporary = tempfile.mkstemp(dir=os.path.dirname(path), prefix=".shsa-")
    try:
        with open(handle, "w", encoding="utf-8") as stream:
            stream.write(text)
        os.chmod(temporary, os.stat(path).st_mode & 0o777 if os.path.exists(path) else 0o644)
        os.replace(temporary, path)
    except BaseException:
        os.unlink(temporary)
        raise
