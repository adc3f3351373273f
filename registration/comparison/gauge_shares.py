"""Variance components of a gauge study, from its mean squares."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from kernels.arrays import FloatArray
from registration.comparison.scans import GaugeStudyError
from registration.comparison.statistics import LEVEL, UNKNOWN, Interval, difference_interval

# Mean squares of a gauge study's analysis of variance: parts, operators, repeats.
#
# Random effects, y = mean + part + operator + part x operator + repeat (AIAG, Measurement Systems
# Analysis, 4th ed. 2010, chapter III B; ISO 22514-7:2021). Where cells hold unequally many repeats
# the mean squares are those of unweighted cell means, times the harmonic mean of the counts
# (Burdick, Borror & Montgomery 2005, Design and Analysis of Gauge R&R Studies, chapter 8); with
# equal counts that is the textbook's analysis of variance.
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


Sum = list[tuple[float, MeanSquare]]
"""Weights of mean squares whose sum estimates a variance."""
NAMES = ("EV", "AV", "INT", "GRR", "PV", "TV")
"""Repeatability, operators, parts x operators, the gauge as a whole, parts, total."""
SPREADS = 6.0
"""Standard deviations that a tolerance is held against (AIAG, MSA 4th ed.)."""
_DRAWS = 20_000


@dataclass(frozen=True)
class Share:
    """Variance component of one source.

    Attributes
    ----------
    sd : Interval
        In the quantity's unit; unknown where the study can't tell.
    of_total, of_tolerance : Interval, %
        Of the total variation (standard deviations), and of the tolerance's width (six of them).
    """

    sd: Interval
    of_total: Interval
    of_tolerance: Interval


@dataclass(frozen=True)
class Shares:
    """All sources of variation of a quantity, by `NAMES`; `ndc`: categories told apart."""

    sources: dict[str, Share]
    ndc: int | None
    ndc_interval: tuple[int, int] | None


def shares(squares: MeanSquares, width: float) -> Shares:
    """Take the variation apart.

    Parameters
    ----------
    squares : MeanSquares
    width : float
        Of the tolerance, upper less lower limit, in the quantity's unit; NaN: none.
    """
    sums = _sums(squares)
    value = _variances({name: _total(each) for name, each in sums.items()})
    drawn = _drawn(squares)
    by_name = {}
    for name in NAMES:
        sd = _interval(sums[name], value[name]) if name in sums else UNKNOWN
        scale = 100 * SPREADS / width if np.isfinite(width) and width > 0 else np.nan
        by_name[name] = Share(sd, _of_total(name, value, drawn), _scaled(sd, scale))
    return Shares(by_name, *_distinct(value, drawn))


def _sums(s: MeanSquares) -> dict[str, Sum]:
    """Weights of the mean squares in each variance; what the study can't tell is left out."""
    p, o, r, error, against = s.parts, s.operators, s.repeats, s.repeatability, s.against
    made: dict[str, Sum] = {"EV": [(1.0, error)]}
    kept = s.interaction.df >= 1 and not s.pooled
    if kept:
        made["INT"] = [(1 / r, s.interaction), (-1 / r, error)]
    if o > 1:
        made["AV"] = [(1 / (p * r), s.operator), (-1 / (p * r), against)]
    if p > 1:
        made["PV"] = [(1 / (o * r), s.part), (-1 / (o * r), against)]
    made["GRR"] = _sum(s, kept, False)
    if p > 1:
        made["TV"] = _sum(s, kept, True)
    return made


def _sum(s: MeanSquares, kept: bool, whole: bool) -> Sum:
    """The gauge's variance, with (`whole`) or without the parts'."""
    p, o, r = s.parts, s.operators, s.repeats
    of_operator = 1 / (p * r) if o > 1 else 0.0
    of_part = 1 / (o * r) if whole else 0.0
    rest = (1 / r if kept else 1.0) - of_operator - of_part
    made = [(of_operator, s.operator), (of_part, s.part), (rest, s.against)]
    made += [(1 - 1 / r, s.repeatability)] if kept else []
    return [(weight, square) for weight, square in made if weight > 1e-12]


