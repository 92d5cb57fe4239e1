"""The pictures of truth.py: the error of the state of charge, and of the current, by world."""
from pathlib import Path
from typing import List, Mapping, Sequence, Tuple

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402

from healed import WAYS, Outcome  # noqa: E402

CHARGE_GOAL, NRMSE_GOAL = 0.1, 4.0
LEAST = 1e-4  # percentage points: what is better is drawn there


def plot(table: Mapping[Tuple[str, str], List[Outcome]], worlds: Sequence[str], path: Path) -> None:
    """Box plots, a group for each world and a box for each way."""
    figure, (above, below) = plt.subplots(2, 1, figsize=(12, 9), sharex=True)
    colours = plt.get_cmap("tab10").colors
    for number, way in enumerate(WAYS):
        places = np.arange(len(worlds)) + (number - (len(WAYS) - 1) / 2.0) * 0.13
        charges = [[max(LEAST, o.charge_error) for o in table[world, way]] for world in worlds]
        shares = [[o.nrmse for o in table[world, way]] for world in worlds]
        for axes, values in ((above, charges), (below, shares)):
            drawn = axes.boxplot(
                values,
                positions=places,
                widths=0.11,
                whis=(5, 95),
                manage_ticks=False,
                patch_artist=True,
                flierprops={"markersize": 2},
                medianprops={"color": "black"},
            )
            for box in drawn["boxes"]:
                box.set_facecolor(colours[number])
            drawn["boxes"][0].set_label(way)
    above.set_yscale("log")
    above.axhline(CHARGE_GOAL, color="grey", linestyle="--", label="goal of the median")
    above.set_ylabel("error of the state of charge at the end,\npercentage points")
    above.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncol=4, fontsize="small")
    below.axhline(NRMSE_GOAL, color="grey", linestyle="--")
    below.set_ylabel("NRMSE of the current, %")
    below.set_ylim(bottom=0.0)
    below.set_xticks(np.arange(len(worlds)))
    below.set_xticklabels([world.replace("_", " ") for world in worlds])
    for axes in (above, below):
        axes.grid(True, axis="y", which="major", alpha=0.3)
    figure.tight_layout()
    figure.savefig(str(path), dpi=100)
    plt.close(figure)
