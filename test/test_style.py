"""Format, names, types and package files are clean."""
import os
import subprocess
from pathlib import Path
from shutil import which
from typing import List

import pytest

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


def python_files() -> List[str]:
    """Return every Python file that git would know, executables without a suffix included."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT,
        check=True,
        stdout=subprocess.PIPE,
        universal_newlines=True,
    ).stdout.splitlines()
    files = [ROOT / name for name in listed if (ROOT / name).is_file()]
    return [str(path.relative_to(ROOT)) for path in files if _is_python(path)]


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
    run([tool("black", BLACK), "--check", "--quiet", "--diff", *python_files()])


def test_lint() -> None:
    run([tool("flake8"), *python_files()])


def test_types() -> None:
    # The modules of a folder import each other by their names alone; no two have one name.
    files = [name for name in python_files() if Path(name).name not in UNTYPED]
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
