"""The documentation stays short and in plain English: pages, words, ease, and proselint."""
import ast
import re
import subprocess
from pathlib import Path
from shutil import which
from typing import Iterator, List

import pytest
from listings import ROOT

FOLDERS = ("*.md", "docs/**/*.md", "*/*/README.md")
PAGES = sorted(path for each in FOLDERS for path in ROOT.glob(each))
MOST_PAGES = 25
"""In the folder docs; beside them are the READMEs, CONTRIBUTING and SECURITY."""
MOST_WORDS = 25000
LONGEST_MEAN = 18.5
"""Words a sentence, in the mean of a page's prose."""
LEAST_EASE = 60.0
"""Of reading, after Flesch: from 60 on, English is called plain."""
MOST_STEPS, MOST_STEP_WORDS = 10, 1500
"""Of the tutorial by which people heal their own robots."""
RIDDLES = re.compile(r"\b(whoever|stands? (by|in)|voices|pictures?|as ever)\b", re.IGNORECASE)
"""Words that have a plainer one: anyone who, is ready, replaces, publishers, images, as usual."""
TYPOGRAPHY = re.compile(r"typography\.symbols\.(ellipsis|curly_quotes|sentence_spacing)")
"""What proselint says of characters that commands and code have."""


def words(text: str) -> List[str]:
    return [each for each in text.split() if re.search(r"\w", each)]


def prose(page: Path) -> str:
    """Return a page without code, tables, comments, headings, images and the targets of links."""
    text = re.sub(r"^```.*?^```", "", page.read_text("utf-8"), flags=re.DOTALL | re.MULTILINE)
    text = re.sub(r"<!--.*?-->|^(\||#| {4}).*$|!\[.*?\]\(.*?\)", "", text, flags=re.MULTILINE)
    return re.sub(r"`[^`]*`", "code", re.sub(r"\]\([^)]*\)", "]", text))


def sentences(text: str) -> List[str]:
    parts = re.split(r"(?<=[.!?])\s+|\n\s*(?:-|\d+\.)\s+|\n\n+", text)
    return [part for part in parts if len(words(part)) > 2]


def ease(found: List[str]) -> float:
    """Return how easy sentences are to read, after Flesch, with syllables by their vowels."""
    spoken = [word for each in found for word in re.findall(r"[a-z]+", each.lower())]
    vowels = (re.findall(r"[aeiouy]+", re.sub(r"e$", "", word)) for word in spoken)
    syllables = sum(max(1, len(each)) for each in vowels)
    return 206.835 - 1.015 * len(spoken) / len(found) - 84.6 * syllables / len(spoken)


def test_there_are_few_pages_and_words() -> None:
    assert len([page for page in PAGES if ROOT / "docs" in page.parents]) <= MOST_PAGES
    assert sum(len(words(page.read_text("utf-8"))) for page in PAGES) <= MOST_WORDS


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_sentences_are_short(page: Path) -> None:
    found = sentences(prose(page))
    assert sum(len(words(each)) for each in found) <= LONGEST_MEAN * len(found)


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_a_page_is_easy_to_read(page: Path) -> None:
    assert ease(sentences(prose(page))) >= LEAST_EASE


def test_healing_ones_own_robot_takes_few_steps_and_words() -> None:
    page = (ROOT / "docs" / "tutorials" / "any_robot.md").read_text("utf-8")
    assert len(re.findall(r"^## \d+\. ", page, re.MULTILINE)) <= MOST_STEPS
    assert len(words(page)) <= MOST_STEP_WORDS


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_words_are_plain(page: Path) -> None:
    assert [found.group() for found in RIDDLES.finditer(page.read_text("utf-8"))] == []


def messages(module: Path) -> Iterator[str]:
    """Yield the texts of a module's code: messages, helps and words; no docstrings, no names."""
    tree = ast.parse(module.read_text("utf-8"))
    told = {id(each.value) for each in ast.walk(tree) if isinstance(each, ast.Expr)}
    for each in ast.walk(tree):
        if isinstance(each, ast.Constant) and isinstance(each.value, str) and id(each) not in told:
            yield each.value


def shown(page: Path) -> Iterator[str]:
    """Yield the texts of a script or of markup that a browser shows."""
    text = page.read_text("utf-8")
    if page.suffix == ".html":
        yield text
    else:
        text = re.sub(r"^\s*(/?\*|//).*$", "", text, flags=re.MULTILINE)
        yield from re.findall(r'"[^"\n]*"|`[^`]*`', text)


@pytest.mark.parametrize("package", sorted(ROOT.glob("src/*/src/*/")), ids=lambda each: each.name)
def test_words_of_messages_are_plain(package: Path) -> None:
    texts = [(path, text) for path in package.rglob("*.py") for text in messages(path)]
    for suffix in ("js", "html"):
        texts += [(p, text) for p in package.glob(f"page/*.{suffix}") for text in shown(p)]
    assert [f"{path.name}: {text}" for path, text in texts if RIDDLES.search(text)] == []


def test_proselint_has_no_complaint(tmp_path: Path) -> None:
    program = which("proselint", path="/usr/bin")
    if program is None:
        pytest.skip("no python3-proselint on this system")
    (tmp_path / "prose").write_text("\n".join(map(prose, PAGES)), "utf-8")
    told = subprocess.run(
        [program, "prose"], cwd=str(tmp_path), stdout=subprocess.PIPE, universal_newlines=True
    ).stdout
    assert [line for line in told.splitlines() if not TYPOGRAPHY.search(line)] == []
