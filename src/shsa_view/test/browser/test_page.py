"""The page in a real browser, with the real server, which is fed with documents."""
import copy
import shlex
import subprocess
from pathlib import Path
from typing import Any, Dict, Iterator, List

import genpy
import pytest
import rosbag
from chromium import CONTRAST, OUTSIDE, PALE, PHONE, WIDE, Browser
from documents import (
    BEGAN,
    EVIDENCE,
    HOSTILE,
    HOSTILE_SVG,
    Document,
    drawing,
    drawing_of,
    hostile,
    incident,
    large,
    prop,
    robot,
)
from fed import Fed
from std_msgs.msg import Float64

from shsa_injection.vocabulary import TOPIC_FAULTS
from shsa_testing.waiting import wait_until

ROW = "tr[data-service=amperemeter]"
NODE = "#service-amperemeter"


@pytest.fixture(scope="module")
def chromium() -> Iterator[Browser]:
    """One browser for all."""
    browser = Browser()
    yield browser
    browser.close()


@pytest.fixture
def browser(chromium: Browser) -> Iterator[Browser]:
    """The browser, which must have nothing to complain of at the end."""
    chromium.size(*WIDE)
    chromium.dark(False)
    yield chromium
    assert chromium.log() == []


@pytest.fixture
def served(chromium: Browser, caplog: Any) -> Iterator[List[Fed]]:
    """Servers that end with the test, after their page, and have nothing to complain of."""
    made: List[Fed] = []
    yield made
    chromium.driver.get("about:blank")
    for each in made:
        each.close()
    assert [each.getMessage() for each in caplog.get_records("call") + caplog.records] == []


@pytest.fixture
def fed(browser: Browser, served: List[Fed]) -> Fed:
    """A robot that is well, in the browser."""
    served.append(Fed(robot()))
    browser.open(served[0].address)
    browser.wait("document.querySelector('#graph svg') !== null")
    return served[0]


def substituted() -> Document:
    """Return the change when the amperemeter's substitute publishes."""
    row = copy.deepcopy(robot()["services"]["amperemeter"])
    node = "/substitute_battery_current_1"
    row.update(state="substituted", substitute=node, publisher=node, detail="its node is gone")
    row["derivation"] = ["property-battery_current", "relation-power-battery_current"]
    row["properties"]["battery_current"].update(error_p95=0.4, error_rms=0.2)
    happened = incident()
    row["incident_key"] = happened["key"]
    return {
        "robot": {"state": "substituted", "text": "amperemeter has a substitute."},
        "services": {"amperemeter": row},
        "substitutes": {node: {"inputs": ["/battery_voltage/data"], "relations": ["power"]}},
        "incidents": [happened],
    }


def test_a_robot_that_is_well(browser: Browser, fed: Fed) -> None:
    assert browser.text("#robot-state") == "All well"
    assert browser.run("document.title") == "✓ All well – /"
    row = browser.text(ROW)
    for part in ("Well", "/battery_current", "3.214 ± 0.060 A", "50 of 50 Hz"):
        assert part in row
    assert browser.run(f"document.querySelector('{ROW} .strip').ariaLabel") == (
        "Last minute: 57 s well, 3 s not known"
    )
    assert browser.run("document.querySelector('#no-incidents').hidden") is False
    assert browser.run(f"document.querySelector('{NODE}').dataset.state") == "well"


def test_what_is_watched_less_is_marked_until_it_is_taken_back(browser: Browser, fed: Fed) -> None:
    row = copy.deepcopy(robot()["services"]["amperemeter"])
    shown = f"document.querySelector('{ROW} .weakened').checkVisibility()"
    assert browser.run(shown) is False
    fed.state.tell(services={"amperemeter": {**row, "weakened": "range: 90 (in the SOM file 60)"}})
    browser.wait(shown)
    mark = "watched less than the SOM file says: range: 90 (in the SOM file 60)"
    assert browser.text(f"{ROW} .weakened") == mark and "Well" in browser.text(ROW)
    fed.state.tell(services={"amperemeter": row})
    browser.wait(f"!{shown}")


