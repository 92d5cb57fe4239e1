"""Data from the graph is checked before it counts: types, numbers, names, settings."""
import ast
import dataclasses
import json
import math
import os
import pathlib
import re
import subprocess
import sys
from importlib.util import find_spec
from typing import Any, Dict, List

import audit
import pytest
from monitor_bench import NODE, PERIOD, TOPIC, Bench, provision, service

from shsa_core import message_types
from shsa_core.codegen.checked_code import check_code
from shsa_core.errors import CodeError, ShsaError
from shsa_core.files.parameters import HIGHEST, names_of, read_settings
from shsa_core.files.som_file import merge_parameters, som_parameters
from shsa_core.model.names import Names
from shsa_core.healing.settings import Settings
from shsa_core.model.checks import REGISTRY, Checks, Formula
from shsa_core.model.samples import ValueSample
from shsa_core.model.error import Error
from shsa_core.model.service import Signal
from shsa_core.model.som import Som
from shsa_core.monitoring.events import Message, Tick
from shsa_core.monitoring.settings import Settings as MonitorSettings
from shsa_core.substitution import signals

needs_ros = pytest.mark.skipif(find_spec("genpy") is None, reason="there is no ROS here")

NO_TYPES = [
    "unittest.__main__/x",
    "unittest/main",
    "this/Zen",
    "os/path",
    "os.path/join",
    "../../etc/Passwd",
    "std_msgs",
    "std_msgs/",
    "/Float64",
    "std_msgs/Float64/x",
    "std_msgs/_Float64",
    "std_msgs/Float64\n",
    "std_msgs/Float64\0",
    "std_msgs/sys",
    "std_msgs.msg/Float64",
    "genpy/Message",
    "shsa_core/errors",
    "é/ü",
    "a" * 200 + "/B",
    "",
    "*",
]


@needs_ros
@pytest.mark.parametrize("name", NO_TYPES)
def test_a_name_that_is_no_message_type_has_nothing_loaded(name: str) -> None:
    message_types.message_class("std_msgs/Float64")
    before = set(sys.modules)
    with audit.recorded() as events:
        for look in (message_types.message_class, message_types.layout):
            with pytest.raises(ShsaError, match="message type"):
                look(name)
    assert set(sys.modules) == before
    assert not {"exec", "subprocess.Popen", "os.system", "compile"} & set(events)


@needs_ros
def test_what_a_generated_name_stands_for_must_be_a_message(
    tmp_path: pathlib.Path, monkeypatch: Any
) -> None:
    generated = tmp_path / "odd_msgs" / "msg"
    generated.mkdir(parents=True)
    for name in ("Function", "Text", "Foreign", "Missing"):
        (generated / f"_{name}.py").write_text("")
    (generated / "__init__.py").write_text(
        "from std_msgs.msg import Float64 as Foreign\nText = 'x'\ndef Function(): exit(3)\n"
    )
    monkeypatch.syspath_prepend(str(tmp_path))
    for name in ("Function", "Text", "Foreign", "Missing"):
        with pytest.raises(ShsaError, match=f"odd_msgs/{name} cannot be loaded"):
            message_types.message_class(f"odd_msgs/{name}")


@needs_ros
def test_nothing_is_loaded_for_a_publisher_that_names_another_type() -> None:
    from shsa_core.ros.messages.fields import Decoder

    for name in NO_TYPES:
        with pytest.raises(ShsaError, match="and not std_msgs/Float64") as caught:
            Decoder("std_msgs/Float64", {"type": name, "md5sum": "*"}, ["data"])
        assert str(caught.value).isprintable()


@pytest.mark.parametrize(
    "node",
    [
        "/substitute_x_²",
        "/substitute_x_" + "5" * 5000,
        "/substitute_x_٣",
        "/substitute_x_-1",
        "/substitute_x_1\n",
        "/substitute_x_1_",
        "/substitute__1",
        "/substitute_",
        "/substitute_\x1b_1",
        "",
    ],
)
def test_a_name_like_a_substitutes_takes_no_number(node: str) -> None:
    names = Names("/")
    assert names.avoid(node) is False and names.fresh("x") == "/substitute_x_1"


