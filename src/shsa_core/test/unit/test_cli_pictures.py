"""The command line: plot and report, what they draw and write."""
import json
import pathlib
import re
from typing import Any, Callable, Dict, List, Optional, Tuple
from xml.etree import ElementTree

import pytest

from shsa_core.cli import plot
from shsa_core.cli.main import main
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import Provision, Service


HERE = pathlib.Path(__file__).resolve().parent
MODELS = ["--ontology", str(HERE / "data/boat.yaml"), "--som", str(HERE / "data/boat_som.yaml")]


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


def test_report_as_one_page_with_the_graph(shsa: Shsa, tmp_path: pathlib.Path) -> None:
    path = tmp_path / "boat.html"
    assert shsa("report", "--html", str(path))[0] == 0
    text = path.read_text()
    assert text.count("<svg") == 1 and "propeller" in text
    assert not re.search(r"(src|href)\s*=\s*.(https?:)?//", text)
    assert "<script" not in text and "by fit (0.9)" in text


def test_report_refuses_a_size_below_one(shsa: Shsa) -> None:
    with pytest.raises(SystemExit) as caught:
        shsa("report", "--size", "0")
    assert caught.value.code == 2


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
