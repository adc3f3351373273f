"""Gauge study: a published example, known variance components, tested budgets."""

from __future__ import annotations

import numpy as np
import pytest

from registration.comparison.gauge_shares import mean_squares, shares
from registration.comparison.scans import GaugeStudyError
from tests.slower import first_of

# AIAG, Measurement Systems Analysis, 4th ed. 2010, chapter III B: three appraisers, three
# trials, ten parts. Minitab has the same numbers as its example of a crossed study,
# with a tolerance of 8:
# https://support.minitab.com/en-us/minitab/19/help-and-how-to/quality-and-process-improvement/
# measurement-system-analysis/how-to/gage-study/crossed-gage-r-r-study/before-you-start/example
AIAG = """
 0.29 -0.56 1.34 0.47 -0.80  0.02 0.59 -0.31 2.26 -1.36
 0.41 -0.68 1.17 0.50 -0.92 -0.11 0.75 -0.20 1.99 -1.25
 0.64 -0.58 1.27 0.64 -0.84 -0.21 0.66 -0.17 2.01 -1.31
 0.08 -0.47 1.19 0.01 -0.56 -0.20 0.47 -0.63 1.80 -1.68
 0.25 -1.22 0.94 1.03 -1.20  0.22 0.55  0.08 2.12 -1.62
 0.07 -0.68 1.34 0.20 -1.28  0.06 0.83 -0.34 2.19 -1.50
 0.04 -1.38 0.88 0.14 -1.46 -0.29 0.02 -0.46 1.77 -1.49
-0.11 -1.13 1.09 0.20 -1.07 -0.67 0.01 -0.56 1.45 -1.77
-0.15 -0.96 0.67 0.11 -1.45 -0.49 0.21 -0.49 1.87 -2.16
"""


def aiag() -> tuple[np.ndarray, list[int], list[int]]:
    table = np.array([[float(v) for v in row.split()] for row in AIAG.split("\n") if row])
    return table.ravel(), [k // 30 for k in range(90)], [k % 10 for k in range(90)]


def test_the_published_example_comes_out_as_published() -> None:
    squares = mean_squares(*aiag())
    assert squares.part.value == pytest.approx(9.81799, rel=1e-5)
    assert squares.operator.value == pytest.approx(1.58363, rel=1e-5)
    assert squares.interaction.value == pytest.approx(0.01994, abs=1e-5)
    assert squares.error.value == pytest.approx(0.04598, abs=1e-5)
    assert squares.p_interaction == pytest.approx(0.974, abs=5e-4)
    assert squares.pooled
    found = shares(squares, 8.0)
    sd = {name: share.sd.value for name, share in found.sources.items()}
    assert sd["EV"] == pytest.approx(0.19993, abs=1e-5)
    assert sd["AV"] == pytest.approx(0.22684, abs=1e-5)
    assert sd["GRR"] == pytest.approx(0.30237, abs=1e-5)
    assert sd["PV"] == pytest.approx(1.04233, abs=1e-5)
    assert sd["TV"] == pytest.approx(1.08530, abs=1e-5)
    assert found.sources["GRR"].of_total.value == pytest.approx(27.86, abs=5e-3)
    assert found.sources["GRR"].of_tolerance.value == pytest.approx(22.68, abs=5e-3)
    assert found.sources["PV"].of_total.value ** 2 / 100 == pytest.approx(92.24, abs=5e-3)
    assert found.ndc == 4


def test_repeats_missing_here_and_there_hardly_change_the_result() -> None:
    values, operators, parts = aiag()
    values[[3, 47, 81]] = np.nan
    found = shares(mean_squares(values, operators, parts), np.nan).sources
    assert found["GRR"].sd.value == pytest.approx(0.30237, rel=0.05)
    assert not np.isfinite(found["GRR"].of_tolerance.value)


def test_a_part_that_an_operator_never_measured_is_refused_by_name() -> None:
    values, operators, parts = aiag()
    values[[5, 15, 25]] = np.nan
    with pytest.raises(GaugeStudyError, match="operator 1 has no value of part 6"):
        mean_squares(values, operators, parts)


@pytest.mark.parametrize("rounds", first_of([80, 300]))
def test_intervals_cover_the_true_components(rounds: int) -> None:
    """Part 6, operator 2, interaction 1, repeats 1.5: 95 % of the intervals hold them."""
    random = np.random.default_rng(5)
    true = {"EV": 1.5, "AV": 2.0, "PV": 6.0, "INT": 1.0}
    true["GRR"] = float(np.sqrt(1.5**2 + 2**2 + 1))
    true["TV"] = float(np.hypot(true["GRR"], 6))
    who, what = np.repeat(np.arange(4), 24), np.tile(np.repeat(np.arange(8), 3), 4)
    held = dict.fromkeys(true, 0)
    kept = 0
    for _ in range(rounds):
        y = 6 * random.normal(size=8)[what] + 2 * random.normal(size=4)[who]
        y += random.normal(size=(4, 8))[who, what] + 1.5 * random.normal(size=96)
        squares = mean_squares(y, who.tolist(), what.tolist())
        if squares.pooled:  # then the interaction is said to be repeatability, and isn't
            continue
        kept += 1
        found = shares(squares, np.nan).sources
        for name, value in true.items():
            held[name] += found[name].sd.low <= value <= found[name].sd.high
    assert kept > 0.8 * rounds
    for name, count in held.items():
        assert 0.91 <= count / kept <= 1.0, name


def test_without_repeats_interaction_counts_as_repeatability() -> None:
    values = np.array([1.0, 3.0, 5.0, 1.3, 3.2, 5.6])
    squares = mean_squares(values, [0, 0, 0, 1, 1, 1], [0, 1, 2] * 2)
    assert squares.pooled
    assert squares.repeatability.df == 2
    with pytest.raises(GaugeStudyError, match="nothing was measured twice"):
        mean_squares(np.array([1.0, 2.0]), [0, 0], [0, 1])
