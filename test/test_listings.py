"""Commands on the pages work, or the page says why no test types them."""
import doctest
import re
import shlex
import shutil
import subprocess
from pathlib import Path
from typing import Dict, Iterator, List, Set

import pytest
from listings import ROOT, Listing, Page, Reader, follower, listings, new_reader

from shsa_core.cli.main import command_line
from shsa_core.ros.launch_arguments import unknown

PAGES = sorted(
    path for each in ("*.md", "docs/**/*.md", "*/*/README.md") for path in ROOT.glob(each)
)
TYPED = [each for page in PAGES for each in listings(page) if each.commands]
SAFE = ("shsa ", "rosrun shsa_core shsa ", "source ")
"""Commands that only read: they may be typed on any machine."""
LEFT = [each for each in TYPED if not each.not_run and not follower(each.page)]
ALONE = [each for each in LEFT if all(line.startswith(SAFE) for line in each.text.split("\n"))]
"""Commands that need the small example's files alone, and are done within seconds."""
FOLLOWED = [page for page in PAGES if follower(page)]
EXAMPLES = [page for page in PAGES if ">>> " in page.read_text("utf-8")]


@pytest.fixture(scope="module")
def reader(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Reader]:
    """Somebody in a folder with the small example's files, who also sees those of the workspace."""
    folder = tmp_path_factory.mktemp("reader")
    for name, copy in (("robot", "ontology"), ("robot_som", "som")):
        for target in (name, copy):
            shutil.copy(
                str(ROOT / "examples" / "battery" / f"{name}.yaml"), str(folder / f"{target}.yaml")
            )
    for name in ("src", "devel", "examples", "tools"):
        (folder / name).symlink_to(ROOT / name)
    with new_reader(folder) as typing:
        yield typing


@pytest.mark.parametrize("listing", ALONE, ids=str)
def test_a_listing_does_what_it_should(listing: Listing, reader: Reader) -> None:
    reader.types(listing.text)


def test_what_is_sourced_puts_the_python_of_ros_first(tmp_path: Path) -> None:
    """Launched programs that begin with `env python3` would take another one, as of pyenv."""
    other = tmp_path / "python3"
    other.write_text("#!/bin/sh\nexit 1\n")
    other.chmod(0o755)
    lines = [line.strip() for each in TYPED for line in each.text.split("\n")]
    sourced = {line for line in lines if line.startswith("source ")}
    assert sourced
    for line in sourced:
        words = ["bash", "-ec", f'PATH="{tmp_path}:$PATH"; {line}; command -v python3']
        found = subprocess.check_output(words, cwd=str(ROOT), universal_newlines=True)
        assert found.strip() == "/usr/bin/python3", line


def test_what_nobody_types_says_why() -> None:
    assert [str(each) for each in LEFT if each not in ALONE] == []


@pytest.mark.parametrize("page", FOLLOWED, ids=lambda page: page.name)
def test_a_page_is_followed_to_its_end(page: Path) -> None:
    test = (ROOT / follower(page)).read_text()
    assert page.name in test and ".finished()" in test


@pytest.mark.parametrize("listing", TYPED, ids=str)
def test_what_is_typed_exists(listing: Listing) -> None:
    for line in listing.text.replace("\\\n", " ").split("\n"):
        for words in _commands(line):
            wrong = _wrong(words)
            assert not wrong, f"{listing}: {wrong}"


def _commands(line: str) -> Iterator[List[str]]:
    """Yield the commands of a line, each as its words; none of what is only shown."""
    words = shlex.split(line, comments=True) if line.count("'") % 2 == 0 else []
    if words[:2] == ["rosrun", "shsa_core"] and words[2:3] == ["shsa"]:
        words = words[2:]
    if words[:1] in (["shsa"], ["roslaunch"], ["make"]):
        yield words


def _wrong(words: List[str]) -> str:
    """Return what of a command is not there; empty: nothing."""
    if words[0] == "make":
        targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
        return "" if words[1] in targets else f"no target {words[1]}"
    if words[0] == "roslaunch":
        return _wrong_launch(words[1:])
    if words[1].startswith("-"):
        return ""
    if words[1] not in _options():
        return f"no command {words[1]}"
    given = {
        re.split("[=|]", word.strip("[]"))[0] for word in words if word.strip("[").startswith("--")
    }
    unknown = given - _options()[words[1]]
    return f"{words[1]} has no {min(unknown)}" if unknown else ""


def _wrong_launch(words: List[str]) -> str:
    """Return what a launch file of ours lacks that its arguments name, files included."""
    files = [word for word in words if word.endswith(".launch")]
    found = [path for each in ("src", "examples") for path in ROOT.glob(f"{each}/*/**/*.launch")]
    words_of = {part for word in words[:2] for part in Path(word).parts}
    named = [path for path in found if files and path.name == Path(files[0]).name]
    named.sort(key=lambda path: len(words_of & set(path.parts)), reverse=True)
    if not named:
        return f"no launch file in {' '.join(words)}"
    given = [word for word in words if ":=" in word]
    refused = unknown(["roslaunch", str(named[0]), *given])
    return f"{files[0]} has no {refused[0][0]}" if refused else ""


def _options() -> Dict[str, Set[str]]:
    """Return the commands of `shsa`, and the options of each."""
    parser = command_line()[0]
    (subparsers,) = (each for each in parser._actions if each.choices and not each.option_strings)
    return {
        name: {option for action in command._actions for option in action.option_strings}
        for name, command in dict(subparsers.choices or {}).items()
    }


@pytest.mark.parametrize("page", EXAMPLES, ids=lambda page: page.name)
def test_the_examples_of_a_page_are_true(page: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(ROOT)
    shown = "\n\n".join(each.text for each in listings(page) if each.language == "pycon")
    examples = doctest.DocTestParser().get_doctest(shown, {}, page.name, str(page), 0)
    told: List[str] = []
    assert examples.examples
    assert doctest.DocTestRunner().run(examples, out=told.append).failed == 0, "".join(told)


def test_a_page_that_is_not_followed_to_its_end_is_found(tmp_path: Path) -> None:
    page = tmp_path / "page.md"
    page.write_text(
        "One:\n\n    shsa check o.yaml\n\nand\n\n<!-- not run: why -->\n    make demo\n\n"
        "```yaml\nservices:\n```\n\n```bash\nls\n```\n"
    )
    assert [each.commands for each in listings(page)] == [True, True, False, True]
    assert [each.not_run for each in listings(page)] == ["", "why", "", ""]
    followed = Page(page)
    assert followed.take("shsa check") == "shsa check o.yaml"
    with pytest.raises(AssertionError, match="was expected"):
        Page(page).take("roscore")
    assert followed.take() == "ls"
    followed.finished()
