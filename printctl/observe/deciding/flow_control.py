"""Estimate ink flow from seen line widths (Kalman filter); propose a bounded correction.

Two things are estimated together: the flow, which drifts slowly and may step, and what pictures
misread of all lines alike (halo, blur, level of an edge), which hardly changes in the same light.
A look measures their sum. So a change is known well, a level only as well as a picture's shapes
show it, and an operator who has looked at the lines fixes the level for all later looks.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from kernels.arrays import FloatArray

# After a correction by a factor the logarithm of the amount seen moves by the factor's. What a
# picture misreads of all lines alike cancels there. Seen amounts that stay where they were are no
# flow's: what was corrected was how ink looks.
#
# A flow that itself goes on changing mustn't pass for that. So the last blocks before a correction
# are held against the first behind it, each side by the reading that speaks more for an answer.
# Responses to small corrections are added up until they are significant.
_MIN_RESPONSE_SHARE: Final = 0.5
"""Least share of a correction by which a real flow moves the amount seen."""
_ANSWER_SIGMAS: Final = 2.0
"""Standard uncertainties, on one side."""
_SAME_FACTOR: Final = 1e-3
"""Factors that differ by less are equal."""
_PICTURE_SCATTER: Final = 0.015
"""Relative scatter of the amount between pictures."""


@dataclass(frozen=True)
class Reading:
    """Logarithms of the amount seen over the requested one, at one factor.

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
class CorrectionResponse:
    """Response of the amount seen to flow corrections since the last confirmed one.

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
        Whether corrections had no effect: widths say nothing of the flow then.
    told : bool
        Whether the operator was informed.
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
        """Update by a look's readings in their order.

        Parameters
        ----------
        log_ratio : (n,) float64
            Logarithm of the amount seen over the requested one, at factor 1.
        variance : (n,) float64
            Of it, without what all share.
        factor : (n,) float64
            In force.
        estimate : float
            Logarithm of the uncorrected flow, as known before the look.
        """
        for own in np.split(
            np.arange(len(factor)), np.flatnonzero(np.abs(np.diff(factor)) > _SAME_FACTOR) + 1
        ):
            if not len(own):
                continue
            first, last = own[: (len(own) + 1) // 2], own[len(own) // 2 :]
            levels, now = log_ratio[own], float(factor[own[0]])
            if self.last is not None and abs(self.last.factor - now) > _SAME_FACTOR:
                begin = (float(log_ratio[first].mean()), float(levels.mean()))
                after = Reading(now, begin, _variance_of_mean(variance[first]))
                self._add(self.last, after, estimate)
            end = (float(log_ratio[last].mean()), float(log_ratio[last[-1]]))
            self.last = Reading(now, end, _variance_of_mean(variance[last]))

    def _add(self, before: Reading, after: Reading, estimate: float) -> None:
        change = math.log(after.factor / before.factor)
        was = (*before.levels, estimate + math.log(before.factor))
        way = math.copysign(1.0, change)
        moved = max(way * (new - old) for new in after.levels for old in was)
        self.wanted += abs(change)
        self.seen += moved
        self.variance += before.variance + after.variance + 2 * _PICTURE_SCATTER**2
        sure = _ANSWER_SIGMAS * math.sqrt(self.variance)
        if self.seen - _MIN_RESPONSE_SHARE * self.wanted > sure:
            self.answered = after.factor
        elif abs(self.seen) > _MIN_RESPONSE_SHARE * self.wanted + sure:
            pass  # the other way: the flow itself changed
        elif self.seen - _MIN_RESPONSE_SHARE * self.wanted > -sure:
            return  # not significant yet
        else:
            self.failed = True
        self.wanted = self.seen = self.variance = 0.0


def _variance_of_mean(variance: FloatArray) -> float:
    return float(variance.mean()) / len(variance)


_STEP_SIGMAS: Final = 3.5
"""Deviation of a reading that may be an outlier, and of several in a row that are a step."""
_MAX_COUNTED_SIGMAS: Final = 3.0
"""Standard uncertainties to which one reading's deviation is clipped there."""
_DEVIATION_MEMORY: Final = 0.7
"""Factor on earlier deviations from reading to reading."""
_FALSE_CORRECTION_COST_LOOKS: Final = 60.0
"""Cost of a needless first correction, in looks of an operator."""
_MIN_CHANGE_SIGMAS: Final = 0.25
"""Least change of a correcting factor, in its standard uncertainties."""
_MISREAD_PERSISTENCE: Final = 0.9
"""Share of the common misread's variance that the next picture has, too."""
_MIN_RELATIVE_U: Final = 0.005
"""No reading of a ratio is better than 0.5 %: the expected width itself is rounded and modelled."""
_PRIOR_FLOW_SD: Final = 0.1
"""Standard deviation of a flow's logarithm before anything is seen of it."""
_FLOW_STEP_VARIANCE: Final = 0.02 * 0.25**2
"""Variance of its change from look to look: in one of fifty it steps, by a quarter."""
_OPERATOR_SD: Final = 0.05
"""Relative: how well an operator who looked at the lines knows their ink."""
_LOOK_WORTH_LOG_FLOW: Final = 0.115
"""Log flow error worth one operator's look; cost grows with its square."""
_MIN_WIDTH_RESPONSE: Final = 0.6
"""Least share of a log flow error that widths show: lines grow higher, too."""
_ONE_SIDED_SIGMAS: Final = 1.64
"""Standard uncertainties, of one in twenty on one side."""


