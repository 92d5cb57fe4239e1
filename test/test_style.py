"""Types, format and package files are clean."""
import subprocess
from pathlib import Path
from shutil import which
from typing import List

import pytest

ROOT = Path(__file__).resolve().parent.parent
BLACK = "23."  # other versions format otherwise


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


def run(command: List[str]) -> None:
    """Run a checker; fail with what it prints."""
    done = subprocess.run(
        command, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, universal_newlines=True
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


@pytest.mark.parametrize("package", ["shsa_core", "shsa_rover"])
def test_types(package: str) -> None:
    run([tool("mypy", "1."), f"src/{package}/src/{package}"])


def test_types_of_executables() -> None:
    run([tool("mypy", "1."), *(name for name in python_files() if "." not in Path(name).name)])


def test_catkin_lint() -> None:
    run([tool("catkin_lint"), "-W2", "--strict", "src"])
