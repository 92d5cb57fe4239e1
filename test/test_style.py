"""Format, names, types and package files are clean."""
import os
import subprocess
from pathlib import Path
from shutil import which
from typing import List

import pytest

from shsa_testing.thorough import LONG

ROOT = Path(__file__).resolve().parent.parent
BLACK = "23."  # other versions format otherwise
PACKAGES = sorted(path.parent.name for path in ROOT.glob("src/*/setup.py"))
BESIDE = (
    "src/*/test/unit",
    "src/*/test/rostest",
    "src/*/test/browser",
    "src/*/bench",
    "test",
    "docs",
    "examples/*/test/rostest",
)
FOLDERS = sorted(str(path.relative_to(ROOT)) for each in BESIDE for path in ROOT.glob(each))
# Rostests start as they are, where another python3 may be the first on the PATH.
PYTHON = (b"#!/usr/bin/env python3", b"#!/usr/bin/python3")
UNTYPED = ("setup.py",)  # a package each: three modules of one name


RECENT = 20
"""The commits whose files `make test` looks at; `make test-long` looks at all files."""


def git(*words: str) -> List[str]:
    """Return the files that a command of git names; none if it fails."""
    done = subprocess.run(
        ["git", *words], cwd=ROOT, stdout=subprocess.PIPE, universal_newlines=True
    )
    return done.stdout.splitlines()


def python_files(recent: bool = False) -> List[str]:
    """Return every Python file that git would know, executables without a suffix included.

    If `recent`, and not in the long form, only those that the last commits have changed.
    """
    new = git("ls-files", "--others", "--exclude-standard")
    listed = [ROOT / name for name in (*git("ls-files", "--cached"), *new)]
    files = [path for path in listed if path.is_file() and _is_python(path)]
    found = [str(path.relative_to(ROOT)) for path in files]
    if recent and not LONG:  # all of them where there are no more commits than those
        changed = {*git("diff", "--name-only", f"HEAD~{RECENT}"), *new}
        return [name for name in found if name in changed] or found
    return found


def _is_python(path: Path) -> bool:
    if path.suffix == ".py":
        return True
    return path.suffix == "" and path.read_bytes()[:30].startswith(PYTHON)


def run(command: List[str], **environment: str) -> None:
    """Run a checker; fail with what it prints."""
    done = subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, **environment},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    assert done.returncode == 0, done.stdout


def tool(name: str, version: str = "") -> str:
    """Return the checker's command; skip the test if there is none, or another version."""
    path = which(name, path="/usr/bin:/usr/local/bin")
    if path is None:
        pytest.skip(f"{name} is not packaged for this system")
    told = subprocess.run(
        [path, "--version"], stdout=subprocess.PIPE, universal_newlines=True
    ).stdout
    if version not in told:
        pytest.skip(f"the format is that of {name} {version}; here is {told.strip()}")
    return path


def test_format() -> None:
    run([tool("black", BLACK), "--check", "--quiet", "--diff", *python_files(recent=True)])


def test_lint() -> None:
    run([tool("flake8"), *python_files(recent=True)])


def test_types() -> None:
    # The modules of a folder import each other by their names alone; no two have one name.
    files = [name for name in python_files(recent=True) if Path(name).name not in UNTYPED]
    run([tool("mypy", "1."), *files], MYPYPATH=os.pathsep.join(FOLDERS))


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_says_that_it_is_typed(package: str) -> None:
    assert (ROOT / "src" / package / "src" / package / "py.typed").is_file()
    assert "py.typed" in (ROOT / "src" / package / "setup.py").read_text()


def test_catkin_lint() -> None:
    strict = [tool("catkin_lint"), "-W2", "--strict"]
    run([*strict, "src"])
    # An example's package has a name that no other has, and its folder a short one.
    run([*strict, "--ignore", "package_path_name", "examples"])
