"""The command line: plot and report, what they draw, print and write."""
import json
import pathlib
import re
from typing import Any, Callable, Dict, Iterable, List, Optional, Tuple
from xml.etree import ElementTree

import pytest

from shsa_learning.cli import plot
from shsa_core.cli.main import main
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import Provision, Service
from shsa_learning.schedulability import check_placements


DATA = pathlib.Path(__file__).resolve().parents[3] / "shsa_core" / "test" / "unit" / "data"
MODELS = ["--ontology", str(DATA / "boat.yaml"), "--som", str(DATA / "boat_som.yaml")]


EVIL = "\x1b[2J\x1b]0;owned\x07\r\n\u202e\x00\x9b31m"
"""Clears the screen, renames the window, begins a line, turns the direction of the writing."""
Shsa = Callable[..., Tuple[int, str, str]]


@pytest.fixture
def shsa(capsys: Any) -> Shsa:
    """Runs a command; returns its exit status, its output and its errors."""

    def run(*arguments: str) -> Tuple[int, str, str]:
        status = main([arguments[0], *arguments[1:], *MODELS])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run


def svg_of(text: str, kind: str) -> List[str]:
    """Return the groups of a kind, `node` or `edge`, of a picture."""
    groups = ElementTree.fromstring(text).iter("{http://www.w3.org/2000/svg}g")
    return [
        ElementTree.tostring(group, encoding="unicode")
        for group in groups
        if group.get("class") == kind
    ]


