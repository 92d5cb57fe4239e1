"""Each package builds and installs alone, with nothing but the packages that it names."""
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any, Dict, Iterator, List, Set
from xml.etree import ElementTree

import pytest

from shsa_testing.thorough import LONG

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {path.parent.name: path.parent for path in sorted(ROOT.glob("src/*/package.xml"))}
ROBOT = ("shsa_core", "shsa_msgs")
"""The packages with which a robot heals."""
OURS = ("ROS_PACKAGE_PATH", "CMAKE_PREFIX_PATH", "PYTHONPATH", "LD_LIBRARY_PATH", "PKG_CONFIG_PATH")


def needs(name: str) -> Set[str]:
    """Return the packages of this repository that a package needs, and itself."""
    root = ElementTree.parse(str(PACKAGES[name] / "package.xml")).getroot()
    tags = ("depend", "build_depend", "exec_depend")
    direct = {str(each.text) for tag in tags for each in root.findall(tag)} & set(PACKAGES)
    return {name}.union(*(needs(each) for each in direct))


def environment() -> Dict[str, str]:
    """Return the environment without this workspace."""
    clean = dict(os.environ)
    for name in OURS:
        parts = clean.get(name, "").split(":")
        clean[name] = ":".join(part for part in parts if part and not part.startswith(str(ROOT)))
    return clean


def run(command: List[str], environment: Dict[str, str]) -> str:
    """Return what a command prints; fail with that if it fails."""
    done = subprocess.run(
        command,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        universal_newlines=True,
    )
    assert done.returncode == 0, done.stdout[-4000:]
    return done.stdout


def files(folder: Path) -> Iterator[Path]:
    skipped = {"__pycache__"}
    return (path for path in folder.rglob("*") if not skipped & set(path.parts))


@pytest.mark.parametrize("name", PACKAGES)
def test_no_link_leaves_a_package(name: str) -> None:
    package = PACKAGES[name]
    links = [path for path in files(package) if path.is_symlink()]
    assert all(package in path.resolve().parents for path in links)


def test_folders_at_the_top_show_the_files_of_the_packages() -> None:
    for folder in ("launch", "ontology"):
        shown = {path.resolve() for path in (ROOT / folder).iterdir()}
        assert shown == {path.resolve() for path in ROOT.glob(f"src/*/{folder}/*")}
        assert all(path.is_symlink() for path in (ROOT / folder).iterdir())


class Installed:
    """The packages, each built from a copy of its own against those that it needs."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._prefixes: Dict[str, Path] = {}

    def prefix(self, name: str) -> Path:
        """Return the prefix in which a package is installed, alone."""
        if name not in self._prefixes:
            others = [self.prefix(each) for each in sorted(needs(name) - {name})]
            self._prefixes[name] = self._install(name, others)
        return self._prefixes[name]

    def _install(self, name: str, others: List[Path]) -> Path:
        source, build, prefix = (self._folder / part / name for part in ("src", "build", "install"))
        shutil.copytree(str(PACKAGES[name]), str(source), symlinks=True)
        clean = environment()
        paths = [*map(str, others), clean.get("CMAKE_PREFIX_PATH", "")]
        clean["CMAKE_PREFIX_PATH"] = ":".join(filter(None, paths))
        if not LONG:  # `make build` has made the messages of the others
            clean["ROS_LANG_DISABLE"] = "gencpp:genlisp"
        configure = ["cmake", "-S", str(source), "-B", str(build), "-DCATKIN_ENABLE_TESTING=OFF"]
        configure += ["-DPYTHON_EXECUTABLE=/usr/bin/python3", f"-DCMAKE_INSTALL_PREFIX={prefix}"]
        for command in (configure, ["make", "-C", str(build), "-j2", "install"]):
            run(command, clean)
        shutil.rmtree(str(source))  # what is installed must not need it
        return prefix


@pytest.fixture(scope="module")
def installed(tmp_path_factory: Any) -> Installed:
    return Installed(tmp_path_factory.mktemp("packages"))


@pytest.mark.parametrize("name", PACKAGES if LONG else ROBOT)
def test_a_package_stands_alone(name: str, installed: Installed) -> None:
    package, prefix = PACKAGES[name], installed.prefix(name)
    share = prefix / "share" / name
    for folder in ("launch", "ontology", "config"):
        given = {path.name for path in (package / folder).glob("*")}
        assert {path.name for path in (share / folder).glob("*")} == given
    assert not [path for path in prefix.rglob("*") if path.is_symlink()]
    modules = package / "src" / name
    wanted = {path.relative_to(modules) for path in files(modules) if path.is_file()}
    (found,) = prefix.glob(f"lib/python3*/*-packages/{name}")
    assert {path.relative_to(found) for path in files(found)} >= wanted


def test_healing_needs_no_other_package_of_this_repository() -> None:
    for name in ROBOT:
        root = ElementTree.parse(str(PACKAGES[name] / "package.xml")).getroot()
        named = {str(each.text) for each in root.iter() if each.tag.endswith("depend")}
        assert named & set(PACKAGES) <= set(ROBOT)


@pytest.mark.skipif(not LONG, reason="builds for a minute: make test-long")
def test_a_workspace_of_what_a_robot_needs_builds_with_its_tests(tmp_path: Path) -> None:
    for name in ROBOT:
        shutil.copytree(str(PACKAGES[name]), str(tmp_path / "src" / name), symlinks=True)
    command = ["catkin_make", "-C", str(tmp_path), "-DPYTHON_EXECUTABLE=/usr/bin/python3"]
    run([*command, "-DCATKIN_ENABLE_TESTING=ON"], environment())
    shsa = f"source {tmp_path}/devel/setup.bash && rosrun shsa_core shsa"
    run(["bash", "-c", f"{shsa} --version"], environment())
    said = run(["bash", "-c", f"{shsa} learn x; test $? = 2"], environment())
    assert "shsa: learn needs the package shsa_learning" in said


@pytest.mark.skipif(not LONG, reason="installs four packages: make test-long")
def test_the_command_line_works_where_it_is_installed(installed: Installed, tmp_path: Path) -> None:
    packages = [installed.prefix(name) for name in ("shsa_core", "shsa_learning")]
    modules = [str(path) for each in packages for path in each.glob("lib/python3*/*-packages")]
    ontology = installed.prefix("shsa_rover") / "share" / "shsa_rover" / "ontology"
    page = tmp_path / "page.html"
    script = installed.prefix("shsa_core") / "bin" / "shsa"
    command = [sys.executable, str(script), "report"]
    command += ["--ontology", str(ontology / "rover.yaml")]
    command += ["--som", str(ontology / "rover_som.yaml"), "--html", str(page)]
    path = ":".join(filter(None, [*modules, environment().get("PYTHONPATH", "")]))
    subprocess.run(command, env={**environment(), "PYTHONPATH": path}, check=True)
    assert "<svg" in page.read_text()


@pytest.mark.parametrize(
    "name", [name for name, at in PACKAGES.items() if (at / "test/rostest").is_dir()]
)
def test_catkin_runs_each_rostest(name: str) -> None:
    at = PACKAGES[name]
    assert "add_rostest(" in (at / "CMakeLists.txt").read_text()
