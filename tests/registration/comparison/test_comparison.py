"""Comparison of prints: known variances and trends; gauge studies against a published one."""

from typing import Any

import numpy as np
import pytest
from scipy import stats

from registration.comparison import (
    ComparisonError,
    GaugedScan,
    GaugeStudyError,
    Origin,
    compare,
    comparison_dict,
    gauged_scan,
)
from registration.comparison.gauge_shares import mean_squares, shares
from registration.comparison.statistics import components, holm, mean_interval, sd_interval, trend
from tests.slower import first_of


def scan(errors: Any, print_id: str, design: str = "d" * 64, **more: Any) -> GaugedScan:
    rows = [
        {"vessel": v, "designed_um": 500.0, "measured_um": 500.0 + e, "length_mm": 5.0,
         "open": True, "along_mm": [], "diameter_um": [], "unseen_mm": []}
        for v, e in enumerate(errors)
    ]  # fmt: skip
    numbers = {
        "vessels": rows, "defects": more.pop("defects", []), "scale": [0.99, 0.99, 1.0],
        "offset_um": -5.0, "interval_95": {"scale": [0.001, 0.001, None], "offset_um": 1.0},
        "scaled": {"rms_um": 10.0}, "rigid": {"rms_um": 20.0},
    }  # fmt: skip
    label = f"{print_id}-{float(np.sum(errors)):.3f}"
    return gauged_scan(numbers, Origin(label, design, print_id, **more))


def test_between_and_scan_variance_come_back() -> None:
    random = np.random.default_rng(1)
    prints, scans = 400, 3
    number = np.repeat(np.arange(prints), scans)
    drawn = 8 * random.normal(size=prints)
    values = -3 + drawn[number] + 2 * random.normal(size=prints * scans)
    found = components(values, number.tolist())
    # Of these very prints, not of the population: an unlucky draw is no fault of the estimate.
    assert found.print_sd.value == pytest.approx(drawn.std(ddof=1), rel=0.02)
    assert found.scan_sd.value == pytest.approx(2, rel=0.1)


def test_interval_of_the_prints_own_spread_covers_it() -> None:
    random = np.random.default_rng(2)
    number = np.repeat(np.arange(6), 2)
    covered = 0
    for _ in range(400):
        values = 3 * random.normal(size=6)[number] + 2 * random.normal(size=12)
        found = components(values, number.tolist()).print_sd
        covered += found.low <= 3 <= found.high
    assert 0.92 <= covered / 400 <= 0.985


@pytest.mark.slow
def test_prints_alike_under_a_noisy_scanner_have_no_spread_of_their_own() -> None:
    """Pooled over vessels, noise that some have below 0 makes up for what others have above."""
    random = np.random.default_rng(3)
    own = []
    for _ in range(20):
        rows = [scan(2 * random.normal(size=14), f"p{k // 2}") for k in range(12)]
        own.append(compare(rows).repeatability.print_sd)
    assert np.mean([one.low == 0 for one in own]) > 0.9
    assert np.mean([one.value for one in own]) < 0.5


def test_prints_that_differ_are_told_from_the_scanners_noise() -> None:
    random = np.random.default_rng(4)
    drawn = 6 * random.normal(size=(12, 14))
    rows = [scan(drawn[k // 2] + random.normal(size=14), f"p{k // 2}") for k in range(24)]
    found = compare(rows).repeatability
    of_these = float(np.sqrt(drawn.var(axis=0, ddof=1).mean()))
    assert found.print_sd.value == pytest.approx(of_these, rel=0.05)
    assert found.scan_sd.value == pytest.approx(1.0, rel=0.15)
    ratio = found.scan_sd.value / np.hypot(found.scan_sd.value, found.print_sd.value)
    assert found.gauge_percent == pytest.approx(100 * ratio)
    assert found.distinct == int(1.41 * found.print_sd.value / found.scan_sd.value)


def test_intervals_are_those_of_the_tables() -> None:
    # t(0.975, 2) = 4.303; chi-squared with 2: 7.378 and 0.05064.
    mean = mean_interval(np.array([1.0, 2.0, 3.0]))
    assert mean.high - mean.value == pytest.approx(4.303 / np.sqrt(3), rel=1e-3)
    spread = sd_interval(1.0, 2)
    assert spread.low == pytest.approx(np.sqrt(2 / 7.378), rel=1e-3)
    assert spread.high == pytest.approx(np.sqrt(2 / 0.05064), rel=1e-3)
    np.testing.assert_allclose(holm([0.01, np.nan, 0.04, 0.03]), [0.03, np.nan, 0.06, 0.06])


def test_a_trend_comes_back() -> None:
    random = np.random.default_rng(3)
    y = 5 + 2.5 * np.arange(12) + random.normal(size=12)
    found, known = trend(range(12), y), stats.linregress(np.arange(12), y)
    assert found is not None
    assert found.slope.value == pytest.approx(known.slope)
    assert found.p == pytest.approx(known.pvalue)
    assert found.slope.low < 2.5 < found.slope.high
    assert trend([0, 1], [1.0, 2.0]) is None


def test_a_vessel_that_is_always_off_and_one_that_varies_are_named() -> None:
    random = np.random.default_rng(4)
    errors = random.normal(0, 1, (8, 6))
    errors[:, 2] -= 20
    errors[:, 4] += 25 * np.array([1, -1, 1, -1, 1, -1, 1, -1])
    found = compare([scan(row, f"p{k}") for k, row in enumerate(errors)], 10.0)
    assert [v.vessel for v in found.vessels if v.off] == [2]
    assert [v.vessel for v in found.vessels if v.varies] == [4]
    able = found.vessels[2].capability
    assert able is not None
    assert able.cp.value == pytest.approx(50 / (3 * errors[:, 2].std(ddof=1)))
    assert comparison_dict(found)["vessels"][2]["off"] is True


def test_defects_at_one_place_are_common() -> None:
    def bulge(low: float) -> dict[str, Any]:
        return {"kind": "bulge", "vessel": 0, "other": None, "from_mm": low, "to_mm": low + 1,
                "size_um": 50.0}  # fmt: skip

    found = compare([
        scan([1.0], "a", defects=[bulge(1.0)]),
        scan([2.0], "b", defects=[bulge(1.5), bulge(3.5)]),
    ])  # fmt: skip
    assert [(d.common, d.from_mm, d.to_mm) for d in found.defects] == [
        (True, 1.0, 2.5), (False, 3.5, 4.5),
    ]  # fmt: skip


def test_different_designs_and_broken_registrations_are_refused() -> None:
    with pytest.raises(ComparisonError, match="2 different designs"):
        compare([scan([1.0], "a"), scan([2.0], "b", design="e" * 64)])
    with pytest.raises(ComparisonError, match="two registrations or more"):
        compare([scan([1.0], "a")])
    with pytest.raises(ComparisonError, match=r"lacks vessels.*register the scan again"):
        gauged_scan({}, Origin("a", "d", "p"))
    with pytest.raises(ComparisonError, match="a defect lacks"):
        scan([1.0], "a", defects=[dict.fromkeys(("kind", "vessel", "from_mm", "to_mm", "size_um"))])


# Gauge study.


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


def test_repeats_missing_hardly_change_the_result_and_a_part_never_measured_is_refused() -> None:
    values, operators, parts = aiag()
    values[[3, 47, 81]] = np.nan
    found = shares(mean_squares(values, operators, parts), np.nan).sources
    assert found["GRR"].sd.value == pytest.approx(0.30237, rel=0.05)
    assert not np.isfinite(found["GRR"].of_tolerance.value)
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
