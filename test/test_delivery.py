"""Delivery of the packages: the Dockerfile, the workflow, and what a release needs."""
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any, Iterator, List, Tuple

import pytest
import yaml  # type: ignore[import]
from catkin_pkg.changelog import get_changelog_from_path
from catkin_pkg.packages import find_packages

ROOT = Path(__file__).resolve().parent.parent
DOCKERFILE = (ROOT / "Dockerfile").read_text("utf-8")
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))
INSTRUCTIONS = ("ARG", "FROM", "RUN", "COPY", "WORKDIR", "USER", "ENTRYPOINT", "CMD")
SHELL = ("bash", "-n", "-c")
OUTSIDE = "build devel install results"
"""Folders of the workspace that are no packages' source."""


def targets() -> List[str]:
    """Return the targets of `make`."""
    return re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text("utf-8"), re.MULTILINE)


def made(text: str) -> List[str]:
    """Return the targets of `make` in a text of shell commands."""
    return re.findall(r"(?:^|&& |run: )make ([a-z-]+)", text, re.MULTILINE)


def instructions() -> Iterator[Tuple[str, str]]:
    """Of the Dockerfile, lines that go on put together."""
    for line in DOCKERFILE.replace("\\\n", " ").splitlines():
        if line.strip() and not line.startswith("#"):
            word, _, rest = line.partition(" ")
            yield word, " ".join(rest.split())


def commands(path: Path) -> Iterator[str]:
    """Yield the commands that a workflow runs."""
    for job in yaml.safe_load(path.read_text("utf-8"))["jobs"].values():
        yield from (step["run"] for step in job["steps"] if "run" in step)


def test_the_dockerfile_calls_what_is_there() -> None:
    found = list(instructions())
    assert {word for word, _ in found} <= set(INSTRUCTIONS)
    for word, rest in found:
        if word == "RUN":
            assert subprocess.run([*SHELL, rest]).returncode == 0, rest
        if word == "COPY":
            sources = rest.split()[:-1]
            assert sources and all((ROOT / each).exists() for each in sources)
        if word == "ENTRYPOINT":
            (program,) = yaml.safe_load(rest)
            here = ROOT / Path(program).relative_to("/shsa")
            assert os.access(here, os.X_OK)
    told = [name for word, rest in found if word == "RUN" for name in made(rest)]
    assert told == ["build"] and set(told) <= set(targets())
    (default,) = [rest for word, rest in found if word == "CMD"]
    _, package, launch = yaml.safe_load(default)
    assert (ROOT / "src" / package / "launch" / launch).is_file()


def test_nothing_that_was_built_here_goes_into_an_image() -> None:
    assert set(OUTSIDE.split()) <= set((ROOT / ".dockerignore").read_text("utf-8").split())


def test_the_entrypoint_runs_a_command_in_the_workspace() -> None:
    command = [str(ROOT / "tools" / "in_workspace"), "rospack", "find", "shsa_core"]
    found = subprocess.run(command, stdout=subprocess.PIPE, check=True, cwd="/").stdout.decode()
    assert found.strip() == str(ROOT / "src" / "shsa_core")


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_a_workflow_calls_what_is_there(path: Path) -> None:
    for command in commands(path):
        plain = re.sub(r"\$\{\{.*?\}\}", "x", command)
        assert subprocess.run([*SHELL, plain]).returncode == 0, command
        assert set(made(command)) <= set(targets())


def test_the_workflow_tests_and_builds_on_both_systems() -> None:
    (path,) = WORKFLOWS
    jobs = yaml.safe_load(path.read_text("utf-8"))["jobs"]
    assert {name: job["strategy"]["matrix"]["base"] for name, job in jobs.items()} == {
        name: ["debian:12", "ros:noetic"] for name in ("test", "image")
    }
    assert [name for command in commands(path) for name in made(command)] == ["test"]
    assert any(command.startswith("docker build --build-arg BASE=") for command in commands(path))
    assert ("ARG", "BASE=debian:12") in list(instructions())


def packages() -> List[Tuple[Path, Any]]:
    found = {}
    for folder in ("src", "examples"):
        found.update({ROOT / folder / k: v for k, v in find_packages(str(ROOT / folder)).items()})
    return sorted(found.items())


@pytest.mark.parametrize("folder, package", packages(), ids=lambda each: getattr(each, "name", ""))
def test_a_package_is_as_a_release_wants_it(folder: Path, package: Any) -> None:
    warnings: List[str] = []
    package.validate(warnings=warnings)
    assert not warnings and package.description and package.maintainers
    assert package.licenses == ["BSD-3-Clause"]
    assert (folder / "LICENSE").read_bytes() == (ROOT / "LICENSE").read_bytes()
    changelog = get_changelog_from_path(str(folder), package.name)
    text = (folder / "CHANGELOG.rst").read_text("utf-8")
    assert f"\nChangelog for package {package.name}\n" in text
    assert "\nForthcoming\n-----------\n* " in text
    versions = [version for version, _, _ in changelog.foreach_version()]
    assert not versions or package.version in versions


def test_a_release_can_be_prepared(tmp_path: Path) -> None:
    """By catkin's own tool, on a copy of what it reads and writes."""
    for folder, package in packages():
        copy = tmp_path / folder.relative_to(ROOT)
        copy.mkdir(parents=True)
        for name in ("package.xml", "CHANGELOG.rst"):
            shutil.copy(str(folder / name), str(copy / name))
    who = {
        f"GIT_{role}_{what}": "x" for role in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")
    }
    release = ["catkin_prepare_release", "--bump", "minor", "--no-push", "-y", "--no-color"]
    for command in (
        ["git", "init", "-q"],
        ["git", "add", "-A"],
        ["git", "commit", "-qm", "x"],
        release,
    ):
        done = subprocess.run(
            command,
            cwd=str(tmp_path),
            env={**os.environ, **who},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            universal_newlines=True,
        )
        assert done.returncode == 0, done.stdout
    assert "do not have a changelog" not in done.stdout
    tags = subprocess.run(
        ["git", "tag"], cwd=str(tmp_path), stdout=subprocess.PIPE, universal_newlines=True
    ).stdout.split()
    for folder, package in packages():
        text = (tmp_path / folder.relative_to(ROOT) / "CHANGELOG.rst").read_text("utf-8")
        newest = re.search(r"^([0-9.]+) \([0-9-]+\)$", text, re.MULTILINE)
        assert newest is not None and newest.group(1) != package.version
        assert tags == [newest.group(1)]
        assert "\nForthcoming\n" not in text
