"""Estimate ink flow from seen line widths (Kalman filter); propose a bounded correction factor.

The estimate is that of the flow *without* correction, over the flow that was asked for: what the
factor in force added is taken out of each reading first. The factor is its inverse within bounds.
So nothing integrates while the factor stands at a bound (no wind-up), and a reading of lines that
were written under an older factor does no harm.

Estimator: Kalman filter of the logarithm of that ratio, a random walk (Kalman 1960, J. Basic Eng.
82, 35, doi 10.1115/1.3662552). Two readings in a row far from it, on one side, are a step: the
filter then forgets what it knew.

A calibrated ink flows as asked, until a deviation is seen beyond doubt: corrected is first what
exceeds the deadband by so many standard uncertainties that noise does it once in 2,000 looks.
From then on nothing speaks for the factor in force any more, and the best estimate is followed, but
for changes that are smaller than a quarter of its own uncertainty. What a picture misreads of all
lines alike the next one misreads in part, too: so a picture that is less sure than what is known
hardly moves the estimate, and many together know no better than the best.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray
from printctl.observe.deciding.answers import Answers
from printctl.observe.deciding.seen_flow import SeenFlow

_STEP_SIGMAS: Final = 3.5
"""Deviation of a reading that may be a step; two in a row by chance: 1 in 4 million pairs."""
_SURE: Final = 3.29
"""Standard uncertainties beyond the deadband: one in 2,000 by chance, one-sided."""
_WORTH: Final = 0.25
"""Of its standard uncertainty: a smaller change of a factor that corrects already isn't made."""
_SAME: Final = 1e-3
"""Factors that differ by less are one."""
_PICTURE: Final = 0.015
"""What widths of a picture may be off by, relative, beyond what it says itself: other ink below."""
_ALIKE: Final = 0.7
"""Of what a picture misreads of all lines alike, as a variance: the next one does so, too."""
_LEAST_U: Final = 0.005
"""No reading of a ratio is better than 0.5 %: the expected width itself is rounded and modelled."""


@dataclass(frozen=True)
class FlowBlocks:
    """Seen over expected cross-section, in the order of writing.

    Attributes
    ----------
    time_s : (n,) float64, s
        Middle of each block of writing, on one clock.
    area_ratio : (n,) float64
        Cross-section seen over the one asked for.
    u : (n,) float64
        Standard uncertainty of that ratio.
    factor : (n,) float64
        Flow factor in force when the block was written.
    u_common : float
        Relative standard uncertainty that all of them share (where an edge lies in a picture).
    """

    time_s: FloatArray
    area_ratio: FloatArray
    u: FloatArray
    factor: FloatArray
    u_common: float = 0.0

    def __len__(self) -> int:
        return len(self.time_s)


@dataclass(frozen=True)
class FlowLimits:
    """Bounds of the controller.

    Attributes
    ----------
    low, high : float
        Least and greatest factor.
    deadband : float
        Smaller deviations aren't corrected.
    drift_per_root_s : float
        Standard deviation of the logarithm's random walk after 1 s of writing.
    steps_per_unit : float
        Steps of the factor that the firmware takes (Marlin's M221: whole percent).
    """

    low: float = 0.6
    high: float = 1.7
    deadband: float = 0.02
    drift_per_root_s: float = 0.003
    steps_per_unit: float = 100.0


