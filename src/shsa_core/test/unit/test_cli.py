"""The command line: find and check; what they print and return."""
import json
import os
import pathlib
import re
import subprocess
import sys
from typing import Any, Callable, List, Tuple
from xml.etree import ElementTree

import pytest

from shsa_core.cli.main import ELSEWHERE, main

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


def test_maintenance_is_a_file_of_our_own(tmp_path: Any, monkeypatch: Any, capsys: Any) -> None:
    pytest.importorskip("rospy")
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    monkeypatch.setenv("ROS_MASTER_URI", "http://localhost:1")
    for word, told in (("", "off"), ("on", "on"), ("", "on"), ("off", "off"), ("", "off")):
        assert main(["maintenance", word] if word else ["maintenance"]) == (told == "on")
        assert f"; maintenance is {told} once" in capsys.readouterr().err
    main(["maintenance", "on", "--namespace", "/other"])
    assert main(["maintenance"]) == 0 and "maintenance is off once" in capsys.readouterr().err
    (made,) = (tmp_path / "shsa").iterdir()
    made.chmod(0o666)
    assert main(["maintenance", "--namespace", "other"]) == 0
    assert "maintenance is off once" in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(["maintenance", "--namespace", "a b"])
    assert "'a b' is no namespace, as /robot1" in capsys.readouterr().err


