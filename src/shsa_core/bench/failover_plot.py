"""The picture of failover.py: a bar for each row at each consumer, grouped by fault."""
from math import inf
from pathlib import Path
from typing import Any, Dict, List, Tuple

import matplotlib.pyplot as plt

from failover_rows import BY_NAME, HOT, WARM, Row
from report import summary
from takeover import Takeover

COLOURS = {
    HOT: "tab:blue",
    f"{HOT}, no bridge": "lightskyblue",
    f"{HOT}, behind a gate": "tab:green",
    WARM: "tab:cyan",
    "cold": "tab:purple",
    "respawn, rospy": "tab:orange",
    "respawn, roscpp": "tab:brown",
    "rosmon, rospy": "tab:pink",
}
OTHER = "tab:gray"
WORDS: Dict[str, Any] = {
    **{"va": "center", "fontsize": 8},
    "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 1.0},
}
LIMITS_MS = (5.0, 20000.0)
GROUP_GAP = 0.3
"""Between two faults, of a bar's width; the name of the fault stands in it."""
PERIODS = 3
PERIOD_MS = 1e3 * Row().period


def plot(rows: Dict[str, List[Takeover]], path: Path) -> None:
    """Draw the rows that have figures, the first on top."""
    found = [BY_NAME[name] for name, takeovers in rows.items() if takeovers]
    if not found:
        return
    places, groups = _layout(found)
    height = 1.4 + 0.24 * -min(places)
    figure, panels = plt.subplots(1, 2, figsize=(10.5, height), sharey=True)
    for axis, consumer in zip(panels, ("rospy", "roscpp")):
        for row, place in zip(found, places):
            _bar(axis, place, row, rows[row.name], consumer)
        axis.axvline(PERIODS * PERIOD_MS, color="black", linewidth=0.8, linestyle=":", zorder=0.5)
        axis.set_xscale("log")
        axis.set_xlim(*LIMITS_MS)
        axis.set_xticks([10, 100, 1000, 10000])
        axis.set_xticklabels(["10 ms", "100 ms", "1 s", "10 s"])
        axis.grid(True, axis="x", alpha=0.3)
        axis.set_axisbelow(True)
        axis.set_title(f"{consumer} consumer", fontsize="medium")
        for side in ("top", "right", "left"):
            axis.spines[side].set_visible(False)
        axis.tick_params(axis="y", length=0)
    panels[0].set_yticks(places)
    panels[0].set_yticklabels([_label(row) for row in found], fontsize=8.5)
    panels[0].set_ylim(min(places) - 0.7, max(groups.values()) + 0.7)
    for fault, place in groups.items():
        panels[0].text(
            *(-0.01, place, fault),
            transform=panels[0].get_yaxis_transform(),
            **{"ha": "right", "va": "center", "fontsize": 9.5, "fontweight": "bold"},
        )
    told = (
        "outage in ms: median / 95th percentile (whisker); hatched: the topic did not become as it "
        f"was while one waited; dotted: {PERIODS} periods at 50 Hz"
    )
    figure.text(0.5, 0.08 / height, told, ha="center", va="bottom", fontsize=8)
    figure.tight_layout(rect=(0.0, 0.22 / height, 1.0, 1.0))
    figure.savefig(str(path), dpi=120)
    plt.close(figure)


def _layout(rows: List[Row]) -> Tuple[List[float], Dict[str, float]]:
    """Return the place of each row, and the name of each fault; the rows are sorted by it."""
    places: List[float] = []
    groups: Dict[str, float] = {}
    place = 0.0
    for row in rows:
        if row.fault not in groups:
            place -= GROUP_GAP if groups else 0.0
            groups[row.fault] = place
            place -= 1.0
        places.append(place)
        place -= 1.0
    return places, groups


def _label(row: Row) -> str:
    return ", ".join(filter(None, (row.contender, row.circumstances)))


def _bar(axis: Any, place: float, row: Row, takeovers: List[Takeover], consumer: str) -> None:
    """One bar, with its figures at its end."""
    median, high, _ = summary([getattr(each, f"{consumer}_ms") for each in takeovers])
    never = summary([each.over_ms for each in takeovers])[0] == inf
    colour = COLOURS.get(row.contender, OTHER)
    end = LIMITS_MS[1] if median == inf else median
    style = {"hatch": "////", "edgecolor": "white", "linewidth": 0.0} if never else {}
    axis.barh(place, end - LIMITS_MS[0], left=LIMITS_MS[0], height=0.8, color=colour, **style)
    if median == inf:
        axis.text(0.8 * end, place, "never", ha="right", **WORDS)
        return
    whisker = min(high, LIMITS_MS[1])
    axis.plot([median, whisker], [place, place], color="black", linewidth=1.0)
    axis.plot([whisker], [place], color="black", marker="|", markersize=6.0)
    figures = f"{median:.0f} / " + ("never" if high == inf else f"{high:.0f}")
    told = figures + (", never over" if never else "")
    axis.text(1.12 * whisker, place, told, **WORDS)