@pytest.mark.parametrize("shared", [False, True])
def test_a_failure_is_seen_everywhere(browser: Browser, fed: Fed, shared: bool) -> None:
    told = substituted()
    if shared:
        told["substitutes"] = {f"{n} amperemeter": row for n, row in told["substitutes"].items()}
    fed.state.tell(**told)
    browser.wait(f"document.querySelector('{ROW}').dataset.state === 'substituted'")
    assert browser.texts("#rows .name") == ["amperemeter", "voltmeter"]
    assert "± 0.40 A" in browser.text(ROW)
    assert browser.run("document.querySelector('#glance').dataset.state") == "substituted"
    facts = browser.texts("#affected dt, #affected dd")
    assert facts[:2] == ["What failed", "/amperemeter – node gone"]
    assert facts[2:4] == ["Why", EVIDENCE]
    assert facts[5] == "/substitute_battery_current_1, from /battery_voltage/data by power"
    assert facts[7] == "battery_current ± 0.40 A; quality 0.87 of 1"
    browser.wait(f"document.querySelector('#affected').textContent.includes('{fed.answers.left}')")
    assert browser.run("document.title").startswith("◆ Substituted")
    classes = "document.querySelector('#{}').getAttribute('class')"
    for id_ in ("property-battery_current", "relation-power-battery_current", "edge-2"):
        assert "runs" in browser.run(classes.format(id_))
    assert "gone" in browser.run(classes.format("edge-1"))
    assert (
        browser.run("document.querySelector('#property-battery_current').dataset.state")
        == "derived"
    )
    assert "is lost; derived instead, ± 0.40 A" in browser.text("#losses")
    browser.wait(
        "document.querySelector('#spoken').textContent === 'amperemeter has a substitute.'"
    )

    fed.state.tell(**{key: robot()[key] for key in ("robot", "services", "substitutes")})
    browser.wait(f"document.querySelector('{ROW}').dataset.state === 'well'")
    assert browser.run("document.querySelectorAll('#affected li, #graph .runs').length") == 0
    fed.state.tell(robot={"state": "well", "text": "All that is needed is well. Not well: a."})
    browser.wait("document.querySelector('#robot-state').textContent === 'Well'")


def test_the_timeline_has_every_moment_and_outlives_a_reload(browser: Browser, fed: Fed) -> None:
    fed.state.tell(incidents=[incident(1)])
    browser.wait("document.querySelectorAll('#timeline > li').length === 1")
    fed.state.tell(incidents=[incident(2, "voltmeter")])
    browser.wait("document.querySelectorAll('#timeline > li').length === 2")
    for _ in range(2):
        heads = browser.texts("#timeline summary b")
        assert heads == ["voltmeter: node gone", "amperemeter: node gone"]
        assert browser.run(
            "[...document.querySelectorAll('details')].map((each) => each.open)"
        ) == [*(True, False)]
        moments = browser.texts("#timeline [open] .moments li b")
        assert moments == ["0", "+21 ms", "+29 ms", "+31 ms", "+34 ms", "+43 ms", "–", "–"]
        browser.open(fed.address)
    browser.run("document.querySelectorAll('.moments li')[1].focus()")
    clock = browser.run(
        "getComputedStyle(document.querySelectorAll('.moments .clock')[1]).position"
    )
    assert clock == "static"
    over = incident(2, "voltmeter", state="ended")
    over["moments"].update(returned=BEGAN + 132, ended=BEGAN + 134)
    fed.state.tell(incidents=[over])
    browser.wait("document.querySelector('.moments').textContent.includes('+14.0 s')")
    assert browser.focused().startswith("failure seen"), "what is told anew keeps the focus"


def test_the_command_of_an_incident_cuts_a_recording(
    browser: Browser, fed: Fed, tmp_path: Path
) -> None:
    with rosbag.Bag(str(tmp_path / "drive.bag"), "w") as bag:
        for second in range(120):
            bag.write("/a", Float64(second), genpy.Time(int(BEGAN) + second))
    fed.state.tell(incidents=[incident(1)])
    told = "[...document.querySelectorAll('#timeline dd')].map((each) => each.textContent)"
    command = browser.wait(f"{told}.find((each) => each.startsWith('rosbag filter'))")
    subprocess.run(shlex.split(command), cwd=str(tmp_path), stdout=subprocess.DEVNULL, check=True)
    with rosbag.Bag(str(tmp_path / "incident.bag")) as bag:
        assert [message.data for _, message, _ in bag.read_messages()] == [*range(50, 71)]