@dataclass(frozen=True)
class FlowBlocks:
    """Seen over expected cross-section, in the order of writing.

    Attributes
    ----------
    time_s : (n,) float64, s
        Middle of each block of writing, on one clock.
    area_ratio : (n,) float64
        Cross-section seen over the requested one.
    u : (n,) float64
        Standard uncertainty of that ratio.
    factor : (n,) float64
        Flow factor in force when the block was written.
    u_common : float
        Relative standard uncertainty that all of them share (where an edge lies in a picture).
    u_change : float
        Of it, what differs from the last picture's; infinite where that isn't known.
    """

    time_s: FloatArray
    area_ratio: FloatArray
    u: FloatArray
    factor: FloatArray
    u_common: float = 0.0
    u_change: float = math.inf

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
    drift_per_root_s: float = 0.005
    steps_per_unit: float = 100.0


@dataclass(frozen=True)
class PictureFlow:
    """Logarithm of delivered over requested flow, uncorrected, by one picture alone.

    Attributes
    ----------
    level, u : float
        With its standard uncertainty.
    """

    level: float
    u: float


@dataclass
class FlowControl:
    """Flow estimate of one head, and the factor that corrects it.

    Attributes
    ----------
    limits : FlowLimits
    factor : float
        In force.
    log_flow, misread : float
        Logarithm of delivered over requested flow, uncorrected, and what pictures add to it.
    variance : (float, float, float)
        Of the flow's, of both together, and of what is misread.
    time_s : float or None, s
        Of the last reading.
    common : float
        What the last picture may misread of all lines alike.
    answers : CorrectionResponse
        Whether the amount seen answers corrections.
    last : PictureFlow or None
        Flow by the last look; None if that showed no width.
    asked : bool
        Whether the operator was asked about the flow behind the last reading.
    beyond_said : bool
        Whether a look without widths has paused for a flow beyond all bounds.
    """

    limits: FlowLimits = field(default_factory=FlowLimits)
    factor: float = 1.0
    log_flow: float = 0.0
    misread: float = 0.0
    variance: tuple[float, float, float] = (_PRIOR_FLOW_SD**2, 0.0, 0.0)
    time_s: float | None = None
    common: float = 0.0
    answers: CorrectionResponse = field(default_factory=CorrectionResponse)
    last: PictureFlow | None = None
    asked: bool = False
    beyond_said: bool = False
    _run: float = 0.0

    def learn(self, blocks: FlowBlocks) -> None:
        """Update by a picture's readings; those without a positive finite ratio are left out."""
        sound = np.isfinite(blocks.area_ratio) & (blocks.area_ratio > 0) & np.isfinite(blocks.u)
        self.last = None
        if not sound.any():
            return
        if self.asked:  # whatever was approved: by the factor in force the flow is right
            self._kalman_update(-math.log(self.factor), _OPERATOR_SD**2, 0.0)
            self.asked = False
        ratio, factor, common = blocks.area_ratio[sound], blocks.factor[sound], blocks.u_common
        random = np.maximum((blocks.u[sound] / ratio) ** 2 - common**2, _MIN_RELATIVE_U**2)
        readings = np.log(ratio) - np.log(factor)
        self.answers.learn(np.log(ratio), random, factor, self.log_flow)
        late = slice(len(ratio) // 2, None)  # what flows now
        self.last = PictureFlow(
            float(readings[late].mean()),
            math.hypot(math.sqrt(_variance_of_mean(random[late])), common),
        )
        self._predict_for_picture(common, blocks.u_change)
        for when, reading, own in zip(blocks.time_s[sound], readings, random, strict=True):
            self._filter_reading(float(when), float(reading), float(own))

    def _predict_for_picture(self, common: float, change: float) -> None:
        """Predict the state for a new picture, which misreads lines mostly as the last did."""
        flow, both, misread = self.variance
        flow = max(flow, min(flow + _FLOW_STEP_VARIANCE, _PRIOR_FLOW_SD**2))
        times = 0.0
        if self.common > 0:
            times = math.sqrt(_MISREAD_PERSISTENCE) * min(1.0, common / self.common)
        new = times**2 * (misread - self.common**2) + common**2
        if self.common > 0 and misread + change**2 < new:
            times, new = 1.0, misread + change**2
        new = min(new, max(common, self.common) ** 2) + _PICTURE_SCATTER**2
        self.misread *= times
        self.variance, self.common = (flow, both * times, new), common

    def _filter_reading(self, time_s: float, reading: float, variance: float) -> None:
        """Update by one reading, unless it is an outlier; several on one side are a step."""
        flow, both, misread = self.variance
        passed = max(time_s - self.time_s, 0.0) if self.time_s is not None else 0.0
        self.time_s = time_s
        flow = max(flow, min(flow + self.limits.drift_per_root_s**2 * passed, _PRIOR_FLOW_SD**2))
        off = reading - self.log_flow - self.misread
        sigmas = off / math.sqrt(flow + 2.0 * both + misread + variance)
        clipped = min(max(sigmas, -_MAX_COUNTED_SIGMAS), _MAX_COUNTED_SIGMAS)
        self._run = _DEVIATION_MEMORY * self._run + clipped
        step = abs(self._run) * math.sqrt(1.0 - _DEVIATION_MEMORY**2) > _STEP_SIGMAS
        if step:
            self._run = 0.0
            flow += off * off
        self.variance = flow, both, misread
        if step or abs(sigmas) < _STEP_SIGMAS:
            self._kalman_update(reading, variance, 1.0)

    def _kalman_update(self, reading: float, variance: float, misreads: float) -> None:
        """Apply a Kalman update by a reading of flow plus ``misreads`` times the misread."""
        flow, both, misread = self.variance
        with_flow, with_misread = flow + misreads * both, both + misreads * misread
        total = with_flow + misreads * with_misread + variance
        off = reading - self.log_flow - misreads * self.misread
        self.log_flow += with_flow / total * off
        self.misread += with_misread / total * off
        self.variance = (
            flow - with_flow**2 / total,
            both - with_flow * with_misread / total,
            misread - with_misread**2 / total,
        )

    @property
    def flow(self) -> float:
        """Delivered over requested flow, without correction."""
        return math.exp(self.log_flow)

    @property
    def u_flow(self) -> float:
        """Standard uncertainty of `flow`."""
        return self.flow * math.sqrt(self.variance[0])

    @property
    def log_error(self) -> float:
        """Logarithm of delivered over requested flow at the factor in force."""
        return self.log_flow + math.log(self.factor)

    @property
    def out_of_bounds(self) -> bool:
        """Whether no allowed factor corrects the flow, beyond doubt and the deadband."""
        if self.answers.failed:
            return False  # nothing is known of it
        wanted, sure = -self.log_flow, 2.0 * math.sqrt(self.variance[0]) + self.limits.deadband
        return not (math.log(self.limits.low) - sure <= wanted <= math.log(self.limits.high) + sure)

    def proposal(self) -> float | None:
        """Return the factor that is due; None where the one in force is as good as known.

        A first correction is due where the chance that it isn't needed costs less than to go on,
        and less than to ask; another where it exceeds the deadband by a quarter of its uncertainty.
        Where corrections weren't answered it is the last one that was.
        """
        if self.answers.failed:
            answered = round(self.answers.answered, 4)
            return None if abs(self.factor - answered) < _SAME_FACTOR else answered
        u, beyond = math.sqrt(self.variance[0]), abs(self.log_error) - self.limits.deadband
        if self.factor != 1.0 and beyond <= _MIN_CHANGE_SIGMAS * u:
            return None
        if self.factor == 1.0:
            false_cost = _FALSE_CORRECTION_COST_LOOKS * normal_part(-beyond / u)
            if false_cost > min(1.0, self.cost_in_looks()):
                return None
        rounded = self._bounded_factor(self.log_flow)
        return None if rounded == self.factor else rounded

    def cost_in_looks(self) -> float:
        """Return the cost of leaving the flow as it is, in looks of an operator."""
        return (self.log_error**2 + self.variance[0]) / _LOOK_WORTH_LOG_FLOW**2

    def seems_off(self, share: float) -> bool:
        """Whether by the last look alone the flow is rather off by more than a share than not."""
        if self.last is None:
            return False
        return abs(self.last.level + math.log(self.factor)) > _MIN_WIDTH_RESPONSE * math.log1p(
            share
        )

    def may_be_off(self, share: float) -> bool:
        """Return whether the flow may be off by more than a share, after the last look."""
        if self.last is None:
            return True
        off = abs(self.last.level + math.log(self.factor)) + _ONE_SIDED_SIGMAS * self.last.u
        return off > _MIN_WIDTH_RESPONSE * math.log1p(share)

    def by_last_picture(self) -> float | None:
        """Return the factor by the last picture alone; None if it shows no width."""
        return None if self.last is None else self._bounded_factor(self.last.level)

    def _bounded_factor(self, log_flow: float) -> float:
        """Return the factor that corrects a flow, within bounds, in steps of the firmware."""
        per = self.limits.steps_per_unit
        wanted = min(max(math.exp(-log_flow), self.limits.low), self.limits.high)
        return round(wanted * per) / per

    def put_in_force(self, factor: float) -> None:
        """Set the factor that the printer uses.

        The first correction sets the estimate: by the estimate, or by what the operator approved.
        """
        if self.factor == 1.0 != factor:
            self.log_flow = -math.log(factor)
        self.factor = factor


def normal_part(sigmas: float) -> float:
    """Return the part of a normal law below so many standard deviations (SciPy loads slowly)."""
    return 0.5 * math.erfc(-sigmas / math.sqrt(2.0))
