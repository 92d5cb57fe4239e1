"""Names and lines of the commands."""
import argparse
import re
import sys

from shsa_core.text import shown

LONGEST_PRINTED = 200_000
"""Characters of a printed line: the longest code has half of that."""


def say(text: object = "", error: bool = False) -> None:
    """Print lines; characters that could steer a terminal are escaped."""
    for line in str(text).split("\n"):
        print(shown(line, LONGEST_PRINTED), file=sys.stderr if error else sys.stdout)


def ros_namespace(text: str) -> str:
    """Return a namespace, as a type of argparse."""
    if not re.fullmatch("[A-Za-z0-9_/]*", text):
        raise argparse.ArgumentTypeError(f"{text!a} is no namespace, as /robot1")
    return text
