"""The rover in a real browser: its amperemeter is killed, replaced and started again."""
from pathlib import Path
from typing import Iterator

import pytest
from chromium import Browser
from live_rover import START_S, Rover

from shsa_testing.thorough import LONG
from shsa_testing.waiting import wait_until

pytestmark = pytest.mark.skipif(not LONG, reason="make test-long; view.test has no browser")

HEALED_S = 15.0
SEEN_S = 0.5
"""From the failure, as the monitor sees it, to the changed row."""
ROW = "document.querySelector('tr[data-service=amperemeter]')"
STATE = f"{ROW}?.dataset.state"
WATCH = f"""(window.seen = [], new MutationObserver(() =>
  seen.push([{ROW}.dataset.state, Date.now() / 1000])
).observe({ROW}, {{attributes: true, attributeFilter: ['data-state']}}))"""


@pytest.fixture
def browser() -> Iterator[Browser]:
    """A browser of its own."""
    made = Browser()
    yield made
    made.close()


def test_the_rover_heals_before_your_eyes(browser: Browser, tmp_path: Path) -> None:
    rover = Rover(tmp_path)
    try:
        rover.wait_until_well()
        browser.open(rover.address)
        browser.wait("document.querySelector('#graph svg') !== null")
        browser.wait("document.querySelector('#robot-state').textContent === 'All well'", HEALED_S)
        fails(browser, rover)
        answers(browser)
        forgets_nothing(browser, rover)
        returns(browser, rover)
        complaints = [each for each in browser.log() if each["source"] != "network"]
        assert not complaints
    finally:
        rover.end()


def fails(browser: Browser, rover: Rover) -> None:
    """Kill the amperemeter: row, graph, glance and timeline say so."""
    browser.run(WATCH)
    rover.kill("amperemeter")
    browser.wait(f"{STATE} === 'substituted'", HEALED_S)
    incident = wait_until(lambda: rover.state()["incidents"], HEALED_S, "there is an incident")[0]
    late = browser.run("seen[0][1]") - incident["moments"]["detected"]
    assert late < SEEN_S, f"the row changed {late:.3f} s after the failure was seen"
    print(f"the row changed {1000.0 * late:.0f} ms after the failure was seen")
    browser.wait("document.querySelectorAll('#graph .edge.runs').length > 2")
    browser.wait("document.querySelector('#service-amperemeter').dataset.state === 'substituted'")
    browser.wait("document.querySelector('#timeline').textContent.includes('taken over after')")
    assert "battery_current ±" in browser.text("#affected")


def answers(browser: Browser) -> None:
    """Ask for the failure of another service as well."""
    browser.click("tr[data-service=odometry] .name")
    browser.wait("document.querySelector('.left') !== null")
    assert "odometry" in browser.text("#answer")
    browser.press("ESCAPE")


def forgets_nothing(browser: Browser, rover: Rover) -> None:
    """Open a late page, which knows everything; a view that died comes back by itself."""
    kept = {*browser.texts("#timeline summary b")}
    shown = lambda: kept <= {*browser.texts("#timeline summary b")}
    browser.open(rover.address)
    browser.wait(f"{STATE} === 'substituted'")
    wait_until(shown, HEALED_S, "the timeline")
    rover.kill("view")
    browser.wait("!document.querySelector('#lost').hidden")
    browser.wait("document.querySelector('#lost').hidden", HEALED_S * 2)
    browser.wait(f"{STATE} === 'substituted'", HEALED_S)
    wait_until(shown, HEALED_S, "the timeline")


def returns(browser: Browser, rover: Rover) -> None:
    """Start the original again."""
    rover.start("amperemeter")
    browser.wait(f"{STATE} === 'well'", START_S)
    browser.wait("document.querySelector('#robot-state').textContent === 'All well'", HEALED_S)
    browser.wait("document.querySelector('#timeline > li').dataset.state === 'ended'", HEALED_S)
    assert browser.run("document.querySelectorAll('#graph .runs').length") == 0