@pytest.mark.parametrize("kind", [Settings, MonitorSettings])
@pytest.mark.parametrize("value", [1e308, -1, 1e6 + 1, math.nan, math.inf, "x", [], {}, b"\0"])
def test_a_setting_that_cannot_be_is_refused_and_the_default_counts(kind: Any, value: Any) -> None:
    parameters = dict.fromkeys(names_of(kind), value)
    read, errors = read_settings(kind, parameters, "/node")
    assert read == kind() and len(errors) == len(parameters)
    assert all(error.where.startswith("/node/") for error in errors)


@pytest.mark.parametrize("parameters", [5, "text", [], b"\0", None, True])
def test_settings_that_are_no_mapping_are_refused(parameters: object) -> None:
    read, errors = read_settings(Settings, parameters, "/reconfigurator")
    assert read == Settings() and "must be a mapping" in str(errors[0])


def test_nobody_can_ask_for_any_number_of_processes() -> None:
    read, errors = read_settings(Settings, {"pool": 101, "hold_off": HIGHEST}, "/reconfigurator")
    assert (read.pool, read.hold_off) == (
        2,
        HIGHEST,
    ) and "pool must be a whole number from 0 to 100" in str(errors[0])


GOOD = Signal("/a", "data", "std_msgs/Float64", "/n", 0.1, 0.5)
EXTREMES = [5e-324, 1e308, -1.0, 0.0, math.nan, math.inf, -math.inf]


@pytest.mark.parametrize("key", ["period", "deadline", "rms", "p95"])
@pytest.mark.parametrize("number", EXTREMES)
def test_a_signal_with_numbers_that_cannot_be_is_refused(key: str, number: float) -> None:
    errors = {"rms": Error(number), "p95": Error(1.0, p95=number)}
    change: Dict[str, Any] = {key: number}
    if key in errors:
        change = {"error": errors[key]}
    signal = dataclasses.replace(GOOD, **change)
    if key in errors and 0.0 <= number < math.inf:
        assert signals.checked(signal) is signal
        assert signals.decode(signals.encode([], [signal])) == ((), (signal,))
        return
    with pytest.raises(ShsaError, match="error" if key in errors else key):
        signals.checked(signal)
    with pytest.raises(ShsaError, match="holds no signals"):
        signals.decode(signals.encode([signal], [GOOD]))


@needs_ros
def test_a_row_with_such_a_signal_is_refused() -> None:
    from shsa_core.ros.wire.rows import signal_message, signal_of

    assert signal_of(signal_message(GOOD)) == GOOD
    for number in (5e-324, 1e308, -1.0, math.nan):
        with pytest.raises(ShsaError, match="period"):
            signal_of(signal_message(dataclasses.replace(GOOD, period=number)))
    for error in (Error(0.5), Error(0.5, p95=0.9)):
        wrong = dataclasses.replace(GOOD, error=error)
        assert signal_of(signal_message(wrong)) == wrong
    with pytest.raises(ShsaError, match="error must be finite"):
        signal_of(signal_message(dataclasses.replace(GOOD, error=Error(math.inf))))


def changed(path: str, value: object) -> dict:
    """The parameters of a SOM of one service, one of them changed."""
    tree = json.loads(json.dumps(som_parameters(Som([service()]))))
    *way, last = path.split("/")
    place = tree
    for key in way:
        place = place.setdefault(key, {})
    place[last] = value
    return tree


@pytest.mark.parametrize(
    "path, value",
    [
        ("services/current", []),
        ("services/current", None),
        ("services/current", {}),
        ("services/current/topic", "/another"),
        ("services/current/type", "no_such/Type"),
        ("services/current/type", "unittest.__main__/x"),
        ("services/current/node", "/another"),
        ("services/current/policy", "restart"),
        ("services/current/provides", {"battery_current": {"field": "nowhere"}}),
        ("services/current/provides", {}),
        ("services/current/provides", {"battery_current": {"field": "data[" + "9" * 400 + "]"}}),
        ("services/current/period", b"\0\xff"),
        ("services/current/period", 5e-324),
        ("services/current/period", 1e308),
        ("services/current/deadline", 1e308),
        ("services/current/last_resort", {"command": ["/bin/true"]}),
        ("services/" + "\x1b[2J\n", {}),
        ("services/another", {"topic": "/x"}),
        ("\x1b\n", 1),
        ("services", {}),
        ("services", []),
    ],
)
def test_what_cannot_be_is_refused_and_the_old_entry_stays(path: str, value: object) -> None:
    current = Som([service()])
    som, errors = merge_parameters(current, changed(path, value))
    assert som.services["current"] == current.services["current"] and set(som.services) == {
        "current"
    }
    assert errors or value == {} and path == "services"
    assert all(str(error).isprintable() for error in errors)