@dataclass
class FlowControl:
    """Flow estimate of one head, and the factor that corrects it.

    Attributes
    ----------
    limits : FlowLimits
    factor : float
        In force.
    log_flow, variance : float
        Estimate of the logarithm of delivered over asked flow, uncorrected, and its variance.
    time_s : float or None, s
        Of the last reading.
    common : float
        Part of its uncertainty that readings of a picture share.
    answers : Answers
        Whether the amount seen answers corrections.
    seen : SeenFlow
        What pictures alone say of the flow.
    beyond_said : bool
        Whether a look that told no width has paused for a flow beyond all bounds.
    """

    limits: FlowLimits = field(default_factory=FlowLimits)
    factor: float = 1.0
    log_flow: float = 0.0
    variance: float = 0.01
    time_s: float | None = None
    common: float = 0.0
    answers: Answers = field(default_factory=Answers)
    seen: SeenFlow = field(default_factory=SeenFlow)
    beyond_said: bool = False
    _far: float = 0.0
    _known: float = 0.01

    def learn(self, blocks: FlowBlocks) -> None:
        """Take in readings; those without a positive finite ratio are left out."""
        sound = np.isfinite(blocks.area_ratio) & (blocks.area_ratio > 0) & np.isfinite(blocks.u)
        log_ratio, variance, factor = _random(blocks, sound)
        self.answers.learn(log_ratio, variance, factor, self.log_flow)
        self.seen.learn(log_ratio - np.log(factor), variance, blocks.u_common)
        self._known = self.variance
        for k in np.flatnonzero(sound).tolist():
            ratio = float(blocks.area_ratio[k])
            u = max(float(blocks.u[k]) / ratio, _LEAST_U)
            reading = math.log(ratio) - math.log(float(blocks.factor[k]))
            self._update(float(blocks.time_s[k]), reading, u, blocks.u_common, int(sound.sum()))
        if sound.any():  # more readings of one picture don't tell what they share
            self.variance = max(self.variance, min(self._known, blocks.u_common**2))
            self.common = min(math.sqrt(self.variance), blocks.u_common)

    def _update(self, time_s: float, reading: float, u: float, common: float, count: int) -> None:
        """Take in one of so many readings of a picture, which share a part of their uncertainty."""
        passed = max(time_s - self.time_s, 0.0) if self.time_s is not None else 0.0
        self.time_s = time_s
        self.variance += self.limits.drift_per_root_s**2 * passed
        off = reading - self.log_flow
        sigmas = off / math.sqrt(self._variance_of_change(u, common))
        own = u * u + (count - 1) * min(common, u) ** 2  # so that all together know no better
        step = abs(sigmas) > _STEP_SIGMAS
        if step and self._far * sigmas > 0:  # the second in a row on this side
            self.variance = self._known = max(self.variance, off * off)
        elif step:  # an outlier until the next reading says the same
            self._far = sigmas
            return
        self._far = sigmas if step else 0.0
        alike = _ALIKE * self._shared(u, common)  # Kalman gain for errors that are correlated
        gain = (self.variance - alike) / (self.variance + own - 2.0 * alike)
        self.log_flow += gain * off
        self.variance -= gain * (self.variance - alike)

    def _variance_of_change(self, u: float, common: float) -> float:
        """Variance of a reading less the estimate: what both share cancels, but for pictures."""
        both = self.variance + u * u - 2.0 * self._shared(u, common)
        return max(both, 2.0 * _PICTURE**2)

    def _shared(self, u: float, common: float) -> float:
        """Variance that a reading and the estimate share."""
        return min(self.common**2, self.variance, common**2, u * u)

    @property
    def flow(self) -> float:
        """Delivered over asked flow, without correction."""
        return math.exp(self.log_flow)

    @property
    def u_flow(self) -> float:
        """Standard uncertainty of `flow`."""
        return self.flow * math.sqrt(self.variance)

    @property
    def out_of_bounds(self) -> bool:
        """Whether no allowed factor corrects the flow, beyond doubt and the deadband."""
        if self.answers.failed:
            return False  # nothing is known of it
        wanted, sure = -self.log_flow, 2.0 * math.sqrt(self.variance) + self.limits.deadband
        return not (math.log(self.limits.low) - sure <= wanted <= math.log(self.limits.high) + sure)

    def proposal(self) -> float | None:
        """Return the factor that is due; None where the one in force is as good as known.

        Corrected is what exceeds the deadband: of a flow that isn't corrected yet, beyond doubt, of
        another by a quarter of its uncertainty. Where corrections weren't answered it is the last
        one that was.
        """
        if self.answers.failed:
            answered = round(self.answers.answered, 4)
            return None if abs(self.factor - answered) < _SAME else answered
        left = self.log_flow + math.log(self.factor)
        sigmas = _SURE if self.factor == 1.0 else _WORTH
        doubt = sigmas * math.hypot(math.sqrt(self.variance), _PICTURE)
        if abs(left) <= self.limits.deadband + doubt:
            return None
        rounded = self._allowed(self.log_flow)
        return None if rounded == self.factor else rounded

    def by_last_picture(self) -> float | None:
        """Return the factor that the last picture alone asks for; None where it tells no width."""
        return None if self.seen.last is None else self._allowed(self.seen.last.level)

    def _allowed(self, log_flow: float) -> float:
        """Factor that corrects a flow, within bounds, in steps of the firmware."""
        per = self.limits.steps_per_unit
        wanted = min(max(math.exp(-log_flow), self.limits.low), self.limits.high)
        return round(wanted * per) / per

    def put_in_force(self, factor: float) -> None:
        """Take notice that the printer has a factor.

        The first correction says what flows: by the estimate, or by what the operator approved.
        """
        if self.factor == 1.0 != factor:
            self.log_flow = -math.log(factor)
        self.factor = factor


def _random(blocks: FlowBlocks, sound: BoolArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Logarithm of the ratio seen, its variance without what all share, and the factor."""
    ratio = blocks.area_ratio[sound]
    variance = np.maximum((blocks.u[sound] / ratio) ** 2 - blocks.u_common**2, _LEAST_U**2)
    return np.log(ratio), variance, blocks.factor[sound]
