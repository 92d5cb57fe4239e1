"""The file with the secret: made once, whoever comes first, and refused if others could know it."""
import os
import stat
import subprocess
import sys
from pathlib import Path
from typing import Callable

import pytest

from shsa_core.errors import ShsaError
from shsa_core.ros.trust import secret


def test_it_is_made_for_its_user_alone_and_then_read(tmp_path: Path) -> None:
    path = tmp_path / "home" / "shsa" / "secret"
    made = secret.obtain(str(path))
    assert len(made) == secret.LENGTH_B and len(set(made)) > 4
    assert secret.obtain(str(path)) == made
    assert stat.S_IMODE(path.stat().st_mode) == 0o600
    assert stat.S_IMODE(path.parent.stat().st_mode) == 0o700
    assert os.listdir(path.parent) == ["secret"], "nothing else is left there"


def test_of_several_who_start_at_once_all_have_the_same(tmp_path: Path) -> None:
    path = str(tmp_path / "shsa" / "secret")
    words = "from shsa_core.ros.trust.secret import obtain; import sys"
    command = [sys.executable, "-c", f"{words}; print(obtain(sys.argv[1]).hex())", path]
    started = [subprocess.Popen(command, stdout=subprocess.PIPE) for _ in range(6)]
    assert {each.communicate(timeout=30.0)[0] for each in started} == {
        secret.read(path).hex().encode() + b"\n"
    }


def _readable(path: Path) -> None:
    path.chmod(0o640)


def _short(path: Path) -> None:
    path.write_bytes(b"short")


def _link(path: Path) -> None:
    path.rename(path.with_name("elsewhere"))
    path.symlink_to("elsewhere")


def _fifo(path: Path) -> None:
    path.unlink()
    os.mkfifo(path, 0o600)


def _folder(path: Path) -> None:
    path.unlink()
    path.mkdir(0o700)


def _open_folder(path: Path) -> None:
    path.parent.chmod(0o777)


@pytest.mark.parametrize(
    ("spoil", "why"),
    (
        (_readable, "others can read or write it; allowed is a file of user"),
        (_short, "it has not 32 bytes"),
        (_link, "symbolic link"),
        (_fifo, "it is no file"),
        (_folder, "Is a directory"),
        (_open_folder, "mode 0777; allowed is a folder that only user"),
    ),
)
def test_one_that_others_could_know_or_change_is_refused(
    spoil: Callable[[Path], None], why: str, tmp_path: Path
) -> None:
    path = tmp_path / "shsa" / "secret"
    secret.obtain(str(path))
    spoil(path)
    with pytest.raises(ShsaError) as refusal:
        secret.obtain(str(path))
    assert str(path) in str(refusal.value) and why in str(refusal.value)


def test_one_of_another_user_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = str(tmp_path / "shsa" / "secret")
    secret.obtain(path)
    user = os.geteuid()
    monkeypatch.setattr(secret.os, "geteuid", lambda: user + 1)
    with pytest.raises(
        ShsaError, match=f"another user; allowed is a file of user {user + 1} alone"
    ):
        secret.read(path)