def test_why_what_to_do_and_values_over_time(browser: Browser, fed: Fed) -> None:
    told = substituted()
    typed = "rosrun shsa_rover amperemeter"
    told["services"]["amperemeter"].update(
        why=EVIDENCE, remedies=[{"text": "Start /amperemeter again:", "command": typed}]
    )
    told["services"]["amperemeter"]["properties"]["battery_current"]["range"] = [-5.0, 60.0]
    fed.state.tell(**told)
    browser.wait(f"document.querySelector('{ROW}').dataset.state === 'substituted'")
    assert browser.texts("#affected .remedies code") == [typed]
    browser.click(f"{ROW} .minute")
    assert browser.text("#about") == "amperemeter"
    assert EVIDENCE in browser.text("#now") and typed in browser.text("#now code")
    browser.wait("document.querySelector('#values canvas') !== null")
    legend = browser.text("#values .u-legend")
    for part in ("sensor", "substitute", "lowest", "highest"):
        assert part in legend
    assert browser.run("document.querySelector('#what-if').scrollWidth") <= browser.run(
        "document.querySelector('#what-if').clientWidth"
    )
    browser.press("ESCAPE")
    assert browser.run("document.querySelectorAll('#values canvas').length") == 0
    browser.click(".values-around")
    browser.wait("document.querySelector('#values canvas') !== null")
    assert browser.text("#about") == "amperemeter: node gone"
    assert EVIDENCE in browser.text("#now")


def test_the_last_hour_can_be_zoomed_and_saved(browser: Browser, fed: Fed) -> None:
    fed.state.tell(incidents=[incident(1)])
    browser.wait("document.querySelectorAll('#hour-rows li').length === 3", 30.0)
    browser.wait("document.querySelectorAll('#hour-rows .mark').length === 1", 30.0)
    assert browser.texts("#hour-rows li > span") == ["amperemeter", "voltmeter", ""]
    labels = "#hour-rows .axis div span"
    hour = browser.texts(labels)
    browser.click("[data-minutes='5']")
    assert browser.texts(labels) != hour
    assert browser.run("document.querySelectorAll('#hour-rows .mark').length") == 1
    saved = "fetch(document.querySelector('#hour a[download]:nth-of-type(2)').href)"
    browser.run(f"{saved}.then((each) => each.text()).then((text) => (window.saved = text))")
    assert str(browser.wait("window.saved")).startswith("what,service,from,to,state")


KEPT = "is kept: it takes /cmd_vel"


def test_what_if(browser: Browser, fed: Fed) -> None:
    browser.click("#property-battery_current text")
    browser.wait("document.querySelector('#answer h3') !== null")
    assert browser.text("#question") == "What if amperemeter failed?"
    answer = browser.text("#answer")
    for part in ("would be taken over", "battery_current ± 0.40 A", fed.answers.left, "y=t0", KEPT):
        assert part in answer
    assert "/amperemeter and /voltmeter" in browser.text(".sets")
    relation = "document.querySelector('#relation-power-battery_current').getAttribute('class')"
    browser.wait(f"{relation}.includes('would')")
    browser.press("ESCAPE")
    assert browser.run("document.querySelector('#what-if').open") is False
    assert "would" not in browser.run(relation)


def test_by_the_keyboard_alone(browser: Browser, fed: Fed) -> None:
    browser.run("document.body.focus()")
    browser.press("TAB")
    assert browser.focused() == "To the services"
    browser.press("ENTER")
    assert browser.focused() == "services"
    browser.press("TAB", "ARROW_DOWN")
    assert browser.focused() == "voltmeter"
    assert browser.run("getComputedStyle(document.activeElement).outlineStyle") == "solid"
    browser.press("ARROW_RIGHT", "ARROW_UP")
    browser.press("ENTER")
    assert browser.focused() == "about"
    assert "the node" in browser.text("#question")
    browser.press("ESCAPE")
    assert browser.focused() == "amperemeter"
    browser.press(*("TAB",) * 9)
    assert browser.focused() == "service-amperemeter"
    browser.press("ARROW_DOWN")
    assert browser.focused() == "property-battery_current"
    browser.press("ARROW_RIGHT")
    assert browser.focused() == "relation-power-battery_current"
    assert browser.run("document.querySelectorAll('#graph [tabindex=\"0\"]').length") == 1


