"""The page's example, followed word by word, heals a robot."""
from pathlib import Path
from typing import Iterator

import pytest
from listings import PATIENCE_S, ROOT, Page, Reader, listings, new_reader

from shsa_testing.waiting import wait_until

START = ROOT / "docs" / "start.md"
FILES = {"properties:": "robot.yaml", "act: true": "robot_som.yaml"}
"""First words of blocks that are files."""


@pytest.fixture
def reader(tmp_path: Path) -> Iterator[Reader]:
    with new_reader(tmp_path) as typing:
        yield typing


def write_files(folder: Path) -> None:
    """Write the files of the page's example into a folder."""
    for listing in listings(START):
        name = FILES.get(listing.text.split("\n")[0])
        if name is not None:
            (folder / name).write_text(listing.text + "\n")


def test_the_page_heals_a_robot(tmp_path: Path, reader: Reader) -> None:
    write_files(tmp_path)
    page = Page(START)
    first = reader.opens_terminal(page.take("shsa check"))
    first.shows("Reconfigurator ready")
    assert "inputs  /power/data,/voltage/data" in first.shown()
    reader.types(page.take("rostopic pub"))
    state = "rostopic echo -n 1 /shsa/som_state"
    available = lambda: reader.types(state).count("available: True") == 3
    wait_until(available, PATIENCE_S, "three sensors")
    kill, look, again = page.take("rosnode kill").split("\n")
    assert reader.types(kill, look).count("data: 2.0") == 3
    assert "publishes it now" in first.shown()
    reader.types(again)
    first.shows("/current: /current_sensor is back. The substitute has stopped.")
    page.finished()
