"""The command line: find, plot, report; what they print, write and return."""
import json
import os
import pathlib
import re
import subprocess
import sys
from typing import Any, Callable, Dict, List, Optional, Tuple
from xml.etree import ElementTree

import pytest

from shsa_core.cli import _drawing
from shsa_core.cli.main import main
from shsa_core.model.ontology import Ontology, Property
from shsa_core.model.service import Provision, Service

HERE = pathlib.Path(__file__).resolve().parent
MODELS = ["--ontology", str(HERE / "data/boat.yaml"), "--som", str(HERE / "data/boat_som.yaml")]
SHSA = HERE.parents[1] / "scripts/shsa"

Shsa = Callable[..., Tuple[int, str, str]]
Found = Callable[..., Tuple[int, Any]]


@pytest.fixture
def shsa(capsys: Any) -> Shsa:
    """Runs a command; returns its exit status, its output and its errors."""

    def run(*arguments: str) -> Tuple[int, str, str]:
        status = main([arguments[0], *arguments[1:], *MODELS])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run


@pytest.fixture
def found(shsa: Shsa) -> Found:
    """Runs `shsa find --json`; returns its exit status and the document."""

    def run(*arguments: str) -> Tuple[int, Any]:
        status, out, _ = shsa("find", *arguments, "--json")
        return status, json.loads(out)

    return run


def test_find_prints_what_a_program_needs(found: Found) -> None:
    status, answer = found("current")
    assert status == 0
    assert answer == {
        "property": "current",
        "quality": 0.9,
        "relations": ["fit"],
        "proven_best": True,
        "inputs": ["/speed/data"],
        "code": answer["code"],
        "output": "/current/data",
    }
    assert answer["code"].startswith("t0=x[0];\n") and answer["code"].endswith("y=t1\n")


def test_find_does_without_nodes_and_topics(found: Found) -> None:
    for without in ("/log", "/speed"):
        assert found("current", "--without", without)[1]["relations"] == ["fit", "water"]
    status, answer = found("current", "--without", "/log", "--without", "/sonar")
    assert status == 1
    assert answer == {"property": "current", "substitute": None, "missing": ["flow"]}


def test_find_takes_the_node_of_the_property_away(found: Found) -> None:
    status, answer = found("depth")
    assert status == 1 and answer["substitute"] is None
    assert "learned" in answer["refused"]
    assert found("flow")[1] == {"property": "flow", "substitute": None, "missing": []}


def test_find_first_found(found: Found) -> None:
    assert found("voltage", "--method", "best")[1]["relations"] == ["law", "propeller"]
    status, answer = found("voltage", "--method", "orr")
    assert status == 0 and answer["proven_best"] is False


def test_find_all_best_first(found: Found) -> None:
    status, answer = found("current", "--method", "all")
    qualities = [each["quality"] for each in answer["substitutes"]]
    assert status == 0 and answer["complete"]
    assert qualities == sorted(qualities, reverse=True)
    assert [each["relations"] for each in answer["substitutes"]] == [
        ["fit"],
        ["fit", "water"],
        ["law", "propeller"],
        ["law", "propeller", "water"],
    ]
    assert [each["proven_best"] for each in answer["substitutes"]] == [True, False, False, False]
    status, answer = found("current", "--method", "all", "--limit", "2")
    assert len(answer["substitutes"]) == 2 and not answer["complete"]
    status, answer = found("flow", "--method", "all")
    assert status == 1 and answer["substitutes"] == [] and answer["substitute"] is None


def test_find_all_names_what_cannot_be_executed(shsa: Shsa, found: Found) -> None:
    (substitute,) = found("depth", "--method", "all")[1]["substitutes"][:1]
    assert substitute["code"] is None and "learned" in substitute["refused"]
    assert "(cannot be executed)" in shsa("find", "depth", "--method", "all")[1]


def test_find_explains(shsa: Shsa, found: Found) -> None:
    answer = found("current", "--explain")[1]
    assert answer["derivation"] == [
        "current  fit: 3 * speed  (quality 0.9)",
        "  speed  measured by /log at /speed/data  (quality 1)",
    ]
    assert [each["relations"] for each in answer["alternatives"]] == [
        ["fit", "water"],
        ["law", "propeller"],
        ["law", "propeller", "water"],
    ]
    assert {"relation": "law", "output": "power", "lacking": ["current"]} in answer["dead"]
    text = shsa("find", "current", "--explain")[1]
    assert "current: quality 0.9 by fit from /speed/data, proven best" in text
    assert "law for power lacks current" in text
    assert "quality 0.72" not in text and "quality 0.8 by law, propeller" in text


def test_find_says_in_words_that_nothing_replaces(shsa: Shsa) -> None:
    status, out, _ = shsa("find", "flow")
    assert status == 1 and out == "Nothing replaces flow. Missing: any relation that yields flow\n"
    assert "Missing: flow" in shsa("find", "current", "--without", "/log", "--without", "/sonar")[1]
    assert "learned" in shsa("find", "depth")[1]


def test_find_lists_all_in_words(shsa: Shsa) -> None:
    out = shsa("find", "current", "--method", "all", "--limit", "1")[1]
    assert out == "   1. quality 0.9 by fit from /speed/data\nand more; see --limit\n"


