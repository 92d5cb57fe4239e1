"""The moving picture of a recorded run: valid SVG that holds its moments and needs nothing else."""
import json
import re
import subprocess
import sys
from pathlib import Path
from typing import Dict
from xml.etree import ElementTree

import pytest
import rosbag
import rospy
from shsa_msgs.msg import Float64Stamped

from shsa_rover.moving_picture import main

ROOT = Path(__file__).resolve().parents[4]
SCRIPT = ROOT / "src" / "shsa_rover" / "scripts" / "moving_picture"
BEGAN_S = 1000.0
SENSOR, SUBSTITUTE = "/amperemeter", "/substitute_standby_1"
MOMENTS = {"last_good": 8.0, "detected": 8.02, "first_message": 8.05, "returned": 16.0}
INCIDENT = {
    **{name: BEGAN_S + moment for name, moment in MOMENTS.items()},
    "ended": BEGAN_S + 18.0,
    "inputs": ["/odom/twist/twist/linear/x", "/<odd>&"],
    "relations": ["f1"],
    "errors": [{"rms": 0.23}],
}


def write_run(folder: Path, **changed: object) -> None:
    """A run in which the sensor dies after 8 s and is back after 16 s; 5 messages a second."""
    with rosbag.Bag(str(folder / "run.bag"), "w") as bag:
        for k in range(100):
            time = rospy.Time.from_sec(BEGAN_S + k / 5)
            message = Float64Stamped(data=3.0 + (k % 10) / 5)
            bag.write("/simulation/battery_current", message, time)
            if k in (41, 80):
                del bag._topic_connections["/battery_current"]  # else one publisher a topic
            header = connection(SUBSTITUTE if 40 < k < 80 else SENSOR)
            bag.write("/battery_current", message, time, connection_header=header)
    log = folder / "incidents.jsonl"
    log.write_text(json.dumps({**INCIDENT, **changed}) + "\n", encoding="utf-8")


def connection(publisher: str) -> Dict[str, str]:
    """Return the header of a connection, as the recorder writes it."""
    kind = Float64Stamped
    return {
        "callerid": publisher,
        "topic": "/battery_current",
        "type": kind._type,
        "md5sum": kind._md5sum,
        "message_definition": kind._full_text,
    }


def test_a_run_is_drawn_with_its_moments(tmp_path: Path) -> None:
    write_run(tmp_path)
    output = tmp_path / "demo.svg"
    words = ["--results", str(tmp_path), "--output", str(output)]
    subprocess.run([sys.executable, str(SCRIPT), *words], check=True)
    picture = output.read_text(encoding="utf-8")
    root = ElementTree.fromstring(picture)
    texts = [element.text for element in root.iter() if element.text]
    assert any("50 ms later" in text and "0.23 A (RMS)" in text for text in texts)
    assert any("back after 8 s" in text for text in texts)
    assert "0" in texts
    assert "/<odd>&" in texts and "f1" in texts and "/battery_current" in texts
    # It runs from 2 s to the last message at 19.8 s, in 85 % of the loop.
    moments = r"@keyframes substituted \{ 0%[^%]* ([0-9.]+)%[^%]* ([0-9.]+)%,"
    ((dies, returns),) = re.findall(moments, picture)
    assert float(returns) == pytest.approx(85 * 14 / 17.8, abs=0.01)
    assert float(dies) == pytest.approx(85 * 6 / 17.8, abs=0.01)
    kinds = [str(e.get("class")) for e in root.iter() if str(e.get("d", "")).count(",") > 5]
    assert [kind.split()[0] for kind in kinds] == ["truth", "sensor", "sensor", "substitute"]


def test_the_readmes_picture_needs_nothing_else_and_rests_where_motion_is_not_wanted() -> None:
    picture = (ROOT / "docs" / "demo.svg").read_text(encoding="utf-8")
    ElementTree.fromstring(picture)
    assert "prefers-reduced-motion" in picture and "prefers-color-scheme: dark" in picture
    assert not re.search(r"<script|href|url\(|@import|@font-face", picture)
    assert len(picture) < 500000
    assert '<text class="end" x="49.0" y="344.0">0</text>' in picture, "its scale begins at 0"


def test_what_has_nothing_to_show_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = ["--results", str(tmp_path), "--output", str(tmp_path / "demo.svg")]
    assert main(words) == 1
    assert "run.bag: there is no such file" in capsys.readouterr().err
    write_run(tmp_path, returned=None)
    assert main(words) == 1
    assert "no failure of this run was healed" in capsys.readouterr().err
    assert not (tmp_path / "demo.svg").exists()