def _total(each: Sum) -> float:
    return sum(weight * square.value for weight, square in each)


def _variances(raw: dict[str, float]) -> dict[str, float]:
    """None below zero, sums after that; NaN what isn't known."""
    known: dict[str, float] = {
        name: max(raw[name], 0.0) for name in ("EV", "AV", "INT", "PV") if name in raw
    }
    known["GRR"] = sum(known.get(name, 0.0) for name in ("EV", "AV", "INT"))
    if "PV" in known:
        known["TV"] = known["GRR"] + known["PV"]
    return {name: known.get(name, float("nan")) for name in NAMES}


def _interval(each: Sum, variance: float) -> Interval:
    """Standard deviation with its interval and Satterthwaite's degrees of freedom."""
    if len(each) == 2 and each[1][0] < 0:
        (first, one), (second, other) = each
        reach = difference_interval(
            first * one.value, one.df, -second * other.value, other.df
        )  # fmt: skip
    else:
        reach = _sum_interval(each)
    squares = sum((weight * square.value) ** 2 / square.df for weight, square in each)
    df = _total(each) ** 2 / squares if squares > 0 else min(square.df for _, square in each)
    low, high = min(max(reach[0], 0.0), variance), max(reach[1], variance)
    sd, least, most = (float(np.sqrt(v)) for v in (variance, low, high))
    return Interval(sd, least, most, float(df))


def _sum_interval(each: Sum) -> tuple[float, float]:
    """Modified large-sample interval of a sum of mean squares; exact for one."""
    tail = (1 - LEVEL) / 2
    below = above = 0.0
    for weight, square in each:
        part = weight * square.value
        below += (part * (1 - square.df / stats.chi2.ppf(1 - tail, square.df))) ** 2
        above += (part * (square.df / stats.chi2.ppf(tail, square.df) - 1)) ** 2
    total = _total(each)
    return total - float(np.sqrt(below)), total + float(np.sqrt(above))


def _drawn(s: MeanSquares) -> dict[str, FloatArray]:
    """Generalized pivotal quantities of the variances, (draws,) each."""
    random = np.random.default_rng(1)
    sums = _sums(s)
    made = {
        square: square.df * square.value / random.chisquare(square.df, _DRAWS)
        for square in dict.fromkeys(square for each in sums.values() for _, square in each)
    }
    raw: dict[str, FloatArray] = {
        name: np.maximum(sum(weight * made[square] for weight, square in sums[name]), 0.0)
        for name in ("EV", "AV", "INT", "PV")
        if name in sums
    }
    zero = np.zeros(_DRAWS)
    raw["GRR"] = raw["EV"] + raw.get("AV", zero) + raw.get("INT", zero)
    return raw | ({"TV": raw["GRR"] + raw["PV"]} if "PV" in raw else {})


def _of_total(name: str, value: dict[str, float], drawn: dict[str, FloatArray]) -> Interval:
    if name not in drawn or not value["TV"] > 0:
        return UNKNOWN
    share = 100 * float(np.sqrt(value[name] / value["TV"]))
    low, high = _quantiles(100 * np.sqrt(drawn[name] / drawn["TV"]))
    return Interval(share, min(low, share), max(high, share), 0)


def _quantiles(values: FloatArray) -> tuple[float, float]:
    low, high = np.quantile(values, [(1 - LEVEL) / 2, (1 + LEVEL) / 2])
    return float(low), float(high)


def _scaled(interval: Interval, factor: float) -> Interval:
    return Interval(
        interval.value * factor, interval.low * factor, interval.high * factor, interval.df
    )


def _distinct(
    value: dict[str, float], drawn: dict[str, FloatArray]
) -> tuple[int | None, tuple[int, int] | None]:
    """Number of distinct categories, 1.41 PV / GRR, cut to a whole number."""
    if not np.isfinite(value["PV"]) or value["GRR"] <= 0:
        return None, None
    low, high = _quantiles(np.sqrt(2 * drawn["PV"] / drawn["GRR"]))
    ndc = int(1.41 * np.sqrt(value["PV"] / value["GRR"]))
    return ndc, (min(int(low), ndc), max(int(high), ndc))
