"""Estimate ink flow from seen line widths (Kalman filter); propose a bounded correction."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from kernels.arrays import BoolArray, FloatArray

# Test whether the amount of ink that is seen answers corrections of the flow.
#
# After a correction by a factor the logarithm of the amount seen moves by the factor's. What a
# picture misreads of all lines alike (halo, blur, level of an edge) hardly changes from look to
# look, so in that difference random uncertainty counts alone. Seen amounts that stay where they
# were are no flow's: what was corrected was how ink looks.
#
# A flow that itself goes on changing mustn't pass for that. So the last blocks before a correction
# are held against the first behind it, each side by the reading that speaks more for an answer.
# Answers to small corrections are added up until they tell.

_PART: Final = 0.5
"""Of what a real change of flow moves the seen amount by: less is no answer."""
_ANSWER_SIGMAS: Final = 2.0
"""Standard uncertainties, on one side."""
_SAME: Final = 1e-3
"""Factors that differ by less are one."""
_PICTURE: Final = 0.015
"""Relative: by which pictures misread the amount differently from each other."""


@dataclass(frozen=True)
class Reading:
    """Logarithms of the amount seen over the one asked for, at one factor.

    Attributes
    ----------
    factor : float
    levels : sequence of float
        Two readings of it: any may be right.
    variance : float
        Of either, without what readings of all pictures share.
    """

    factor: float
    levels: Sequence[float]
    variance: float


@dataclass
class Answers:
    """Corrections since the last one that was surely answered, and what was seen of them.

    Attributes
    ----------
    wanted, seen : float
        Sum of the corrections' logarithms, without sign, and by how much the amount seen moved
        their way.
    variance : float
        Of ``seen``.
    answered : float
        Factor that was in force when corrections were answered last; 1 before any was.
    failed : bool
        Whether corrections weren't answered: widths tell nothing of the flow then.
    told : bool
        Whether the operator knows.
    last : Reading or None
        End of the last look.
    """

    wanted: float = 0.0
    seen: float = 0.0
    variance: float = 0.0
    answered: float = 1.0
    failed: bool = False
    told: bool = False
    last: Reading | None = None

    def learn(
        self, log_ratio: FloatArray, variance: FloatArray, factor: FloatArray, estimate: float
    ) -> None:
        """Take in a look's readings in their order.

        Parameters
        ----------
        log_ratio : (n,) float64
            Logarithm of the amount seen over the one asked for, at factor 1.
        variance : (n,) float64
            Of it, without what all share.
        factor : (n,) float64
            In force.
        estimate : float
            Logarithm of the uncorrected flow, as known before the look.
        """
        for own in np.split(
            np.arange(len(factor)), np.flatnonzero(np.abs(np.diff(factor)) > _SAME) + 1
        ):
            if not len(own):
                continue
            first, last = own[: (len(own) + 1) // 2], own[len(own) // 2 :]
            levels, now = log_ratio[own], float(factor[own[0]])
            if self.last is not None and abs(self.last.factor - now) > _SAME:
                begin = (float(log_ratio[first].mean()), float(levels.mean()))
                self._add(self.last, Reading(now, begin, _of_mean(variance[first])), estimate)
            end = (float(log_ratio[last].mean()), float(log_ratio[last[-1]]))
            self.last = Reading(now, end, _of_mean(variance[last]))

    def _add(self, before: Reading, after: Reading, estimate: float) -> None:
        change = math.log(after.factor / before.factor)
        was = (*before.levels, estimate + math.log(before.factor))
        way = math.copysign(1.0, change)
        moved = max(way * (new - old) for new in after.levels for old in was)
        self.wanted += abs(change)
        self.seen += moved
        self.variance += before.variance + after.variance + 2 * _PICTURE**2
        sure = _ANSWER_SIGMAS * math.sqrt(self.variance)
        if self.seen - _PART * self.wanted > sure:
            self.answered = after.factor
        elif abs(self.seen) > _PART * self.wanted + sure:  # the other way: the flow itself changed
            pass
        elif self.seen - _PART * self.wanted > -sure:
            return  # not told yet
        else:
            self.failed = True
        self.wanted = self.seen = self.variance = 0.0


def _of_mean(variance: FloatArray) -> float:
    return float(variance.mean()) / len(variance)


# Flow by the widths of the last picture alone, and whether it is likely to be off.
#
# What surely is off is corrected (`flow_control`). Widths that light, rims or dim flanks make
# unsure tell less: a flow that is likely off is asked about. Likely is what exceeds the tolerance
# and either the picture's own uncertainty or, since pictures misread alike, that of the change
# since the print's first picture. Once it was asked about, only such a change since then is asked
# about again.

_LIKELY: Final = 2.0
"""Standard uncertainties of a level: one print in twenty that is known no better is asked about (of
a stranger's 26 sound ones 3, by 1.5 it were 5)."""
_KNOWN: Final = 0.075
"""Uncertainty of a level, below which a flow that is 30 % off is corrected without being asked."""
_CHANGED: Final = 3.0
"""The same of a change."""
_OWN: Final = 0.1
"""Of what a picture misreads of all lines alike, as a variance: the next one doesn't."""


@dataclass(frozen=True)
class SeenLevel:
    """Logarithm of delivered over asked flow, without correction.

    Attributes
    ----------
    level : float
    variance : float
        Of it, without what all readings of a picture share.
    common : float
        What they share, relative.
    """

    level: float
    variance: float
    common: float

    @property
    def u(self) -> float:
        """Standard uncertainty."""
        return math.hypot(math.sqrt(self.variance), self.common)

    def u_change(self, other: SeenLevel) -> float:
        """Standard uncertainty of the difference to another picture's."""
        own = _OWN * (self.common**2 + other.common**2) + (self.common - other.common) ** 2
        return math.sqrt(self.variance + other.variance + own + 2 * _PICTURE**2)


@dataclass
class SeenFlow:
    """What pictures alone say of the flow.

    Attributes
    ----------
    first, last : SeenLevel or None
        Of the print's first and last picture that told any width.
    asked : SeenLevel or None
        Of the picture that the operator was asked about last.
    """

    first: SeenLevel | None = None
    last: SeenLevel | None = None
    asked: SeenLevel | None = None

    def learn(self, readings: FloatArray, variance: FloatArray, common: float) -> None:
        """Take in a picture's readings, (n,), in their order: the later half tells what flows."""
        if not len(readings):
            return
        late = slice(len(readings) // 2, None)
        count = len(readings[late])
        level, random = float(readings[late].mean()), float(variance[late].mean()) / count
        self.last = SeenLevel(level, random, common)
        self.first = self.first or self.last

    def likely_off(self, factor: float, tolerance: float) -> bool:
        """Whether the flow by a factor in force is likely off by more than a share."""
        if self.first is None or self.last is None or self.last.u < _KNOWN:
            return False
        least, left = math.log1p(tolerance), abs(self.last.level + math.log(factor))
        before = self.asked or self.first
        changed = abs(self.last.level - before.level)
        surely = changed > max(least, _CHANGED * self.last.u_change(before))
        likely = self.asked is None and left > _LIKELY * self.last.u
        return left > least and (likely or surely)


_STEP_SIGMAS: Final = 3.5
"""Deviation of a reading that may be a step; two in a row by chance: 1 in 4 million pairs."""
_CORRECTION_SIGMAS: Final = 3.29
"""Standard uncertainties beyond the deadband: one in 2,000 by chance, one-sided."""
_WORTH: Final = 0.25
"""Of its standard uncertainty: a smaller change of a factor that corrects already isn't made."""
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
        sigmas = _CORRECTION_SIGMAS if self.factor == 1.0 else _WORTH
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
