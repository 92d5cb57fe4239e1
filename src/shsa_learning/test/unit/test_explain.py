"""`shsa explain`: an incident as a page, from a bag or from the log."""
import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, Callable, List, Tuple

import numpy as np
import pytest
import rospy
from shsa_msgs import msg
from std_msgs.msg import Header

from recordings import BEGIN_S, BagWriter, som_of
from shsa_core.cli.main import main
from shsa_core.errors import ShsaError
from shsa_core.files.ontology_file import read_ontology
from shsa_core.files.som_file import read_som
from shsa_core.healing.incident import Incident, State
from shsa_core.model.error import Error
from shsa_core.model.kinds import Kind
from shsa_core.model.som import Som
from shsa_core.ros import clock
from shsa_core.ros.wire import healing as wire
from shsa_learning.explain.searched import search_again
from shsa_learning.explain.truth import compare
from shsa_learning.explain.words import KINDS, STATES, duration, summary
from shsa_learning.recordings.recording import Recording, Series

DATA = Path(__file__).resolve().parents[3] / "shsa_core" / "test" / "unit" / "data"
MODELS = ("--ontology", str(DATA / "boat.yaml"), "--som", str(DATA / "boat_som.yaml"))
CODE = "t0=x[0];\ndef _tf1(i1): # fit: current\n  return 3 * i1\nt1=_tf1(t0)\ny=t1\n"
INCIDENT = Incident(
    7,
    "current",
    "/current",
    ("current",),
    "/amperemeter",
    Kind.SILENT,
    "/current: /amperemeter is back.",
    detected=BEGIN_S + 10.25,
    state=State.ENDED,
    last_good=BEGIN_S + 10.0,
    first_message=BEGIN_S + 10.5,
    returned=BEGIN_S + 15.0,
    ended=BEGIN_S + 17.0,
    substitute="/substitute_1",
    inputs=("/speed/data",),
    code=CODE,
    outputs=("/current/data",),
    relations=("fit",),
    gains=(1.0,),
    offsets=(0.5,),
    quality=0.9,
    errors=(Error(0.5, p95=0.9),),
    unavailable=("voltage",),
    evidence="no message <b>within</b> 0.25 s",
    decision="/amperemeter is killed",
)

Shsa = Callable[..., Tuple[int, str, str]]


@pytest.fixture
def shsa(capsys: Any) -> Shsa:
    """Runs `shsa explain`; returns its exit status, its output and its errors."""

    def run(*arguments: object) -> Tuple[int, str, str]:
        status = main(["explain", *map(str, arguments)])
        printed = capsys.readouterr()
        return status, printed.out, printed.err

    return run


def log(path: Path, *incidents: Incident) -> Path:
    path.write_text("".join(json.dumps(each.as_dict()) + "\n" for each in incidents))
    return path


