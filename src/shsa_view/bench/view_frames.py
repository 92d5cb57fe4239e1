"""Frames a second of the live view in Chromium, with 200 services.

Once of a real robot at 5 Hz, whose rows change once a second, and once as the server is fed: all
rows change ten times a second, the most that it tells. The goal for the robot: 60 frames a second.
Writes results/bench/view_frames.csv.
"""
import sys
import threading
import time
from pathlib import Path
from typing import Dict, List

from graph import Graph, ask_to_leave
from report import Goals, arguments, print_table, write_table
from view_price import TOPICS, started

sys.path.append(str(Path(__file__).resolve().parent.parent / "test" / "browser"))
from chromium import Browser  # noqa: E402
from documents import drawing_of, large  # noqa: E402
from fed import Fed  # noqa: E402

PERIOD_S, TICK_S = 0.2, 0.1
SETTLING_S = 3.0
PORT = 18998
LATE_MS = 20.0
"""A frame that took longer was missed: at 60 Hz one takes 16.7 ms."""
LEAST_FRAMES = 59.0
COLUMNS = ("rows", "frames_per_s", "p99_ms", "longest_ms", "late_percent")
WATCH = """(window.frames_seen = [], requestAnimationFrame(function each(time) {
  frames_seen.push(time);
  requestAnimationFrame(each);
}))"""


def frames(browser: Browser, address: str, seconds: float) -> Dict[str, object]:
    """Return what the frames of a page took."""
    browser.open(address)
    browser.wait("document.querySelector('#graph svg') !== null", 60.0)
    time.sleep(SETTLING_S)
    browser.run(WATCH)
    time.sleep(seconds)
    seen: List[float] = browser.run("frames_seen")
    took = sorted(later - sooner for sooner, later in zip(seen, seen[1:]))
    return {
        "frames_per_s": round(1000.0 * len(took) / (seen[-1] - seen[0]), 1),
        "p99_ms": round(took[int(0.99 * len(took))], 1),
        "longest_ms": round(took[-1], 1),
        "late_percent": round(100.0 * sum(each > LATE_MS for each in took) / len(took), 2),
    }


def change(fed: Fed, ended: threading.Event) -> None:
    """Change all rows again and again."""
    while not ended.wait(TICK_S):
        rows = {}
        for name, row in fed.state.whole["services"].items():
            values = {
                each: {**p, "value": p["value"] + 0.1} for each, p in row["properties"].items()
            }
            rows[name] = {**row, "properties": values, "strip": row["strip"][1:] + "w"}
        fed.state.tell(services=rows)


def of_fed_rows(browser: Browser, seconds: float) -> Dict[str, object]:
    """Measure the page while all rows change."""
    fed, ended = Fed(large(TOPICS)), threading.Event()
    fed.answers.drawing = drawing_of(fed.state.whole["services"])
    thread = threading.Thread(target=change, args=(fed, ended))
    thread.start()
    try:
        return frames(browser, fed.address, seconds)
    finally:
        ended.set()
        thread.join()
        browser.driver.get("about:blank")
        fed.close()


def main() -> None:
    """Measure, print a table, write the CSV file."""
    options = arguments(__doc__, "seconds", 20, "4 s each")
    browser = Browser()
    seconds = 4.0 if options.short else options.seconds
    rows: List[Dict[str, object]] = [{"rows": "10 times a second", **of_fed_rows(browser, seconds)}]
    with Graph() as graph:
        processes = started(graph, PERIOD_S, PORT)
        address = f"http://127.0.0.1:{PORT}/"
        rows.append({"rows": "of a robot", **frames(browser, address, seconds)})
        browser.close()
        for process in reversed([*processes.values()]):
            ask_to_leave(process)
    told = [[str(row[name]) for name in COLUMNS] for row in rows]
    write_table(options.results / "view_frames.csv", COLUMNS, told)
    print_table(f"Frames of the view of {TOPICS} services", COLUMNS, told)
    goals = Goals()
    measured = float(str(rows[-1]["frames_per_s"]))
    goals.at_least("frames a second", f"view of {TOPICS} services", LEAST_FRAMES, measured)
    goals.show(options.results / "view_frames_goals.csv")


if __name__ == "__main__":
    main()
