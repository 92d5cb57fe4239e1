"""`shsa add`: services lie beside the SOM, are checked with it, changed and taken away."""
from pathlib import Path
from typing import Any, List

import pytest

from shsa_core.cli.main import main
from shsa_core.errors import ModelError
from shsa_core.files.som_file import added_path, read_som

ONTOLOGY = "properties: {v: , w: }\n"
ENTRY = """\
  {0}:
    {{topic: /{0}, type: std_msgs/Float64, node: /n, period: {1}, provides: {{{2}}}}}
"""
SOM = "# mine\nservices:\n" + ENTRY.format("v", 0.1, "v: {field: data}")


@pytest.fixture
def som(tmp_path: Path) -> Path:
    (tmp_path / "o.yaml").write_text(ONTOLOGY)
    (tmp_path / "som.yaml").write_text(SOM)
    return tmp_path / "som.yaml"


def run(som: Path, text: str = "", *words: str) -> int:
    file: List[str] = []
    if text:
        (som.parent / "more.yaml").write_text("services:\n" + text)
        file = [str(som.parent / "more.yaml")]
    ontology = str(som.parent / "o.yaml")
    return main(["add", *file, "--som", str(som), "--ontology", ontology, *words])


def periods(som: Path) -> Any:
    return {each.name: each.period for each in read_som(str(som))}


def test_a_service_is_added_changed_and_taken_away(som: Path) -> None:
    assert run(som, ENTRY.format("w", 0.2, "w: {field: data}")) == 0
    assert periods(som) == {"v": 0.1, "w": 0.2}
    assert run(som, ENTRY.format("w", 0.3, "w: {field: data}")) == 0
    assert periods(som) == {"v": 0.1, "w": 0.3} and som.read_text() == SOM
    assert run(som, "", "--remove", "w") == 0
    assert periods(som) == {"v": 0.1} and not Path(added_path(str(som))).exists()
    assert run(som, "", "--remove", "w") == 2


@pytest.mark.parametrize(
    "text, status",
    [
        (ENTRY.format("v", 0.2, "v: {field: data}"), 1),  # in the SOM already
        (ENTRY.format("w", -1, "w: {field: data}"), 2),
        (ENTRY.format("w", 0.2, "w: {field: nothing}"), 1),
        (ENTRY.format("u", 0.2, "w: {field: data}").replace("/u", "/v"), 1),  # its topic as well
    ],
)
def test_what_is_not_valid_is_not_kept(som: Path, text: str, status: int) -> None:
    assert run(som, ENTRY.format("x", 0.2, "w: {field: data}")) == 0
    assert run(som, text) == status
    assert periods(som) == {"v": 0.1, "x": 0.2}


def test_what_others_could_have_added_is_refused(som: Path) -> None:
    assert run(som, ENTRY.format("w", 0.2, "w: {field: data}")) == 0
    Path(added_path(str(som))).chmod(0o666)
    with pytest.raises(ModelError, match="everybody can write"):
        read_som(str(som))