def test_plot_draws_every_property_and_the_substitution_in_bold(
    shsa: Shsa, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / "boat.svg"
    assert shsa("plot", "current", "--without", "/voltmeter", "--output", str(path))[0] == 0
    text = path.read_text()
    for word in ("current is lost; its substitute has the quality 0.9", "propeller", "/speed/data"):
        assert word in text
    edges = svg_of(text, "edge")
    assert all("polygon" in edge for edge in edges)  # an arrowhead
    bold = [edge for edge in edges if 'stroke-width="2.5"' in edge]
    assert len(edges) == 17 and len(bold) == 2
    assert any("p speed-&gt;r fit current" in edge for edge in bold)
    plain = tmp_path / "plain.svg"
    shsa("plot", "--output", str(plain))
    assert 'stroke-width="2.5"' not in plain.read_text()
    again = tmp_path / "again.svg"
    shsa("plot", "--output", str(again))
    assert again.read_text() == plain.read_text()


def test_plot_colours_what_is_provided_derivable_and_lost(
    shsa: Shsa, tmp_path: pathlib.Path
) -> None:
    path = tmp_path / "boat.svg"

    def boxes() -> Dict[str, int]:
        nodes = svg_of(path.read_text(), "node")
        colours = plot.COLOURS.items()
        return {name: sum(colour in node for node in nodes) for name, colour in colours}

    shsa("plot", "--output", str(path))
    assert boxes() == {"provided": 5, "derivable": 1, "lost": 0}
    status, _, err = shsa("plot", "flow", "--output", str(path))
    assert status == 1 and "no substitute for flow" in err
    assert boxes()["lost"] == 1
    assert "nothing replaces it" in path.read_text()


def test_plot_escapes_what_a_file_says(tmp_path: pathlib.Path) -> None:
    source = Service("s", "/t", "p/T", "/n", 1.0, (Provision("a", 'x[0]<b>&"\\'),)).sources[0]
    ontology = Ontology({"a": Property("a")}, {}, ())
    text = plot.draw(ontology, [source], "svg", title='<&>"').decode()
    words = " ".join(ElementTree.fromstring(text).itertext())
    assert '/t/x[0]<b>&"\\' in words and '<&>"' in words


def test_plot_writes_png_and_refuses_other_formats(shsa: Shsa, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "boat.png"
    assert shsa("plot", "--output", str(path))[0] == 0
    assert path.read_bytes().startswith(b"\x89PNG")
    assert shsa("plot", "--output", str(path))[1] == f"{path}\n"
    status, _, err = shsa("plot", "--output", "boat.jpg")
    assert status == 2 and "does not end in .svg or .png" in err


@pytest.mark.parametrize(
    "program, said",
    [(None, "needs the program 'dot'; install graphviz"), ("echo no >&2; exit 1", "dot says: no")],
    ids=["missing", "failing"],
)
def test_plot_says_why_it_cannot_draw(
    shsa: Shsa, tmp_path: pathlib.Path, monkeypatch: Any, program: Optional[str], said: str
) -> None:
    if program is not None:
        (tmp_path / "dot").write_text(f"#!/bin/sh\n{program}\n")
        (tmp_path / "dot").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    status, _, err = shsa("plot", "--output", str(tmp_path / "boat.svg"))
    assert status == 2 and said in err
    assert not (tmp_path / "boat.svg").exists()


def test_what_is_too_large_is_not_drawn(
    shsa: Shsa, tmp_path: pathlib.Path, monkeypatch: Any
) -> None:
    monkeypatch.setattr(plot, "MOST_NODES", 5)
    status, _, err = shsa("plot", "--output", str(tmp_path / "boat.svg"))
    assert status == 2 and "at most 5" in err
    path = tmp_path / "boat.html"
    assert shsa("report", "--html", str(path))[0] == 0
    assert "Not drawn" in path.read_text()


def test_report_as_a_table(shsa: Shsa) -> None:
    status, out, _ = shsa("report")
    assert status == 0
    for words in ("by fit (0.9)", "Nodes that must not fail together", "No node alone is fatal"):
        assert words in out
    assert "2 of 2 needed services can be replaced" in out
    assert max(map(len, out.splitlines())) <= 100


def test_report_as_json(shsa: Shsa) -> None:
    status, out, _ = shsa("report", "--json", "--size", "3")
    report = json.loads(out)
    assert status == 0
    assert [service["topic"] for service in report["services"]] == ["/current", "/voltage"]
    assert report["cuts"] == [
        {"nodes": ["/amperemeter", "/log", "/sonar"], "services": ["current"]},
        {"nodes": ["/log", "/sonar", "/voltmeter"], "services": ["voltage"]},
    ]
    assert report["survival"] == {"single": 1.0, "double": 1.0}


@pytest.mark.parametrize("words", [["plot", "--output"], ["report", "--html"]])
def test_a_folder_that_is_not_there_is_told_as_elsewhere(shsa: Shsa, words: List[str]) -> None:
    status, _, err = shsa(*words, "/nothere/x.svg")
    assert (status, err) == (2, "shsa: /nothere/x.svg: No such file or directory\n")


def test_report_as_one_page_with_the_graph(shsa: Shsa, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "boat.html"
    assert shsa("report", "--html", str(path))[0] == 0
    text = path.read_text()
    assert text.count("<svg") == 1 and "propeller" in text
    assert not re.search(r"(src|href)\s*=\s*.(https?:)?//", text)
    assert "<script" not in text and "by fit (0.9)" in text


@pytest.mark.parametrize("size", ["-1", "0", "x", "9" * 99])
def test_report_refuses_a_size_that_is_none(shsa: Shsa, size: str, capsys: Any) -> None:
    with pytest.raises(SystemExit) as caught:
        shsa("report", "--size", size)
    assert caught.value.code == 2 and "is no whole number from" in capsys.readouterr().err


def test_report_names_what_is_fatal_and_what_would_help(
    capsys: Any, tmp_path: pathlib.Path
) -> None:
    som = tmp_path / "som.yaml"
    som.write_text(
        "services:\n"
        "  power: {topic: /power, type: std_msgs/Float64, node: /meter, period: 1, needed: true,\n"
        "    provides: {power: {field: data}}}\n"
        "  voltage: {topic: /voltage, type: std_msgs/Float64, node: /volts, period: 1,\n"
        "    provides: {voltage: {field: data}}}\n"
    )
    assert main(["report", "--ontology", MODELS[1], "--som", str(som)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "0 of 1 needed services can be replaced" in out
    assert "missing: flow" in out
    assert "Single points of failure" in out and "| /meter | power |" in out
    assert "Failures of one node survived: 50.0 %; of two nodes at once: 0.0 %." in out
    assert "new sensor that would raise it most: one of power on a node of its own" in out
    assert "one that yields power from voltage, if there is one, to 100.0 % and 0.0 %." in out


SERVICE = (
    "  {0}: {{topic: /{0}, type: std_msgs/Float64, period: 0.1, node: /{0}, needed: {2}, "
    "host: {3}, provides: {{{1}}}}}\n"
)
Robot = Callable[[str, Iterable[Tuple[str, str, str, str]]], List[str]]


@pytest.fixture
def robot(tmp_path: pathlib.Path) -> Robot:
    """Writes an ontology and a SOM of (service, provided, needed, host); returns the options."""

    def write(ontology: str, services: Iterable[Tuple[str, str, str, str]]) -> List[str]:
        text = "services:\n" + "".join(SERVICE.format(*each) for each in services)
        (tmp_path / "o.yaml").write_text(ontology)
        (tmp_path / "s.yaml").write_text(text + "hosts: {pi: {cores: 0.001}, board: {}}\n")
        return ["--ontology", str(tmp_path / "o.yaml"), "--som", str(tmp_path / "s.yaml")]

    return write


def test_report_says_what_is_lost_refused_and_has_no_room(robot: Robot, capsys: Any) -> None:
    models = robot(
        "properties: {speed: , turn: , wheel: , heading: , tilt: }\n"
        "relations:\n  rolling: {speed: 2*wheel}\n"
        '  learned: {heading: {not_executable: "network(tilt)", inputs: [tilt]}}\n',
        [
            ("odom", "speed: {field: v}, turn: {field: w}", "true", "board"),
            ("drive", "speed: {field: v}", "true", "board"),
            ("compass", "heading: {field: data}", "true", "board"),
            ("wheel", "wheel: {field: data}", "false", "pi"),
            ("tilt", "tilt: {field: data}", "false", "pi"),
        ],
    )
    assert main(["report", "--json", *models]) == 0
    report = json.loads(capsys.readouterr().out)
    lost = {each["service"]: each["refused"] for each in report["services"] if not each["quality"]}
    said = "the relation learned for heading cannot be executed: network(tilt)"
    assert lost == {"odom": "", "compass": said}
    ontology, som = read_ontology(models[1]), read_som(models[3])
    assert report["unfit"] == [each.what for each in check_placements(ontology, som)] != []
    assert main(["report", *models]) == 0
    assert "cannot be executed" in " ".join(capsys.readouterr().out.split())


def test_report_and_plot_follow_the_choice_by_errors(
    robot: Robot, capsys: Any, tmp_path: pathlib.Path
) -> None:
    models = robot(
        "properties: {y: {unit: A, usual: [0, 5]}, w: {usual: [0, 1]}, x: {usual: [0, 1]}, z: }\n"
        "relations:\n  high:\n    y: {function: 2*z, quality: 0.9, error: {rms: 0.5, p95: 0.8}}\n"
        "  low:\n    y: {function: 3*x, quality: 0.5, error: 0.2}\n  share:\n    w: 2*x\n",
        [
            ("odom", "y: {field: y}, w: {field: w}", "true", "board"),
            ("z", "z: {field: d}", "false", "board"),
            ("x", "x: {field: d, error: {rms: 0.05, bias: 0.03}}", "false", "board"),
        ],
    )
    assert main(["report", "--json", *models]) == 0
    (service,) = json.loads(capsys.readouterr().out)["services"]
    assert service["reads"][0] == "/x"
    assert [error["rms"] for error in service["errors"]] == pytest.approx([0.2, 0.1])
    by = [(each["by"], each["error"]["rms"]) for each in service["alternatives"]]
    assert by[:2] == [("low", 0.2), ("high", 0.5)]
    assert main(["report", *models]) == 0
    text = " ".join(capsys.readouterr().out.split())
    assert "y, error 0.2" in text and "y by low (0.5, error 0.2)" in text
    assert main(["plot", "y", "--output", str(tmp_path / "picture.svg"), *models]) == 0
    assert (tmp_path / "picture.svg").stat().st_size > 1000


def test_what_a_file_wants_to_do_to_the_terminal_is_printed_plainly(
    robot: Robot, capsys: Any, tmp_path: pathlib.Path
) -> None:
    page, evil = tmp_path / "page.html", json.dumps(EVIL)
    models = robot(
        f"properties:\n  a: {{symbol: {evil}}}\n  b:\n"
        f"relations:\n  r: {{a: {{not_executable: {evil}, inputs: [b]}}}}\n",
        [(name, f"{name}: {{field: data}}", "true", "board") for name in "ab"],
    )
    assert main(["report", "--html", str(page), *models]) == 0
    assert main(["import", models[3], "--ontology", str(tmp_path / EVIL[:3])]) == 2
    printed = "".join(capsys.readouterr()) + page.read_text("utf-8")
    printed += plot.dot_text(read_ontology(models[1]), [], title=EVIL)
    assert "owned" in printed
    assert all(line.isprintable() for line in printed.split("\n"))