def test_ctrl_c_while_a_command_is_loaded_is_no_traceback(monkeypatch: Any) -> None:
    def interrupted(name: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("importlib.import_module", interrupted)
    assert main(["init"]) == 130


@pytest.fixture
def found(shsa: Shsa) -> Found:
    """Runs `shsa find --json`; returns its exit status and the document."""

    def run(*arguments: str) -> Tuple[int, Any]:
        status, out, _ = shsa("find", *arguments, "--json")
        return status, json.loads(out)

    return run


def test_a_command_of_a_package_that_is_not_installed_says_so(
    monkeypatch: Any, capsys: Any
) -> None:
    monkeypatch.setitem(ELSEWHERE, "nothing", "no_such_package")
    assert main(["nothing", "/odom", "stuck", "--for", "5s"]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "needs the package no_such_package" in said


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
        "error": None,
    }
    assert answer["code"].startswith("t0=x[0];\n") and answer["code"].endswith("y=t1\n")


def test_find_does_without_nodes_and_topics(found: Found) -> None:
    for without in ("/log", "/speed"):
        assert found("current", "--without", without)[1]["relations"] == ["fit", "water"]
    status, answer = found("current", "--without", "/log", "--without", "/sonar")
    assert status == 1
    assert answer == {"property": "current", "substitute": None, "missing": ["flow"]}


def test_relative_names_are_in_the_namespace_that_is_given(
    tmp_path: pathlib.Path, capsys: Any
) -> None:
    som = tmp_path / "som.yaml"
    text = (HERE / "data/boat_som.yaml").read_text()
    som.write_text(re.sub(r"(topic|node): /", r"\1: ", text))
    models = ["--ontology", MODELS[1], "--som", str(som)]
    namespaces: List[Tuple[List[str], str]] = [([], ""), (["--namespace", "/boat1"], "/boat1")]
    for options, root in namespaces:
        for question in (["current"], ["--topic", "current"]):
            assert main(["find", *question, *models, *options, "--json"]) == 0
            answer = json.loads(capsys.readouterr().out)
            answer = answer.get("services", [answer])[0]
            assert answer["inputs"] == [f"{root}/speed/data"]
            assert answer["output"] == f"{root}/current/data"
        for without in ("log", f"{root}/log"):
            main(["find", "current", "--without", without, *models, *options, "--json"])
            assert json.loads(capsys.readouterr().out)["relations"] == ["fit", "water"]


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
    assert answer["more_alternatives"] == 0
    text = shsa("find", "current", "--explain")[1]
    assert "current: quality 0.9 by fit from /speed/data, proven best" in text
    assert "law for power lacks current" in text
    assert "quality 0.72" not in text and "quality 0.8 by law, propeller" in text


def test_find_says_in_words_that_nothing_replaces(shsa: Shsa) -> None:
    status, out, _ = shsa("find", "flow")
    assert status == 1 and out == "Nothing replaces flow. Missing: any relation that yields flow\n"
    assert "Missing: flow" in shsa("find", "current", "--without", "/log", "--without", "/sonar")[1]
    assert "learned" in shsa("find", "depth")[1]


def test_find_lists_all_in_words(shsa: Shsa, monkeypatch: Any) -> None:
    monkeypatch.setattr("shsa_learning.cli._answers.MOST", 1)
    out = shsa("find", "current", "--method", "all")[1]
    assert out == "   1. quality 0.9 by fit from /speed/data\nand more\n"
    out = shsa("find", "current", "--method", "all", "--json")[1]
    assert len(json.loads(out)["substitutes"]) == 1 and not json.loads(out)["complete"]


def test_wrong_names_are_named(shsa: Shsa) -> None:
    status, _, err = shsa("find", "curent")
    assert status == 2 and "no such property, service, topic or node; did you mean current" in err
    status, _, err = shsa("find", "xyz")
    assert status == 2 and "known are /" in err
    status, _, err = shsa("find", "current", "--without", "/logg")
    assert status == 2 and "no service in the SOM has the node or topic /logg" in err


def test_wrong_calls_have_the_status_2(capsys: Any) -> None:
    steps = [f"find current --ontology o --som s --steps {number}" for number in ("0", "-1", "x")]
    for words in ("", "find", "find x", "nothing", "find current --method x", *steps):
        with pytest.raises(SystemExit) as end:
            main(words.split())
        assert end.value.code == 2
    assert main(["find", "x", "--ontology", "/none", "--som", "/none"]) == 2
    assert "/none" in capsys.readouterr().err


def test_find_a_whole_topic(shsa: Shsa, capsys: Any) -> None:
    status, out, _ = shsa("find", "/voltage", "--json")
    answer = json.loads(out)
    (service,) = answer["services"]
    assert status == 0 and answer["topic"] == "/voltage"
    assert service["service"] == "voltage" and service["properties"] == ["voltage"]
    assert service["relations"] == ["law", "propeller"] and service["proven_best"]
    assert service["inputs"] == ["/speed/data", "/current/data"]
    assert service["output"] == "/voltage/data" and service["code"].endswith("y=t3\n")
    status, out, _ = shsa("find", "/flow")
    assert status == 1 and out.startswith("Nothing replaces the service flow. Missing: any")
    for words in (["/volts"], ["--topic", "/volts"]):
        status, _, err = shsa("find", *words)
        assert status == 2 and "did you mean /voltage" in err
    status, _, err = shsa("find", "/flow", "--method", "all")
    assert status == 2 and "--method all needs a property, and /flow is a topic; it has flow" in err
    status, _, err = shsa("find", "--topic", "/voltage", "--explain")
    assert status == 2 and "--explain needs a property, and /voltage is a topic" in err


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
    assert main(["find", "/joints", "--json", *models]) == 0
    left, right = json.loads(capsys.readouterr().out)["services"]
    assert (left["output"], right["output"]) == ("/joints/a,/joints/b", "/joints/c")
    assert left["relations"] == ["fit", "law"] and right["relations"] == ["law"]


def test_find_a_property_that_nothing_provides(found: Found) -> None:
    status, answer = found("power")
    assert status == 0 and answer["output"] == "/power/data"
    assert answer["relations"] == ["law"]


CART = """\
properties: {speed: , turn: , wheel: , heading: , tilt: }
relations:
  rolling: {speed: 2*wheel}
  learned: {heading: {not_executable: "network(tilt)", inputs: [tilt]}}
"""
CART_SOM = """\
services:
  odometry: {topic: /odom, type: p/T, node: /drive, period: 0.1, needed: true,
             provides: {speed: {field: v}, turn: {field: w}}}
  compass: {topic: /heading, type: p/T, node: /compass, period: 0.1, needed: true,
            provides: {heading: {field: data}}}
  wheel: {topic: /wheel, type: p/T, node: /encoder, period: 1.0, provides: {wheel: {field: data}}}
  tilt: {topic: /tilt, type: p/T, node: /imu, period: 0.1, provides: {tilt: {field: data}}}
"""
GYRO = "  gyro: {topic: /gyro, type: p/T, node: /imu, period: 0.1, provides: {turn: {field: z}}}\n"
SPARE = (
    "  spare: {topic: /spare, type: p/T, node: /s, period: 0.1, needed: true,\n"
    "          provides: {speed: {field: v}, tilt: {field: w}}}\n"
)


@pytest.fixture
def cart(tmp_path: pathlib.Path, capsys: Any) -> Callable[..., Tuple[int, str]]:
    """Runs a command on a cart with more services; returns its exit status and what it prints."""

    def run(more: str, command: str, *words: str) -> Tuple[int, str]:
        ontology, som = str(tmp_path / "cart.yaml"), str(tmp_path / "cart_som.yaml")
        (tmp_path / "cart.yaml").write_text(CART)
        (tmp_path / "cart_som.yaml").write_text(CART_SOM + more)
        models = [ontology] if command == "check" else ["--ontology", ontology]
        status = main([command, *words, *models, "--som", som])
        return status, capsys.readouterr().out

    return run


def test_all_commands_say_that_a_topic_is_lost_with_one_of_its_values(cart: Any) -> None:
    for words in (["speed"], ["/odom"], ["--topic", "odom"], ["odometry"], ["/drive"]):
        status, out = cart("", "find", *words)
        assert status == 1 and "Nothing replaces the service odometry. Missing: any" in out
        assert "any relation that yields the service" not in out
        assert words == ["speed"] or "In the way: turn; the other values can be derived" in out
    status, out = cart("", "find", "speed")
    assert "speed alone could be derived: quality 1 by rolling from /wheel/data" in out
    answer = json.loads(cart("", "find", "speed", "--json")[1])
    assert answer["property"] == "speed" and answer["substitute"] is None
    assert answer["missing"] == [] and answer["alone"]["relations"] == ["rolling"]
    said = "odometry is needed, but if /drive fails there is no substitute for speed, turn: turn "
    assert said in cart("", "check")[1]


BATTERY = """\
  battery: {topic: /b, type: sensor_msgs/BatteryState, node: /bms, period: 0.1, needed: true,
            provides: {speed: {field: current}, turn: {field: temperature}}}
"""


def test_find_says_what_a_message_leaves_unknown(cart: Any) -> None:
    for words in (["--topic", "/b"], ["battery"]):
        status, out = cart(BATTERY, "find", *words, "--without", "/drive")
        assert status == 0 and "output  /b/current\n" in out
        assert "Its messages leave turn unknown. Missing: any relation that yields it" in out
    words = ["battery", "--without", "/drive", "--json"]
    answer = json.loads(cart(BATTERY, "find", *words)[1])
    assert (answer["unknown"], answer["missing"]) == (["turn"], [])
    status, out = cart(BATTERY, "find", "turn", "--without", "/drive", "--without", "/bms")
    assert status == 1 and "Nothing replaces turn" in out
    status, out = cart(BATTERY.replace("temperature", "capacity"), "find", "--topic", "/b")
    assert status == 0  # the drive tells how it turns
    out = cart(BATTERY.replace("temperature", "capacity"), "find", *words[:-1])[1]
    assert "In the way: turn; the other values can be derived" in out


def test_all_commands_say_that_the_only_law_cannot_be_executed(cart: Any) -> None:
    said = "the relation learned for heading cannot be executed: network(tilt)"
    assert said in cart("", "check")[1] and said in cart("", "find", "heading")[1]


def test_a_property_is_healed_with_its_service(cart: Any) -> None:
    status, out = cart(GYRO, "find", "speed")
    assert status == 0 and "speed: quality 1 by rolling from /wheel/data, proven best" in out
    assert "odometry (/odom) is healed with /odom/v,/odom/w: quality 1" in out
    answer = json.loads(cart(GYRO, "find", "speed", "--json")[1])
    assert answer["relations"] == ["rolling"] and answer["output"] == "/odom/v"
    (whole,) = answer["services"]
    assert whole["service"] == "odometry" and whole["output"] == "/odom/v,/odom/w"
    assert answer["slow"] == {"service": "wheel", "period": 1.0}
    assert "It reads wheel, which comes every 1 s" in out
    assert "its substitute reads wheel, which comes every 1 s" in cart(GYRO, "check")[1]


def test_two_needed_services_of_a_property_are_two_answers(cart: Any) -> None:
    status, out = cart(GYRO + SPARE, "find", "speed")
    assert status == 0 and "If the service odometry of /drive fails:" in out
    assert "If the service spare of /s fails:" in out
    answer = json.loads(cart(GYRO + SPARE, "find", "speed", "--json")[1])
    values = [whole["value"]["inputs"] for whole in answer["services"]]
    assert values == [["/spare/v"], ["/odom/v"]] and answer["inputs"] == ["/spare/v"]
    status, out = cart(SPARE, "find", "speed", "--json")
    assert status == 1 and json.loads(out)["substitute"] is None
    services = json.loads(out)["services"]
    assert ["substitute" in service for service in services] == [True, False]


def test_find_says_what_shares_a_cause(cart: Any, tmp_path: pathlib.Path) -> None:
    hub = "  fast: {topic: /fast, type: p/T, node: /f, period: 0.1, needed: true,\n"
    hub += "         fails_with: [hub], provides: {wheel: {field: v}}}\n"
    other = hub.replace("fast", "slow").replace("/f,", "/s,")
    answer = json.loads(cart(hub + other, "find", "fast", "--json")[1])
    assert answer["inputs"] == ["/wheel/data"] and "shares" not in answer
    words = ["--without", "/encoder", "--json"]
    answer = json.loads(cart(hub + other, "find", "fast", *words)[1])
    assert answer["inputs"] == ["/slow/v"] and answer["shares"] == ["hub"]
    status, out = cart(hub + other, "find", "speed", "--without", "/drive", "--without", "hub")
    assert "/wheel/data" in out and status == 1


def test_find_says_what_is_on_the_same_host(cart: Any) -> None:
    fast = "  fast: {topic: /fast, type: p/T, node: /f, period: 0.1, needed: true,\n"
    fast += "         host: pi, provides: {wheel: {field: v}}}\n"
    two = fast + fast.replace("fast", "slow").replace("/f,", "/s,") + "hosts: {pi: {}, board: {}}\n"
    answer = json.loads(cart(two, "find", "fast", "--json")[1])
    assert answer["inputs"] == ["/wheel/data"] and "shares" not in answer
    status, out = cart(two, "find", "fast", "--without", "/encoder")
    assert "It reads what fails with pi too; nothing else would do" in out
    assert json.loads(cart(two, "find", "wheel", "--without", "/encoder", "--json")[1])["inputs"]
    status, out = cart(two, "find", "fast", "--without", "/encoder", "--without", "pi")
    assert status == 1


@pytest.mark.parametrize("law, told", [("2*integral(v)", True), ("integral(v)", False)])
def test_find_says_what_starts_at_zero(
    tmp_path: pathlib.Path, capsys: Any, law: str, told: bool
) -> None:
    ontology, som = tmp_path / "ontology.yaml", tmp_path / "som.yaml"
    ontology.write_text(f"properties: {{x: , v: }}\nrelations: {{r: {{x: {law}}}}}\n")
    som.write_text(
        "services: {s: {topic: /v, type: p/T, node: /n, period: 0.1, provides: {v: {field: v}}}}\n"
    )
    models = ["--ontology", str(ontology), "--som", str(som)]
    assert main(["find", "x", *models]) == 0
    assert ("starts at 0" in capsys.readouterr().out) is told
    assert main(["find", "x", "--json", *models]) == 0
    assert ("starts_at_zero" in json.loads(capsys.readouterr().out)) is told


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
