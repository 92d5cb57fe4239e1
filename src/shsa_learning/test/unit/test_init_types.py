"""Whatever message types a robot uses, its draft is valid: every type that is built here."""
import importlib
import pkgutil
import random
from pathlib import Path
from typing import Any, Iterator, List

import genpy
import pytest

from recordings import BagWriter
from shsa_core import message_types
from shsa_core.cli.main import main
from shsa_core.files.som_file import read_som
from shsa_learning.check import check_files

PACKAGES = (
    *("actionlib_msgs", "diagnostic_msgs", "geometry_msgs", "nav_msgs", "rosgraph_msgs"),
    *("sensor_msgs", "shsa_msgs", "std_msgs"),
)
MESSAGES = 8


def types() -> Iterator[Any]:
    """Yield every message type of the packages."""
    for package in PACKAGES:
        module = importlib.import_module(f"{package}.msg")
        for each in pkgutil.iter_modules(module.__path__):
            yield getattr(module, each.name.lstrip("_"))


def filled(kind: str, draw: random.Random) -> Any:
    """Return a value of a type, as strange as it may be."""
    element, bracket, size = kind.partition("[")
    if bracket:
        count = int(size[:-1]) if size[:-1] else draw.choice([0, 1, 3, 12])
        items = [filled(element, draw) for _ in range(count)]
        return bytes(items) if element in ("uint8", "char") else items
    if "/" in kind:
        message = message_types.message_class(kind)()
        for name, each in message_types.layout(kind).items():
            setattr(message, name, filled(each, draw))
        return message
    if kind == "string":
        return draw.choice(["", "left", "a b", "\n- x: {", "'\"", "\u00e4\u2028", "x" * 300])
    if kind == "bool":
        return draw.random() < 0.5
    if kind in ("time", "duration"):
        return genpy.Time(draw.randrange(1000)) if kind == "time" else genpy.Duration(1)
    if kind.startswith("float"):
        return draw.choice([0.0, 1.5, -3e38, float("nan"), float("inf"), draw.gauss(0, 1)])
    return draw.randrange(0, 100)


@pytest.mark.parametrize("seed", [1, 2])
def test_every_type(tmp_path: Path, seed: int) -> None:
    draw = random.Random(seed)
    kinds: List[Any] = list(types())
    assert len(kinds) > 100
    bag, som, ontology = (str(tmp_path / name) for name in ("a.bag", "som.yaml", "ontology.yaml"))
    with BagWriter(Path(bag)) as writer:
        for number, kind in enumerate(kinds):
            for k in range(MESSAGES):
                message = filled(kind._type, draw)
                writer.write(f"/t{number}/{kind.__name__}", message, 1000.0 + 0.1 * k, "/node")
    assert main(["init", "--bag", bag, "--som", som, "--ontology", ontology]) == 0
    assert check_files(ontology, som, message_types) == []
    assert len(read_som(som)) > 60
