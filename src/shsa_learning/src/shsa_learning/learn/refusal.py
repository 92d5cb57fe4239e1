"""Reasons not to learn from recorded data, with their figures."""
from typing import Dict, Iterator, List, Mapping, NamedTuple, Optional, Sequence, Tuple

import numpy as np
from scipy.ndimage import uniform_filter1d

from shsa_learning.figures import rms
from shsa_learning.learn.selection import OUTER
from shsa_learning.learn.table import Table, block_numbers

SHORTEST_S = 60.0
MANY = 0.05  # outliers, of all values: who has more of them has another trouble
SKILL = 0.3
BLOCKED_TO_SHUFFLED = 2.0
EXCITED_BLOCKS = 3
EXCITED = 0.15  # of the whole deviation: what an input must vary by within a block
COPY = 0.999  # correlation, value by value and step by step
SAME_NOISE = 0.3  # of the target's noise: who leaves less of it has read it
TELLING = 0.98  # of the target's variance: what an input that was computed from it tells alone
NOISY = 0.3  # of the target's deviation: quick changes above it are what the target is made of
OWN_NOISE = 0.01  # of the target's deviation: as much noise of its own is left by another sensor
WHITE, LIKE_NOISE = 0.5, -0.6
"""Neighbouring values of white noise correlate by 0; its second differences by -2/3, while those of
a rough signal, as a random walk, do by -1/2."""
PERFECT = 1e-3  # of the target's deviation
FOLLOWED = 0.15  # skill for the changes of the target; of what only drifts it is about 0 or less
STRETCHES = 30, 100, 300, 1000  # whose means are compared: changes fast or slow, noise averaged
CERTAIN = 5.0  # standard errors, of a coefficient in one block
WEIGHTY = 0.1  # of the target's deviation, what a term gives in a block


def of_target(table: Table, outliers: int) -> List[str]:
    """Return why nothing should be learned of the target of these rows; empty: it will do.

    `outliers`: how many of its values were left out.
    """
    if table.duration < SHORTEST_S:
        return [
            f"{table.duration:.0f} s of data in which {table.name} and every input have a "
            f"value; {SHORTEST_S:.0f} s are the least"
        ]
    if outliers > MANY * len(table.time):
        return [f"{100.0 * outliers / len(table.time):.0f} % of {table.name} are outliers"]
    rows = table.rows()
    why = too_still(table.target[rows], table.time[rows])
    return [f"{table.name} {why}"] if why else []


class Leak(NamedTuple):
    """An input that seems computed from the target: what it tells of it, alone and at once."""

    name: str
    share: float
    noise: float


def leaks(table: Table) -> List[Leak]:
    """Return the inputs that tell the target at once, its noise included."""
    known = table.complete
    found = (_leak(n, table.inputs[n][known], table.target[known]) for n in table.names)
    return [leak for leak in found if leak is not None]


