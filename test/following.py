"""A reader who follows a tutorial from its first listing to its last, and looks for what it shows.

A comment on the line above a listing says what a reader knows from the sentence before it:

- `<!-- terminal 2 -->`: these commands are typed into terminal 2, and go on running there.
- `<!-- terminal 2 shows -->`: this is seen there, sooner or later; without it, what was typed last
  has printed it. Each line must be seen, in any order; `...` stands for anything.
- `<!-- again until seen -->`: what was typed last is typed again until it shows this.
- `<!-- edit FILE -->`: the lines of a file that are changed, as a difference.

`<!-- terminal 2 ends -->`, anywhere, is Ctrl-C in terminal 2.
"""
import re
import time
from pathlib import Path
from typing import Dict, List, NamedTuple, Optional

from listings import PATIENCE_S, ROOT, Listing, Page, Reader, Terminal, listings, seen

from shsa_testing.waiting import wait_until

_COMMENT = re.compile(r"<!-- (terminal \d+( shows| ends)?|again until seen|edit \S+) -->$")


class Step(NamedTuple):
    """The next thing that a reader does: `word` is the comment's, empty without one."""

    line: int
    word: str
    listing: Optional[Listing]


class Tutorial:
    """A tutorial: its steps, and what it says of itself."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.text = path.read_text("utf-8")
        self._words = {
            number: found.group(1)
            for number, line in enumerate(self.text.splitlines(), 1)
            for found in [_COMMENT.match(line)]
            if found
        }

    @property
    def steps(self) -> List[Step]:
        """In order, without what is neither typed, seen nor edited."""
        found = []
        for listing in listings(self.path):
            word = self._words.get(listing.line - 2, "")  # above the fence
            if listing.commands or listing.language in ("text", "diff"):
                found.append(Step(listing.line, word, listing))
        ends = [Step(at, word, None) for at, word in self._words.items() if word.endswith("ends")]
        return sorted(found + ends, key=lambda step: step.line)

    @property
    def commands(self) -> List[str]:
        """Each command, without what is said of it."""
        typed = [s.listing for s in self.steps if s.listing and s.listing.commands]
        lines = [line for each in typed if not each.not_run for line in each.text.splitlines()]
        return [command for command in (line.split("  #")[0].strip() for line in lines) if command]

    @property
    def edited(self) -> int:
        """Count the lines that are written by hand."""
        differences = [s.listing.text for s in self.steps if s.listing and _edits(s)]
        return sum(line.startswith("+") for each in differences for line in each.splitlines())

    @property
    def words(self) -> int:
        """Count the words to read."""
        return len(re.sub(r"<!--.*?-->", "", self.text).split())


class Follower:
    """Does what a tutorial says, and fails where it shows something else."""

    def __init__(self, reader: Reader) -> None:
        self._reader = reader
        self._terminals: Dict[str, Terminal] = {}
        self._typed = self._printed = ""

    def follow(self, tutorial: Tutorial) -> float:
        """Go through it; how long that took, in s."""
        began, page = time.monotonic(), Page(tutorial.path)
        for step in tutorial.steps:
            if step.listing is None:
                self._terminals[step.word.split()[1]].ends()
            elif step.listing.not_run:
                continue
            elif step.listing.commands:
                self._type(step.word, page.take())
            elif _edits(step):
                _change(self._reader.folder / step.word.split()[1], step.listing)
            elif step.listing.language == "text":
                self._see(step.word, step.listing)
        page.finished()
        return time.monotonic() - began

    def _type(self, word: str, commands: str) -> None:
        if word:
            self._terminals[word.split()[1]] = self._reader.opens_terminal(commands)
        else:
            self._typed, self._printed = commands, self._reader.types(commands)

    def _see(self, word: str, listing: Listing) -> None:
        for line in listing.text.splitlines():
            if word.startswith("terminal"):
                self._terminals[word.split()[1]].shows(line)
            elif word:
                wait_until(lambda: self._sees_now(line), PATIENCE_S, f"{listing}: {line}")
            else:
                assert seen(line, self._printed), f"{listing}: {line!r} not in {self._printed}"

    def _sees_now(self, line: str) -> bool:
        if not seen(line, self._printed):
            self._printed = self._reader.types(self._typed)
        return seen(line, self._printed)


def prepared(folder: Path) -> Path:
    """Return a new folder in which the workspace's own are found."""
    folder.mkdir()
    for name in ("devel", "examples", "src", "tools"):
        (folder / name).symlink_to(ROOT / name)
    return folder


def _edits(step: Step) -> bool:
    return step.word.startswith("edit ")


def _change(path: Path, listing: Listing) -> None:
    """Make a difference in a file; what the file says of a line, after its `#`, is not compared."""
    lines = path.read_text("utf-8").splitlines()
    told = [(line[:1], line[1:]) for line in listing.text.splitlines()]
    before = [text for sign, text in told if sign != "+"]
    bare = [line.split("  #")[0].rstrip() for line in lines]
    found = [at for at in range(len(bare)) if bare[at : at + len(before)] == before]
    assert len(found) == 1, f"{listing}: found {len(found)} times in {path.read_text('utf-8')}"
    at, after = found[0], []
    for sign, text in told:
        if sign == "+":
            after.append(text)
            continue
        if sign != "-":
            after.append(lines[at])
        at += 1
    lines[found[0] : at] = after
    path.write_text("\n".join(lines) + "\n", "utf-8")
