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
TESTS = ("src/*/test/unit", "src/*/test/rostest", "src/*/bench", "test")
FOLDERS = sorted(str(path.relative_to(ROOT)) for each in TESTS for path in ROOT.glob(each))


def python_files() -> List[str]:
    """Every Python file that git knows or would know, executables without a suffix included."""
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
    return path.suffix == "" and path.read_bytes()[:30].startswith(b"#!/usr/bin/env python3")


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
    """The checker's command; skips the test where this system has none, or another version."""
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


@pytest.mark.parametrize("package", PACKAGES)
def test_types(package: str) -> None:
    run([tool("mypy", "1."), f"src/{package}/src/{package}"])


@pytest.mark.parametrize("folder", FOLDERS)
def test_types_of_tests_and_benchmarks(folder: str) -> None:
    # The modules of a folder import each other by their names alone.
    files = [name for name in python_files() if str(Path(name).parent) == folder]
    run([tool("mypy", "1."), *files], MYPYPATH=folder)


def test_types_of_executables() -> None:
    folders = ("nodes", "scripts", "tools")
    run([tool("mypy", "1."), *(n for n in python_files() if Path(n).parent.name in folders)])


def test_every_python_file_is_seen_by_the_type_checker() -> None:
    seen = ("nodes", "scripts", "tools", *(Path(folder).name for folder in FOLDERS))
    rest = [name for name in python_files() if Path(name).parent.name not in seen]
    packages = tuple(f"src/{package}/src/{package}/" for package in PACKAGES)
    left = [name for name in rest if not name.startswith(packages)]
    assert {Path(name).name for name in left} <= {"conftest.py", "setup.py"}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_says_that_it_is_typed(package: str) -> None:
    assert (ROOT / "src" / package / "src" / package / "py.typed").is_file()
    assert "py.typed" in (ROOT / "src" / package / "setup.py").read_text()


def test_catkin_lint() -> None:
    run([tool("catkin_lint"), "-W2", "--strict", "src"])
