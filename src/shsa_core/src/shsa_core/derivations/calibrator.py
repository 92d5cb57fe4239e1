"""Learns by which gain and offset a derived value is that of a sensor, while the sensor lives.

Exponentially weighted least squares of `measured = gain * derived + offset`, step by step: the mean
tells the offset, what both deviate from it the gain. Each is forgotten only as fast as it is
learned anew, after the directional forgetting of R. Kulhavy, "Restricted exponential forgetting in
real-time identification", Automatica 23 (1987): else a robot that stands would forget its gain.

docs/explanation/errors.md tells what teaches, and when.
"""
from collections import deque
from math import ceil, exp, remainder, sqrt, tau
from typing import Collection, Deque, Dict, List, Optional, Tuple

from shsa_core.model.calibration import PRIOR_GAIN, UNCALIBRATED, Calibration
from shsa_core.model.error import Error
from shsa_core.derivations import settings

SOURCE = "compared with the sensor while it lived"


class Calibrator:
    """The calibration of one derivation of one sensor's value.

    `stated`: the rms error that the relation is known to have, in the unit of the value; None: not
    known. `angle`: in rad, of any zero: there is an offset, and no gain. Times in s.
    """

    def __init__(self, stated: Optional[float] = None, angle: bool = False) -> None:
        self._stated, self._angle = stated or 0.0, angle
        self.pull = 0.0  # by how much more its value would be if it followed at once
        self.confirmed = True
        self._taken: Optional[float] = None
        self._waiting: Deque[Tuple[float, float, float]] = deque()
        self._learned: Optional[float] = None
        self._mean_derived = self._mean_residual = self._variance = self._seen = 0.0
        self._slope = _Slope()
        self._gain = _Limited()
        self._shift = _Limited()  # calibrated minus derived, at a fixed derived value
        self._at = 0.0
        self._errors: Deque[Tuple[float, float, float]] = deque(maxlen=settings.ERRORS)
        self._noted: Optional[float] = None
        self._whole = True

    def take(self, time: float, measured: float, derived: float) -> None:
        """Take what a healthy sensor measured, and what was derived at the same time."""
        if not (abs(measured) < settings.LARGEST and abs(derived) < settings.LARGEST):
            return
        if self._taken is not None and time < self._taken:
            self.doubt()
            self._learned = self._noted = None
        self._taken = time
        self._whole = self._whole and measured == int(measured)
        self._waiting.append((time, measured, derived))
        while self._waiting[0][0] <= time - settings.GUARD_S:
            self._learn(*self._waiting.popleft())

    def doubt(self) -> None:
        """Doubt something: what was taken in the last GUARD_S teaches nothing."""
        self._waiting.clear()

    def snapshot(self) -> Calibration:
        """Return gain, offset and error as of GUARD_S before the last sample, or before a doubt.

        Gain 1 and offset 0 where others would not be better, and for what has only been whole
        numbers: they may be states. The error is None until it is known.
        """
        if len(self._errors) < settings.FEWEST_ERRORS:
            return UNCALIBRATED
        calibrated = [each for _, each, _ in self._errors]
        plain = [each for *_, each in self._errors]
        if rms(calibrated) < rms(plain) and not self._whole:
            return Calibration(*self._applied, _error(calibrated))
        return Calibration(error=_error(plain))

    @property
    def errors(self) -> Dict[float, float]:
        """Return by what it erred lately, by the number of the turn."""
        return {turn: error for turn, error, _ in self._errors}

    def aged(self, time: float) -> float:
        """Return the variance that has come since it was learned: its gain may be another."""
        if self._angle or self._learned is None:
            return 0.0
        changes = settings.CHANGES_PER_HOUR * max(0.0, time - self._learned) / 3600.0
        return (1.0 - exp(-changes)) * PRIOR_GAIN**2 * self._variance

    def beyond(self, derived: float) -> float:
        """Return the variance of a derived value by how far it is from all that was seen."""
        off = 0.0 if self._angle else abs(derived - self._mean_derived)
        return (PRIOR_GAIN * max(0.0, off - settings.SEEN * sqrt(self._variance))) ** 2

    def confirms(self, pull: float) -> bool:
        """Tell that the sensor does not pull it the same way as another derivation."""
        same_way = self.pull * pull > 0.0 and abs(self.pull) > settings.SAME_PULL * abs(pull)
        return self._shift.settled and not same_way

    @property
    def keeps(self) -> bool:
        """True while it does not follow its sensor, though they part by more than its error."""
        return not self.confirmed and abs(self.pull) > self._shift.step > 0.0

    @property
    def _applied(self) -> Tuple[float, float]:
        gain = 1.0 + self._gain.value
        return gain, self._shift.value - self._gain.value * self._at

    def _learn(self, time: float, measured: float, derived: float) -> None:
        passed = settings.SAMPLE_S
        if self._learned is not None:
            passed = min(time - self._learned, settings.SAMPLE_COUNTS_S)
        self._learned = time
        residual, mean = measured - derived, self._mean_residual
        if self._angle:
            residual = mean + remainder(residual - mean, tau)
        self._note(time, derived, residual)
        told = self._slope.learn(passed, derived - self._mean_derived, residual - mean)
        self._seen = self._seen * exp(-passed / settings.MEMORY_S) + passed
        off = derived - self._mean_derived
        self._variance += passed / self._seen * (off * off - self._variance)
        self._mean_derived += passed / self._seen * off
        self._mean_residual += passed / self._seen * (residual - mean)
        gain = min(max(self._slope.gain, settings.GAINS[0]), settings.GAINS[1]) - 1.0
        if not self._gain.settled and self._is_as_stated:
            gain = 0.0
        if not self._angle:
            self._gain.follow(gain, passed, told, settings.GAIN_STEP, self.confirmed)
        if not self._shift.settled:
            self._at = self._mean_derived
        shift = self._mean_residual + self._gain.value * (self._at - self._mean_derived)
        if not self._shift.settled and self._is_as_stated:
            shift = 0.0
        learned = self._shift.settled
        self._shift.follow(shift, passed, passed, self._step, self.confirmed)
        self.pull = shift - self._shift.value
        if self._shift.settled and not learned:  # by what it erred while it learned is left out
            for _ in range(len(self._errors) // 2):
                self._errors.popleft()

    @property
    def _is_as_stated(self) -> bool:
        """The relation is about as good as it is known to be: what is learned may be a drift."""
        plain = [each for *_, each in self._errors]
        return bool(plain) and rms(plain) <= settings.AS_STATED * self._stated

    def _note(self, time: float, derived: float, residual: float) -> None:
        """Note what would have been published, less what was measured: before it is learned."""
        known = self._shift.seen >= settings.GUARD_S
        turn = time // (settings.ERRORS_APART * settings.SAMPLE_S)  # the same for all
        if known and turn != self._noted:
            self._noted = turn
            gain, offset = self._applied
            plain = -remainder(residual, tau) if self._angle else -residual
            self._errors.append((turn, (gain - 1.0) * derived + offset - residual, plain))

    @property
    def _step(self) -> float:
        if self._shift.settled:
            return self._shift.step
        late = [each for _, each, _ in self._errors][len(self._errors) // 2 :]
        return max(self._stated, rms(late or [0.0]))


class _Slope:
    """The gain, by exponentially weighted sums of squares and products of deviations.

    A sample counts as far as it deviates, so that a robot that stands forgets nothing.
    """

    def __init__(self) -> None:
        self._derived = self._product = self._residual = self._seen = 0.0

    def learn(self, passed: float, derived: float, residual: float) -> float:
        """Deviations from the means in `passed` s; the seconds by which it tells of a gain."""
        usual = self._derived / settings.MEMORY_S
        told = passed * (min(1.0, derived * derived / usual) if usual > 0.0 else 1.0)
        kept = exp(-told / settings.MEMORY_S)
        self._seen = kept * self._seen + told
        self._derived = kept * self._derived + told * derived * derived
        self._product = kept * self._product + told * derived * residual
        self._residual = kept * self._residual + told * residual * residual
        return told if self._excited else 0.0

    @property
    def _excited(self) -> bool:
        return self._derived > settings.EXCITED * self._residual

    @property
    def gain(self) -> float:
        """1 while too little is known of it."""
        if not self._excited:
            return 1.0
        expected = self._residual / max(self._seen, settings.SAMPLE_COUNTS_S) / PRIOR_GAIN**2
        return 1.0 + self._product / (self._derived + expected)


class _Limited:
    """A number that follows another one: at once until it is settled, then slowly if confirmed.

    `seen`: s of data that tell of it; `step`: what it moves by in DRIFT_S at most.
    """

    def __init__(self) -> None:
        self.value = self.seen = self.step = 0.0

    @property
    def settled(self) -> bool:
        return self.seen >= settings.SETTLING_S

    def follow(
        self, wanted: float, passed: float, told: float, step: float, confirmed: bool
    ) -> None:
        """`passed` s of data came, of which `told` tell of it. The rest counts once it settles."""
        if not self.settled:
            self.value, self.step, self.seen = wanted, step, self.seen + told
        elif confirmed:
            most = self.step * passed / settings.DRIFT_S
            self.value += min(max(wanted - self.value, -most), most)


def rms(values: Collection[float]) -> float:
    """Return the root mean square of some values."""
    return sqrt(sum(value * value for value in values) / len(values))


def _error(values: List[float]) -> Error:
    count, sizes = len(values), sorted(abs(value) for value in values)
    p95 = sizes[ceil(0.95 * count) - 1]
    return Error(rms(values), sum(values) / count, p95, n=count, source=SOURCE)