def bag(path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a boat whose amperemeter is silent for 5 s; its current is 3 * speed + 0.75."""
    monkeypatch.setattr(rospy.rostime, "_rostime_initialized", True)
    monkeypatch.setattr(clock, "offset", lambda: 0.0)
    with BagWriter(path) as out:
        for k in range(250):
            now = BEGIN_S + 0.1 * k
            speed = 2.0 + math.sin(now)
            out.floats("/speed", [(now, speed)], "/log")
            if not 10.05 < 0.1 * k < 14.95:
                out.floats("/current", [(now + 0.01, 3.0 * speed + 0.75)], "/amperemeter")
            elif 0.1 * k > 10.45:
                out.floats("/current", [(now + 0.01, 3.0 * speed + 0.5)], "/substitute_1")
        failure = msg.Failure(
            header=Header(stamp=rospy.Time.from_sec(INCIDENT.detected)),
            topic="/current",
            publisher="/amperemeter",
            kind="silent",
            detail="no message for 0.26 s",
        )
        out.write("/shsa/failures", failure, INCIDENT.detected, "/monitor")
        begun = replace(INCIDENT, state=State.HEALING, returned=None, ended=None)
        for each, at in ((begun, BEGIN_S + 10.3), (INCIDENT, BEGIN_S + 17.0)):
            out.write("/shsa/incidents", wire.incident(each), at, "/reconfigurator")
    return path


def test_a_bag_and_the_models_tell_all(
    tmp_path: Path, shsa: Shsa, monkeypatch: pytest.MonkeyPatch
) -> None:
    run, page = bag(tmp_path / "run.bag", monkeypatch), tmp_path / "page.html"
    assert shsa(run, *MODELS, "--output", page)[0] == 0
    text = page.read_text()
    assert "no message &lt;b&gt;within&lt;/b&gt; 0.25 s" in text and "<b>" not in text
    assert "250 ms after the last good message /shsa/failures told of /amperemeter" in text
    assert "Searched again, the best is what ran: fit." in text
    assert '<tr class="ran"><td>fit</td><td>/speed/data</td>' in text
    assert "/voltage/data (voltage) was not available" in text
    assert "<h3>current: as true as promised</h3>" in text
    assert "<td>0.25 A</td><td>0.5 A</td>" in text  # 0.75 in truth, and 0.5 by its calibration
    assert "500 ms after the last good message, by fit from /speed/data" in text
    assert text.count("<svg") == text.count("</svg>") == 2


def test_the_log_alone_tells_what_it_holds(tmp_path: Path, shsa: Shsa) -> None:
    second = replace(INCIDENT, id=8, detected=INCIDENT.detected + 60.0, service="<i>")
    record = log(tmp_path / "log", INCIDENT, second)
    status, said, _ = shsa(record, "--output", tmp_path / "pages")
    assert (status, said) == (0, f"{tmp_path}/pages/index.html\n")
    index = (tmp_path / "pages" / "index.html").read_text()
    assert index.index("002-_i_.html") < index.index("001-current.html")
    text = (tmp_path / "pages" / "001-current.html").read_text()
    assert "Not compared: the incident log has no values; a rosbag of the run has." in text
    assert "Not told: --ontology and --som are not given." in text
    assert "&lt;i&gt;" in (tmp_path / "pages" / "002-_i_.html").read_text()


def test_without_a_place_for_pages_it_is_told_in_short(tmp_path: Path, shsa: Shsa) -> None:
    bad = tmp_path / "log"
    log(bad, INCIDENT, replace(INCIDENT, id=8, topic="/\x1bother"))
    with bad.open("a") as out:
        out.write("{")
    status, said, noted = shsa(bad, "--incident", 7)
    assert status == 0 and "/amperemeter failed to publish /current: it sent no message" in said
    assert "other" not in said and f"{bad}:3: is not a line" in noted
    status, said, _ = shsa(bad, "--incident", 8)
    assert status == 0 and "\x1b" not in said


def test_what_cannot_be_done_is_said(tmp_path: Path, shsa: Shsa) -> None:
    record = log(tmp_path / "log", INCIDENT, replace(INCIDENT, id=8))
    assert shsa(log(tmp_path / "none"))[:2] == (1, f"{tmp_path}/none: no incident\n")
    assert shsa(record, "--incident", 9)[:2] == (1, f"{record}: no incident 9\n")
    wrong: Tuple[Tuple[List[object], str], ...] = (
        ([record, "--output", tmp_path / "page.html"], "2 incidents need a folder"),
        ([record, "--som", "x.yaml"], "are given both, or neither"),
        ([tmp_path / "missing"], "No such file"),
        ([tmp_path], "Is a directory"),
    )
    for words, told in wrong:
        status, _, error = shsa(*words)
        assert status == 2 and told in error
    (tmp_path / "cut.bag").write_bytes(b"#ROSBAG V2.0\n")
    status, _, error = shsa(tmp_path / "cut.bag")
    assert status == 2 and "cut.bag" in error


def test_every_kind_and_every_state_has_words() -> None:
    assert set(KINDS) == set(Kind) and set(STATES) == set(State)
    assert [duration(each) for each in (0.0942, 16.94, 600.0)] == ["94 ms", "16.9 s", "10.0 min"]


def test_what_could_not_be_used_has_its_reasons() -> None:
    ontology, som = read_ontology(MODELS[1]), read_som(MODELS[3])
    (searched,) = search_again(ontology, som, INCIDENT).properties
    assert searched.complete and {each.ran for each in searched.found if each.why_not} == {False}
    (ran,) = [each for each in searched.found if each.ran]
    assert ran.relations == ("fit",) and ran.why_not == ()
    dead = replace(INCIDENT, faulty_node="/log", unavailable=("flow", "voltage"), code="")
    search = search_again(ontology, som, dead)
    reasons = [why for each in search.properties[0].found for why in each.why_not]
    assert "/speed/data (speed) is published by the failed node /log" in reasons
    assert "/flow/data (flow) was not available: it had failed, or nobody published it" in reasons
    assert all(each.why_not for each in search.properties[0].found)
    assert search.answer.startswith("Nothing would do: no substitute for current")
    with pytest.raises(ShsaError, match="the SOM has no service other"):
        search_again(ontology, som, replace(INCIDENT, service="other"))


def test_what_erred_too_much_could_not_be_used() -> None:
    ontology, som = read_ontology(MODELS[1]), read_som(MODELS[3])
    known = [replace(f, error=Error(0.5, p95=0.9)) for f in ontology.functions]
    service = som.services["current"]
    strict = replace(service.provides[0], fault_tolerant_error=0.01)
    som = Som([replace(s, provides=(strict,)) if s == service else s for s in som])
    unhealed = replace(INCIDENT, code="", inputs=())
    search = search_again(replace(ontology, functions=known), som, unhealed)
    (fit,) = [each for each in search.properties[0].found if each.relations == ("fit",)]
    assert fit.why_not == ("its error of 0.9 (p95) is above fault_tolerant_error, 0.01",)


def test_where_nothing_stood_in_that_is_said() -> None:
    lost = replace(
        INCIDENT,
        state=State.UNHEALED,
        substitute="",
        code="",
        missing=("speed",),
        ended=None,
        decision="",
    )
    told = summary(lost)
    assert told[1:] == (
        "Nothing could replace it: speed would be needed.",
        "In the end nothing could replace it.",
    )


def test_of_several_values_each_is_compared_with_its_own() -> None:
    fields = {"speed": "twist.twist.linear.x", "turn": "twist.twist.angular.z"}
    som = som_of(
        odom=("/odom", "nav_msgs/Odometry", "/wheels", fields),
        left=("/left", "std_msgs/Float64", "/left", {"left": "data"}),
    )
    time = np.arange(0.0, 10.0, 0.1)
    series = [
        Series("left", "/left/data", "/left", time, np.sin(time), "left"),
        Series("speed", "/odom", "/wheels", time, np.sin(time), "odom"),
        Series("turn", "/odom", "/wheels", time, 2.0 * np.sin(time) + 1.0, "odom"),
    ]
    incident = replace(
        INCIDENT,
        service="odom",
        topic="/odom",
        inputs=("/left/data",),
        outputs=tuple(som.services["odom"].sources[k].path for k in (0, 1)),
        code="t0=x[0];\ndef _tf1(i1): # r: turn\n  return 2*i1\nt1=_tf1(t0)\ny=(t0,t1)\n",
        gains=(),
        offsets=(),
        errors=(None, Error(0.1)),
        unavailable=(),
    )
    speed, turn = compare(som, incident, Recording("r", tuple(series)))
    assert (speed.property, speed.verdict) == ("speed", "nothing was promised")
    assert speed.error.rms == pytest.approx(0.0)
    assert (turn.error.bias, turn.error.rms) == (pytest.approx(-1.0), pytest.approx(1.0))
    assert turn.verdict == "less true than promised"
    with pytest.raises(ShsaError, match="no /other/data, which the substitute read"):
        compare(som, replace(incident, inputs=("/other/data",)), Recording("r", tuple(series)))
    with pytest.raises(ShsaError, match="the original is not in the recording"):
        compare(som, incident, Recording("r", tuple(series[:1])))