def test_wrong_names_are_named(shsa: Shsa) -> None:
    status, _, err = shsa("find", "curent")
    assert status == 2 and "no such property; did you mean current?" in err
    status, _, err = shsa("find", "xyz")
    assert status == 2 and "known are current, depth" in err
    status, _, err = shsa("find", "current", "--without", "/logg")
    assert status == 0 and "no service in the SOM has the node or topic /logg" in err


def test_wrong_calls_have_the_status_2(capsys: Any) -> None:
    for words in ("", "find", "find x", "nothing", "find current --method x"):
        with pytest.raises(SystemExit) as end:
            main(words.split())
        assert end.value.code == 2
    assert main(["find", "x", "--ontology", "/none", "--som", "/none"]) == 2
    assert "/none" in capsys.readouterr().err


def test_find_a_whole_topic(shsa: Shsa, capsys: Any) -> None:
    status, out, _ = shsa("find", "--topic", "/voltage", "--json")
    answer = json.loads(out)
    (service,) = answer["services"]
    assert status == 0 and answer["topic"] == "/voltage"
    assert service["service"] == "voltage" and service["properties"] == ["voltage"]
    assert service["relations"] == ["law", "propeller"] and service["proven_best"]
    assert service["inputs"] == ["/speed/data", "/current/data"]
    assert service["output"] == "/voltage/data" and service["code"].endswith("y=t3\n")
    status, out, _ = shsa("find", "--topic", "/flow")
    assert status == 1 and out.startswith("Nothing replaces the service flow. Missing: any")
    status, _, err = shsa("find", "--topic", "/volts")
    assert status == 2 and "did you mean /voltage?" in err
    assert shsa("find", "--topic", "/flow", "--method", "all")[0] == 2


def test_find_two_services_of_one_topic(tmp_path: pathlib.Path, capsys: Any) -> None:
    som = tmp_path / "som.yaml"
    common = "topic: /joints, type: p/T, period: 1"
    som.write_text(
        "services:\n"
        f"  left: {{{common}, node: /l,\n"
        "    provides: {current: {field: a}, power: {field: b}}}\n"
        f"  right: {{{common}, node: /r, provides: {{voltage: {{field: c}}}}}}\n"
        "  speed: {topic: /log, type: p/T, period: 1, node: /log, provides: {speed: {field: d}}}\n"
    )
    models = ["--ontology", MODELS[1], "--som", str(som)]
    assert main(["find", "--topic", "/joints", "--json", *models]) == 0
    left, right = json.loads(capsys.readouterr().out)["services"]
    assert (left["output"], right["output"]) == ("/joints/a,/joints/b", "/joints/c")
    assert left["relations"] == ["fit", "law"] and right["relations"] == ["law"]


def test_find_a_property_that_nothing_provides(found: Found) -> None:
    status, answer = found("power")
    assert status == 0 and answer["output"] == "/power/data"
    assert answer["relations"] == ["law"]


def test_version_is_that_of_the_package(capsys: Any) -> None:
    with pytest.raises(SystemExit) as end:
        main(["--version"])
    assert end.value.code == 0
    package = ElementTree.parse(str(HERE.parents[1] / "package.xml")).getroot()
    assert capsys.readouterr().out == f"shsa {package.findtext('version')}\n"


def test_a_closed_pipe_is_no_error() -> None:
    run = [sys.executable, str(SHSA), "find", "current", *MODELS]
    read, write = os.pipe()
    os.close(read)
    done = subprocess.run(run, stdout=write, stderr=subprocess.PIPE, universal_newlines=True)
    os.close(write)
    assert done.stderr == "" and done.returncode == 128 + 13


def test_the_shell_is_told_how_a_line_goes_on() -> None:
    line = "shsa find current --exp"
    told = {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_IFS": "\013", "COMP_LINE": line}
    told.update(COMP_POINT=str(len(line)), COMP_TYPE="9", _ARGCOMPLETE_COMP_WORDBREAKS=" ")
    # What argcomplete finds goes to the file descriptor 8.
    command = f"exec {sys.executable} {SHSA} 8>&1 >/dev/null"
    done = subprocess.run(
        ["bash", "-c", command],
        env={**os.environ, **told},
        stdout=subprocess.PIPE,
        universal_newlines=True,
    )
    assert done.stdout.split() == ["--explain"]


def test_the_program_runs_and_has_the_same_status() -> None:
    run = [sys.executable, str(SHSA), "find", "flow", *MODELS]
    done = subprocess.run(run, stdout=subprocess.PIPE, universal_newlines=True)
    assert done.returncode == 1 and "Nothing replaces flow" in done.stdout


def svg_of(text: str, kind: str) -> List[str]:
    """What stands in each group of a kind, `node` or `edge`, of a picture."""
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
        colours = _drawing.COLOURS.items()
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
    text = _drawing.draw(ontology, [source], "svg", title='<&>"').decode()
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
    monkeypatch.setattr(_drawing, "MOST_NODES", 5)
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
    status, _, err = shsa("report", "--size", "0")
    assert status == 2 and "at least 1" in err


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
