"""The picture of failover.py: what every outage is made of, and how the outages spread."""
from pathlib import Path
from typing import Dict, List

import matplotlib.pyplot as plt
import numpy as np

from takeover import STEPS, Takeover


def plot(rows: Dict[str, List[Takeover]], path: Path) -> None:
    """Draw the rows that have figures, the first on top."""
    names = [name for name, takeovers in rows.items() if takeovers][::-1]
    if not names:
        return
    figure, (shares, spread) = plt.subplots(
        1, 2, figsize=(14, 1.5 + 0.5 * len(names)), sharey=True, constrained_layout=True
    )
    places = np.arange(len(names))
    healed = [i for i, name in enumerate(names) if rows[name][0].substitute]
    left = np.zeros(len(healed))
    means = np.array(
        [[np.mean([getattr(t, s + "_ms") for t in rows[names[i]]]) for s in STEPS] for i in healed]
    ).reshape(len(healed), len(STEPS))
    means = 100.0 * means / means.sum(axis=1, keepdims=True)
    for number, step in enumerate(STEPS):
        shares.barh(healed, means[:, number], left=left, label=step)
        left += means[:, number]
    shares.set_yticks(places)
    shares.set_yticklabels(names)
    shares.set_xlabel("share of each step in the outage at the rospy consumer, %")
    shares.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=len(STEPS), fontsize="small")
    for offset, consumer, colour in ((0.2, "rospy", "tab:blue"), (-0.2, "roscpp", "tab:orange")):
        boxes = spread.boxplot(
            [[getattr(t, consumer + "_ms") for t in rows[name]] for name in names],
            positions=places + offset,
            widths=0.35,
            vert=False,
            whis=(5, 95),
            manage_ticks=False,
            flierprops={"markersize": 3},
            boxprops={"color": colour},
            medianprops={"color": colour},
        )
        boxes["boxes"][0].set_label(f"{consumer} consumer")
    spread.set_xscale("log")
    spread.grid(True, axis="x", which="both", alpha=0.3)
    spread.set_xlabel("outage, ms: quartiles, whiskers at 5 and 95 %")
    spread.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=2, fontsize="small")
    figure.savefig(str(path), dpi=120)
    plt.close(figure)