def test_markup_is_shown_as_text(chromium: Browser, served: List[Fed]) -> None:
    served.append(Fed(hostile()))
    served[0].answers.drawing = drawing(HOSTILE_SVG)
    served[0].answers.left = HOSTILE
    chromium.open(served[0].address)
    chromium.wait("document.querySelector('#graph svg') !== null")
    chromium.wait("document.querySelector('#affected').textContent.includes('window.hurt')")
    for place in ("#rows", "#timeline", "#affected", "#robot-text", "#healing", "#namespace"):
        assert HOSTILE in chromium.text(place)
    chromium.click("#rows .name")
    chromium.wait("document.querySelector('.left') !== null")
    assert HOSTILE in chromium.text("#answer")
    assert chromium.run("window.hurt === undefined")
    assert (
        chromium.run("document.querySelectorAll('img, main script, foreignObject, image').length")
        == 0
    )
    assert (
        chromium.run(
            "document.querySelectorAll('[onclick], :not(#values *, .mark)[style], a[href^=java]')"
            ".length"
        )
        == 0
    )
    told = {each["source"] for each in chromium.log()}
    assert told <= {"security"}, "what the policy refuses in the drawing is told"


def test_200_services_and_only_what_changes_is_touched(browser: Browser, served: List[Fed]) -> None:
    served.append(Fed(large(200)))
    browser.open(served[0].address)
    browser.wait("document.querySelectorAll('#rows tr').length === 200")
    browser.run(
        "(window.touched = new Set(), new MutationObserver((records) => records.forEach("
        "(each) => touched.add(each.target.parentElement.closest('tr')?.dataset.service)))"
        ".observe(document.querySelector('#rows'), {subtree: true, childList: true,"
        " characterData: true}))"
    )
    row: Dict[str, Any] = copy.deepcopy(served[0].state.whole["services"]["sensor_150"])
    row["properties"]["value_150"]["value"] = 7.5
    served[0].state.tell(services={"sensor_150": row})
    browser.wait("document.querySelector('[data-service=sensor_150] b').textContent === '7.50'")
    assert browser.run("[...touched]") == ["sensor_150"]
    served[0].state.tell(services={"sensor_150": {**row, "state": "not_healed"}})
    browser.wait("document.querySelector('#rows tr').dataset.service === 'sensor_150'")
    assert browser.text("#services-count") == "1 not healed · 199 well"
    browser.run("document.querySelector('#filter').focus()")
    browser.driver.switch_to.active_element.send_keys("sensor_01")
    browser.wait("document.querySelectorAll('#rows tr:not([hidden])').length === 10")
    served[0].state.tell(services={"sensor_150": None})
    browser.wait("document.querySelectorAll('#rows tr').length === 199")


def all_fail(browser: Browser, fed: Fed) -> int:
    """Let every service fail at once, with an incident each; return what the page did for it."""
    services = fed.state.whole["services"]
    failed = {
        name: {**row, "state": "substituted", "derivation": [f"service-{name}", "x"]}
        for name, row in services.items()
    }
    incidents = [incident(1 + at / 999, name, key=name) for at, name in enumerate(services)]
    fed.state.whole["now"] = BEGAN + 120
    browser.counted()
    fed.state.tell(services=failed, incidents=incidents)
    of = f"'{len(services)}'"
    browser.wait(f"String(document.querySelectorAll('#hour-rows .mark').length) === {of}")
    rows = "#rows tr[data-state=substituted]"
    assert browser.run(f"String(document.querySelectorAll('{rows}').length) === {of}")
    return browser.counted()


def test_four_times_the_services_are_at_most_four_times_the_work(
    browser: Browser, served: List[Fed]
) -> None:
    browser.count()
    done = []
    for count in (40, 160):
        served.append(Fed(large(count)))
        served[-1].answers.drawing = drawing_of(served[-1].state.whole["services"])
        browser.open(served[-1].address)
        browser.wait("document.querySelector('#graph svg') !== null")
        browser.run("[...Array(99).keys()].forEach((timer) => clearInterval(timer))")
        state = served[-1].state
        wait_until(lambda: len(state.timeline(BEGAN)["services"]) == count, 30.0, "all have states")
        done.append(all_fail(browser, served[-1]))
    browser.driver.get("about:blank")
    browser.count_no_more()
    few, many = done
    assert few > 40 * 20, "the page's code is counted"
    assert many <= 4 * few, done


