"""The messages mean what they say."""
import re
from pathlib import Path

import pytest

MESSAGES = sorted(Path(__file__).resolve().parent.parent.glob("src/shsa_msgs/*/*"))


@pytest.mark.parametrize("path", [p for p in MESSAGES if p.suffix in (".msg", ".srv", ".action")])
def test_text_constants_have_no_comment_beside_them(path: Path) -> None:
    # ROS takes the rest of the line for the text of a string constant.
    beside = [line for line in path.read_text().splitlines() if re.match(r"string \w+=.*#", line)]
    assert not beside
