"""Whatever the code imports is packaged, in Debian 12 and in Ubuntu 20.04.

Every package says what it needs.
"""
import ast
import csv
import importlib.util
import subprocess
import sys
from functools import lru_cache
from pathlib import Path
from shutil import which
from typing import Dict, FrozenSet, Iterator, List, Set
from xml.etree import ElementTree

import pytest

ROOT = Path(__file__).resolve().parent.parent
SOURCES = sorted(
    path.parent for folder in ("src", "examples") for path in ROOT.glob(f"{folder}/*/package.xml")
)
PACKAGES = [str(ElementTree.parse(str(path / "package.xml")).findtext("name")) for path in SOURCES]
SHEBANGS = (b"#!/usr/bin/env py", b"#!/usr/bin/python3")
TEST_FOLDERS = ("test", "bench")
"""Of a package: what is imported there may be a test_depend."""


def rows() -> List[Dict[str, str]]:
    """Return the list of dependencies."""
    with open(ROOT / "tools" / "dependencies.csv", newline="") as file:
        return list(csv.DictReader(file))


MODULES = {row["name"]: row for row in rows() if row["kind"] == "module"}
STANDARD = {*sys.builtin_module_names, *getattr(sys, "stdlib_module_names", ())}


@lru_cache(maxsize=None)
def is_standard(name: str) -> bool:
    """Return whether a module comes with Python."""
    if name in STANDARD:
        return True
    spec = importlib.util.find_spec(name)
    origin = str(spec.origin) if spec is not None else ""
    return "/lib/python3" in origin and "-packages" not in origin


def python_files(folder: Path) -> Iterator[Path]:
    """Yield the Python files below a folder, executables without a suffix included."""
    for path in sorted(folder.rglob("*")):
        if path.is_file() and not {"build", "devel", "install"} & set(path.parts):
            script = path.suffix == "" and path.read_bytes()[:30].startswith(SHEBANGS)
            if path.suffix == ".py" or script:
                yield path


@lru_cache(maxsize=None)
def imported(path: Path) -> FrozenSet[str]:
    """Return the top-level names that a file imports."""
    names: Set[str] = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name.split(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module.split(".")[0])
    return frozenset(names)


@lru_cache(maxsize=None)
def beside(folder: Path) -> FrozenSet[str]:
    """Return the modules of a folder."""
    return frozenset(other.stem for other in folder.glob("*.py"))


@lru_cache(maxsize=None)
def elsewhere() -> FrozenSet[str]:
    """Return modules of benchmarks, unit tests and browser tests that tests elsewhere import."""
    folders = ("src/*/bench/*.py", "src/*/test/unit/audit.py", "src/*/test/browser/*.py")
    found = {other.stem for folder in folders for other in ROOT.glob(folder)}
    found |= {p.parent.name for p in ROOT.glob("src/*/bench/*/__init__.py")}
    return frozenset(found | {"conftest"})


@lru_cache(maxsize=None)
def foreign(path: Path) -> FrozenSet[str]:
    """Return the imports of a file that are neither Python's own nor modules of ours."""
    ours = {*PACKAGES, *beside(path.parent), *elsewhere()}
    return frozenset(n for n in imported(path) if n not in ours and not is_standard(n))


def depends(package: Path, *tags: str) -> Set[str]:
    """Return the dependencies in a package.xml."""
    root = ElementTree.parse(str(package / "package.xml")).getroot()
    return {str(each.text) for tag in tags for each in root.findall(tag)}


def in_tests(package: Path, path: Path) -> bool:
    return path.relative_to(package).parts[0] in TEST_FOLDERS


def test_every_import_is_in_the_list_and_the_list_has_no_more() -> None:
    used: Set[str] = set()
    for folder in ("src", "test", "tools", "examples"):
        for path in python_files(ROOT / folder):
            used |= foreign(path)
    assert used == set(MODULES)


@pytest.mark.parametrize("package", SOURCES, ids=PACKAGES)
def test_package_xml_names_what_the_package_imports(package: Path) -> None:
    runs = depends(package, "depend", "exec_depend", "buildtool_depend")
    tests = runs | depends(package, "test_depend")
    missing = []
    for path in python_files(package):
        allowed = tests if in_tests(package, path) else runs
        needed = {MODULES[name]["rosdep"] for name in foreign(path) if name in MODULES}
        needed |= {name for name in imported(path) if name in PACKAGES and name != package.name}
        if package.name == "shsa_core" and in_tests(package, path):
            needed -= {"shsa_testing"}  # who builds it without the others lacks nothing
        missing += [f"{path.name}: {name}" for name in sorted(needed - allowed - {""})]
    assert not missing


@pytest.mark.parametrize("package", SOURCES, ids=PACKAGES)
def test_package_xml_names_no_library_that_is_not_imported(package: Path) -> None:
    used = {name for path in python_files(package) for name in foreign(path)}
    keys = {MODULES[name]["rosdep"] for name in used if name in MODULES}
    given = depends(package, "depend", "exec_depend", "test_depend")
    assert {key for key in given if key.startswith("python3-")} <= keys


@pytest.mark.parametrize("package", SOURCES, ids=PACKAGES)
def test_package_xml_names_only_keys_that_rosdep_knows(package: Path) -> None:
    known = {row["rosdep"] for row in rows()} | set(PACKAGES)
    # Not imported from Python: headers, generators, message packages.
    known |= {"actionlib_msgs", "message_generation", "message_runtime", "roscpp"}
    assert depends(package, "depend", "build_depend", "exec_depend", "test_depend") <= known


@pytest.mark.parametrize(
    "system, column",
    [("debian", "debian 12"), ("noetic", "ubuntu 20.04")],
    ids=["debian", "noetic"],
)
def test_set_up_installs_what_is_in_the_list(system: str, column: str) -> None:
    installed = set((ROOT / "tools" / f"packages-{system}.txt").read_text().split())
    # On Ubuntu, rosdep installs what it has a key for.
    wanted = {row[column] for row in rows() if system == "debian" or not row["rosdep"]} - {""}
    assert wanted <= installed


@pytest.mark.skipif(which("dpkg") is None, reason="no dpkg on this system")
def test_the_list_names_the_packages_that_hold_the_modules() -> None:
    column = "ubuntu 20.04" if Path("/opt/ros/noetic").exists() else "debian 12"
    holds: Dict[str, str] = {}
    for name, row in MODULES.items():
        if not row[column]:  # its tests are skipped there
            continue
        spec = importlib.util.find_spec("ruamel.yaml" if name == "ruamel" else name)
        assert spec is not None, f"{name} is not installed"
        holds[name] = str(Path(str(spec.origin)).resolve())
    found = subprocess.run(
        ["dpkg", "-S", *holds.values()], stdout=subprocess.PIPE, universal_newlines=True
    ).stdout
    packages = {file: told for told, _, file in (x.partition(": ") for x in found.splitlines())}
    for name, path in holds.items():
        told = packages.get(path, "")
        assert MODULES[name][column] in told.split(", "), f"{name}: {told}"