def test_one_entry_that_cannot_be_costs_no_other() -> None:
    current = Som([service(), service(name="second", topic="/second")])
    tree: Any = som_parameters(current)
    tree["services"]["current"]["period"] = b"\0"
    tree["services"]["second"]["period"] = 0.5
    tree["what"] = b"\0"
    som, errors = merge_parameters(current, tree)
    assert som.services["second"].period == 0.5 and som.services["current"].period == PERIOD
    assert len(errors) == 2


@pytest.mark.parametrize("limit", [5e-324, 1e-308, 1e308])
@pytest.mark.parametrize("period, deadline", [(1e-4, 1.0), (1e6, 1e6), (PERIOD, 5.0), (None, None)])
def test_the_monitor_judges_by_any_limits_that_a_som_may_have(
    limit: float, period: Any, deadline: Any
) -> None:
    """Whatever number passes the reader of the SOM, the monitor goes on."""
    kinds = {
        key: each
        for key, each in REGISTRY.items()
        if each.usual is not True and each is not Formula  # its limit is a text
    }
    if period is None:
        kinds = {key: each for key, each in kinds.items() if not key.startswith("rate")}
    of_values = tuple(each(limit) for each in kinds.values() if each.sample is ValueSample)
    of_messages = tuple(each(limit) for each in kinds.values() if each.sample is not ValueSample)
    value = provision(checks=of_values, range=(-1.7e308, 1.7e308))
    bench = Bench(service(value, period=period, deadline=deadline, checks=Checks(each=of_messages)))
    bench.connect()
    for number in (0.0, 1.7e308, -1.7e308, 5e-324, math.nan, math.inf, None, 1.0):
        bench.wait(0.01)
        bench.send(Message(bench.now, TOPIC, NODE, (number,), age=1e-9))
    bench.send(Tick(bench.now + 10.0))


def test_a_syntax_error_opens_nothing_in_the_working_folder(tmp_path: pathlib.Path) -> None:
    """A pipe of the name that the parser gives a text would hold it up for good."""
    for name in ("<unknown>", "<string>", "<substitute>"):
        os.mkfifo(tmp_path / name)
    text = (
        "from shsa_core.codegen.checked_code import check_code\n"
        "from shsa_core.language.expression import parse_expression\n"
        "code = 't0=x[0];\\ny=('\n"
        "for call in (lambda: check_code(code, 1, 1), lambda: parse_expression('a +')):\n"
        "    try:\n        call()\n    except Exception as error:\n        print(error)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", text],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=30.0,
    )
    lines = done.stdout.decode().splitlines()
    assert done.returncode == 0 and len(lines) == 2 and "line 2: not Python" in lines[0]
    with pytest.raises(CodeError, match="not Python"):
        check_code("t0=x[0];\ny=(", 1, 1)


def test_no_parameter_of_healing_names_a_file() -> None:
    """Whoever reaches the master can set it, and have the node started again."""
    source, calls = pathlib.Path(message_types.__file__).parent, ("get_param", "getParam")
    asked: List[str] = []
    for path in source.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Call) and getattr(node.func, "attr", "") in calls:
                name: Any = node.args[0]
                asked.append(name.value if isinstance(name, ast.Constant) else ast.dump(name))
    names = {
        each if each.startswith("~") else re.sub(r".*id='(\w+)'.*", r"\1", each) for each in asked
    }
    # Settings, a flag, the SOM, the master's own name of its start, a flag of rosout's, launches.
    assert names == {"~", "~muted", "PARAMETER", "RUN", "ROSOUT", "/roslaunch/uris"}
