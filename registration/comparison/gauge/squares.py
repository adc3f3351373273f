"""Mean squares of a gauge study's analysis of variance: parts, operators, repeats.

Random effects, y = mean + part + operator + part x operator + repeat (AIAG, Measurement Systems
Analysis, 4th ed. 2010, chapter III B; ISO 22514-7:2021). Where cells hold unequally many repeats
the mean squares are those of unweighted cell means, times the harmonic mean of the counts
(Burdick, Borror & Montgomery 2005, Design and Analysis of Gauge R&R Studies, chapter 8); with
equal counts that is the textbook's analysis of variance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from kernels.arrays import FloatArray
from registration.comparison.errors import GaugeStudyError

ALPHA = 0.25
"""Above this probability the interaction is pooled with the repeats."""


@dataclass(frozen=True)
class MeanSquare:
    """A mean square in the square of the quantity's unit, and its degrees of freedom (0: none)."""

    value: float
    df: float


NONE = MeanSquare(float("nan"), 0)


@dataclass(frozen=True)
class MeanSquares:
    """Mean squares of one quantity.

    Attributes
    ----------
    parts, operators : int
    repeats : float
        Harmonic mean over the cells.
    part, operator, interaction, error : MeanSquare
    """

    parts: int
    operators: int
    repeats: float
    part: MeanSquare
    operator: MeanSquare
    interaction: MeanSquare
    error: MeanSquare

    @property
    def p_interaction(self) -> float:
        """Probability of such an interaction by chance (F test); NaN where it can't be told."""
        return _p(self.interaction, self.error)

    @property
    def pooled(self) -> bool:
        """Whether the interaction counts as repeatability: not significant, or no repeats."""
        if self.interaction.df < 1:
            return False
        return self.error.df < 1 or bool(self.p_interaction > ALPHA)

    @property
    def repeatability(self) -> MeanSquare:
        """Mean square of the repeats, with the interaction's where that is pooled."""
        if not self.pooled:
            return self.error
        both = [each for each in (self.interaction, self.error) if each.df >= 1]
        df = sum(each.df for each in both)
        return MeanSquare(sum(each.value * each.df for each in both) / df, df)

    @property
    def against(self) -> MeanSquare:
        """What parts and operators are held against."""
        own = self.interaction.df >= 1 and not self.pooled
        return self.interaction if own else self.repeatability

    @property
    def p_part(self) -> float:
        """Probability of parts that differ so much by chance."""
        return _p(self.part, self.against)

    @property
    def p_operator(self) -> float:
        """Probability of operators that differ so much by chance."""
        return _p(self.operator, self.against)


def _p(first: MeanSquare, second: MeanSquare) -> float:
    if first.df < 1 or second.df < 1 or second.value <= 0:
        return float("nan")
    return float(stats.f.sf(first.value / second.value, first.df, second.df))


def mean_squares(values: FloatArray, operators: Sequence[int], parts: Sequence[int]) -> MeanSquares:
    """Take a quantity apart.

    Parameters
    ----------
    values : (n,) float64
        NaN where it wasn't measured.
    operators, parts : (n,) int
        Counted from 0.

    Raises
    ------
    GaugeStudyError
        When an operator has no value of a part, or nothing is repeated.
    """
    who, what = np.asarray(operators), np.asarray(parts)
    cells = [
        [values[(who == i) & (what == j) & np.isfinite(values)] for j in range(what.max() + 1)]
        for i in range(who.max() + 1)
    ]
    count = np.array([[len(cell) for cell in row] for row in cells])
    if count.min() == 0:
        i, j = np.argwhere(count == 0)[0]
        raise GaugeStudyError(
            f"operator {i + 1} has no value of part {j + 1}; a crossed study needs every part "
            "measured by every operator"
        )
    means = np.array([[cell.mean() for cell in row] for row in cells])
    inner = sum(float(((cell - cell.mean()) ** 2).sum()) for row in cells for cell in row)
    repeats = count.size / float((1 / count).sum())
    by_part, by_operator, all_of = means.mean(axis=0), means.mean(axis=1), means.mean()
    rest = means - by_part[None, :] - by_operator[:, None] + all_of
    o, p = means.shape
    made = MeanSquares(
        parts=p,
        operators=o,
        repeats=repeats,
        part=_square(repeats * o * float(((by_part - all_of) ** 2).sum()), p - 1),
        operator=_square(repeats * p * float(((by_operator - all_of) ** 2).sum()), o - 1),
        interaction=_square(repeats * float((rest**2).sum()), (o - 1) * (p - 1)),
        error=_square(inner, int(count.sum()) - count.size),
    )
    if made.repeatability.df < 1:
        raise GaugeStudyError("nothing was measured twice; scan a part again")
    return made


def _square(total: float, df: int) -> MeanSquare:
    return MeanSquare(total / df, df) if df >= 1 else NONE


def pooled_squares(each: Sequence[MeanSquares], error_df: float) -> MeanSquares:
    """Mean of several quantities' mean squares, of one and the same study.

    Parameters
    ----------
    each : sequence of MeanSquares
        At least one.
    error_df : float
        Degrees of freedom of the repeats together. Parts, operators and interaction keep those of
        one quantity: the vessels of a part share its scale.
    """
    first = each[0]
    names = ("part", "operator", "interaction", "error")
    mean = {name: float(np.mean([getattr(one, name).value for one in each])) for name in names}
    df = {name: getattr(first, name).df for name in names}
    df["error"] = error_df if first.error.df >= 1 else 0
    return MeanSquares(
        first.parts,
        first.operators,
        first.repeats,
        **{name: MeanSquare(mean[name], df[name]) if df[name] else NONE for name in names},
    )