def _leak(name: str, values: np.ndarray, target: np.ndarray) -> Optional[Leak]:
    if is_constant(values) or is_constant(target):
        return None
    # The mean of the target where the input has nearly this value, whatever the function is.
    order = np.argsort(values, kind="stable")
    near = np.empty_like(target)
    near[order] = uniform_filter1d(target[order], max(5, len(target) // 100), mode="nearest")
    left = target - near
    share = 1.0 - float(np.var(left) / np.var(target))
    noise = noise_left(left, target)
    return Leak(name, share, noise) if share > TELLING and noise < SAME_NOISE else None


def noise_left(left: np.ndarray, target: np.ndarray) -> float:
    """Return the share of the target's noise that a model leaves: about 1 or more if it is honest.

    1 where the target's quick changes are no noise.
    """
    whole = float(np.median(np.abs(np.diff(target, 2))))
    if not 0.0 < whole < NOISY * float(np.std(target)):
        return 1.0
    rough = _neighbours(np.diff(target, 2)) > LIKE_NOISE
    if rough and _neighbours(left) < WHITE and np.std(left) > OWN_NOISE * np.std(target):
        return 1.0
    return float(np.median(np.abs(np.diff(left, 2)))) / whole


def _neighbours(values: np.ndarray) -> float:
    """Return the correlation of each value with the next."""
    off = values - np.mean(values)
    squares = float(np.sum(off * off))
    return float(np.sum(off[1:] * off[:-1])) / squares if squares > 0.0 else 0.0


def leak_text(target: str, leak: Leak) -> str:
    told = 100.0 * (1.0 - min(leak.noise, 1.0))
    return (
        f"{leak.name} seems to be computed from {target}: alone and at once it tells "
        f"{100.0 * leak.share:.2f} % of its variance, and {told:.0f} % of its noise"
    )


def duplicates(table: Table) -> Dict[str, str]:
    """Return the inputs that say the same as another before them, and which."""
    rows = table.complete
    found: Dict[str, str] = {}
    names = [name for name in table.names if not is_constant(table.inputs[name][rows])]
    for place, name in enumerate(names):
        for other in names[:place]:
            one, two = table.inputs[name][rows], table.inputs[other][rows]
            if other not in found and _alike(one, two) and _alike(np.diff(one), np.diff(two)):
                found[name] = other
                break
    return found


def _alike(one: np.ndarray, two: np.ndarray) -> bool:
    if np.std(one) == 0.0 or np.std(two) == 0.0:
        return False
    return abs(float(np.corrcoef(one, two)[0, 1])) > COPY


def of_model(
    off: np.ndarray,
    mean_off: np.ndarray,
    block: np.ndarray,
    target: np.ndarray,
    errors: Mapping[str, float],
) -> List[str]:
    """Return why a model should not be used, by its error and the mean's on unseen rows.

    `errors` by `blocked` and `shuffled` rows.
    """
    reasons = []
    model, mean = rms(off), rms(mean_off)
    skill = 1.0 - model / mean if mean > 0.0 else 0.0
    if not skill >= SKILL:
        reasons.append(
            f"a skill of {skill:.2f} against the mean (RMS error {model:.4g} instead of "
            f"{mean:.4g}); {SKILL:g} is the least"
        )
    worst = worst_block(off, block)
    if not worst <= mean:
        reasons.append(f"in its worst block it errs by {worst:.4g}, the mean by {mean:.4g} overall")
    if not errors["blocked"] <= BLOCKED_TO_SHUFFLED * errors["shuffled"]:
        reasons.append(
            f"an RMS error of {errors['blocked']:.4g} on blocks of time and of "
            f"{errors['shuffled']:.4g} on rows drawn at random: it has learned the moment; "
            f"at most {BLOCKED_TO_SHUFFLED:g} times as much is allowed"
        )
    followed = follows(off, target)
    if followed < FOLLOWED:
        reasons.append(
            f"it does not follow the changes of what it tells: a skill of {followed:.2f} for "
            f"these, {FOLLOWED:g} is the least; what drifts seems to tell whatever else drifts"
        )
    return reasons


def follows(off: np.ndarray, target: np.ndarray) -> float:
    """Return the skill of a model for changes of the target, at the pace at which it is best.

    Two random walks often seem to tell each other (C. W. J. Granger, P. Newbold, "Spurious
    regressions in econometrics", Journal of Econometrics 2, 1974); their changes never do.
    """
    found = [-np.inf]
    for count in (each for each in STRETCHES if 2 * each <= len(off)):
        left, whole = (rms(_changes(values, count)) for values in (off, target))
        found.append(1.0 - left / whole if whole > 0.0 else -np.inf)
    return float(max(found)) if len(found) > 1 else 1.0


def _changes(values: np.ndarray, count: int) -> np.ndarray:
    """From one stretch of `count` to the next, each by its mean; less a trend that all share."""
    edges = np.arange(count) * len(values) // count
    means = np.add.reduceat(values, edges) / np.diff(np.append(edges, len(values)))
    steps = np.diff(means)
    return steps - np.mean(steps)


def worst_block(off: np.ndarray, block: np.ndarray) -> float:
    """Return the largest RMS error in a block."""
    return max(rms(off[block == number]) for number in np.unique(block))


def too_perfect(
    property: str, inputs: Sequence[str], off: np.ndarray, target: np.ndarray
) -> List[str]:
    """Return why a model that errs less than the target's noise must have seen the target.

    `off` and `target` of all rows, one after the other.
    """
    left, whole = float(np.std(off)), float(np.std(target))
    told = 1.0 - (left / whole) ** 2
    noise = noise_left(off, target)
    if left >= PERFECT * whole and not (told > TELLING and noise < SAME_NOISE):
        return []
    return [
        f"it tells {property} at once to {100.0 * left / whole:.2g} % of its deviation, and "
        f"{100.0 * (1.0 - min(noise, 1.0)):.0f} % of its noise: no other sensor knows that, so an "
        f"input is computed from it ({', '.join(inputs)})"
    ]


def flipping(
    names: Sequence[str], columns: np.ndarray, target: np.ndarray, block: np.ndarray
) -> List[str]:
    """Return the terms, by name, whose coefficient surely has one sign here and the other there."""
    signs: Dict[int, List[Tuple[int, float]]] = {}
    for number in np.unique(block):
        rows = block == number
        for term, coefficient in _certain(columns[rows], target[rows], columns, target):
            signs.setdefault(term, []).append((int(number), coefficient))
    reasons = []
    for term, seen in sorted(signs.items()):
        (low, least), (high, most) = (f(seen, key=lambda each: each[1]) for f in (min, max))
        if least < 0.0 < most:
            reasons.append(
                f"the coefficient of {names[term]} flips its sign: {least:.3g} in block {low + 1}, "
                f"{most:.3g} in block {high + 1}"
            )
    return reasons


def _certain(
    columns: np.ndarray, target: np.ndarray, every: np.ndarray, all_targets: np.ndarray
) -> Iterator[Tuple[int, float]]:
    """Yield the coefficients in one block that are surely not 0 and matter: number and value."""
    varied = np.std(columns, axis=0) > EXCITED * np.std(every, axis=0)
    numbers = np.flatnonzero(varied)
    if len(numbers) == 0 or len(target) < 4 * len(numbers):
        return
    design = columns[:, numbers] - np.mean(columns[:, numbers], axis=0)
    inverse = np.linalg.pinv(design.T @ design)
    found = inverse @ design.T @ (target - np.mean(target))
    left = target - np.mean(target) - design @ found
    # Neighbouring residuals are alike: they tell less than their number says.
    alike = min(max(float(np.corrcoef(left[1:], left[:-1])[0, 1]), 0.0), 0.99)
    rows = max(len(left) * (1.0 - alike) / (1.0 + alike) - len(numbers), 1.0)
    errors = np.sqrt(np.maximum(np.diag(inverse), 0.0) * len(left) * np.var(left) / rows)
    weight = np.abs(found) * np.std(design, axis=0)
    sure = (np.abs(found) > CERTAIN * errors) & (weight > WEIGHTY * np.std(all_targets))
    for place in np.flatnonzero(sure):
        yield int(numbers[place]), float(found[place])


def too_still(values: np.ndarray, time: np.ndarray) -> str:
    """Return why values, each at a `time` (s), do not vary enough; empty if they do."""
    if is_constant(values):
        return f"is constant ({values[0]:g})" if len(values) else "has no value"
    least, blocks = EXCITED * float(np.std(values)), block_numbers(time, OUTER)
    numbers = np.unique(blocks)
    varies = sum(float(np.std(values[blocks == each])) > least for each in numbers)
    told = f"varies in {varies} of {len(numbers)} blocks of time; {EXCITED_BLOCKS} are the least"
    return told if varies < EXCITED_BLOCKS else ""


def is_constant(values: np.ndarray) -> bool:
    """Return whether values are the same but for rounding."""
    return float(np.ptp(values)) <= 1e-9 * float(np.max(np.abs(values))) if len(values) else True
