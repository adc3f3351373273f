"""Test whether the amount of ink that is seen answers corrections of the flow.

After a correction by a factor the logarithm of the amount seen moves by the factor's. What a
picture misreads of all lines alike (halo, blur, level of an edge) hardly changes from look to look,
so in that difference random uncertainty counts alone. Seen amounts that stay where they were are no
flow's: what was corrected was how ink looks.

A flow that itself goes on changing mustn't pass for that. So the last blocks before a correction
are held against the first behind it, each side by the reading that speaks more for an answer.
Answers to small corrections are added up until they tell.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from kernels.arrays import FloatArray

_PART: Final = 0.5
"""Of what a real change of flow moves the seen amount by: less is no answer."""
_SURE: Final = 2.0
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
        sure = _SURE * math.sqrt(self.variance)
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
