"""What the commands print, and the numbers that they are given."""
import argparse
import re
import sys
from typing import Callable

from shsa_core.text import shown

LONGEST_LINE = 200_000
"""Characters of a line: the longest code has half of that."""


def say(text: object = "", error: bool = False) -> None:
    """Print some lines: printable, whatever names a file holds."""
    for line in str(text).split("\n"):
        print(shown(line, LONGEST_LINE), file=sys.stderr if error else sys.stdout)


def whole_number(least: int) -> Callable[[str], int]:
    """What reads an option that must be a whole number of at least `least`."""

    def read(text: str) -> int:
        if not re.fullmatch("[0-9]{1,9}", text) or int(text) < least:
            raise argparse.ArgumentTypeError(f"{text!a} is no whole number from {least} on")
        return int(text)

    return read