def test_a_lost_connection_says_so_and_comes_back(chromium: Browser, served: List[Fed]) -> None:
    served.append(Fed(robot()))
    chromium.open(served[0].address)
    served[0].close()
    chromium.wait("!document.querySelector('#lost').hidden")
    assert chromium.text("#lost").startswith("Connection lost since ")
    assert "The page shows the robot as it was then." in chromium.text("#lost")
    assert chromium.text(f"{ROW} .state") == "Well", "it is still there"
    again = robot()
    del again["services"]["voltmeter"]
    again["robot"]["text"] = "Started anew."
    served.append(Fed(again, served[0].port))
    chromium.wait("document.querySelector('#robot-text').textContent === 'Started anew.'")
    assert chromium.run("document.querySelector('#lost').hidden") is True
    chromium.wait("document.querySelectorAll('#rows tr').length === 1")
    assert {each["source"] for each in chromium.log()} == {"network"}


@pytest.mark.parametrize(
    "document", [robot, hostile, lambda: large(30)], ids=("robot", "hostile", "large")
)
def test_a_phone_needs_no_sideways_scrolling(
    browser: Browser, served: List[Fed], document: Any
) -> None:
    served.append(Fed({**document(), "incidents": [incident()]}))
    browser.size(*PHONE)
    browser.open(served[0].address)
    browser.wait("document.querySelector('#graph svg') !== null")
    browser.run("document.querySelector('#rows .name').click()")
    browser.wait("document.querySelector('.left') !== null")
    assert browser.run("document.documentElement.scrollWidth") == PHONE[0]


@pytest.mark.parametrize("size", [WIDE, PHONE], ids=["wide", "phone"])
def test_values_stay_in_their_column(browser: Browser, served: List[Fed], size: Any) -> None:
    told = robot()
    told["services"]["amperemeter"]["properties"] = {
        "specific_force_of_the_left_wheel": prop(-0.70123, "m/s^2", 0.00085),
        "i": prop(-123456.789, "rad/s^2", 0.0012),
    }
    served.append(Fed(told))
    browser.size(*size)
    browser.open(served[0].address)
    browser.wait("document.querySelector('#rows .told') !== null")
    assert browser.run(OUTSIDE) == []


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_text_can_be_read(browser: Browser, fed: Fed, dark: bool) -> None:
    browser.dark(dark)
    told = substituted()
    healing = {**robot()["services"]["voltmeter"], "state": "healing", "detail": "searched"}
    lost = {**robot()["services"]["voltmeter"], "state": "not_healed", "detail": "gone"}
    told["services"].update(voltmeter=healing, third=lost, fourth={**lost, "state": "unknown"})
    fed.state.tell(**told)
    browser.wait("document.querySelectorAll('#rows tr').length === 4")
    browser.click(f"{ROW} .name")
    browser.wait("document.querySelector('.left') !== null")
    browser.wait("document.getAnimations().length === 0")
    assert browser.run(PALE, CONTRAST) == []


def test_actions_need_a_token_and_a_yes(browser: Browser, served: List[Fed]) -> None:
    served.append(Fed({**robot(), "actions": True}, token="secret"))
    fed = served[0]
    for fragment, shown in (("", False), ("#token=secret", True)):
        browser.open(fed.address + fragment)
        browser.click(f"{ROW} .name")
        browser.wait("document.querySelector('.left') !== null")
        assert browser.run("!document.querySelector('#actions').hidden") is shown
    browser.click("[data-action=release]")
    browser.click("#confirm [value=no]")
    browser.click("[data-action=inject]")
    assert 'Inject the fault "crash" into /battery_current?' in browser.text("#confirm-text")
    assert {*browser.texts("#actions option")} <= {*TOPIC_FAULTS}
    browser.click("#confirm [value=yes]")
    browser.wait("document.querySelector('#actions [role=status]').textContent.startsWith('Done')")
    assert fed.answers.acted == [("inject", {"topic": "/battery_current", "fault": "crash"})]
    browser.press("ESCAPE")
    browser.run("document.querySelector('.skips a').click()")
    assert browser.run("location.hash") == "#token=secret", "a skip keeps the token"
