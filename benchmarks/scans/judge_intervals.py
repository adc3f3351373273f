"""Judge reported numbers: errors, and coverage of their 95 % intervals."""

from __future__ import annotations

from typing import Any

import numpy as np

from benchmarks.common import Row
from benchmarks.scans.judge_defects import true_at
from benchmarks.scans.judge_pose import scales

# Where a half width may stand; the first key there counts. A two-number interval gives both ends.
# The product has interval_95.scale and interval_95.offset_um, and noise_um per section (1 sd).
SECTION_KEYS = (
    "diameter_interval_95_um",
    "interval_95_um",
    "diameter_u95_um",
    "u95_um",
    "uncertainty_um",
)
MEAN_KEYS = (
    "measured_interval_95_um",
    "mean_interval_95_um",
    "measured_u95_um",
    "diameter_interval_95_um",
    "interval_95_um",
)
RATIO_KEYS = ("resistance_ratio_interval_95", "resistance_interval_95", "conductance_interval_95")
PRESSURE_KEYS = ("pressure_ratio_interval_95", "pressure_interval_95", "pressure_drop_interval_95")
SECTION_NOISE = "noise_um"
MOST_KNOWN = 0.9


def quantity(name: str, value: float, true: float, claimed: Any = None, scale: float = 1.0) -> Row:
    """Return an error, its claimed half width and whether that holds the truth (None: no claim)."""
    out: Row = {"quantity": name, "error": float(value - true), "half": None, "holds": None}
    ends = np.asarray(claimed, float) if claimed is not None else np.array(np.nan)
    if ends.shape == (2,) and np.isfinite(ends).all():
        out |= {
            "half": float(scale * (ends[1] - ends[0]) / 2),
            "holds": bool(scale * ends[0] <= true <= scale * ends[1]),
        }
    elif ends.shape == () and np.isfinite(ends):
        out |= {"half": float(scale * ends), "holds": bool(abs(value - true) <= scale * ends)}
    return out


def first_of(row: Row, keys: tuple[str, ...]) -> Any:
    """Return the value of the first key that a row has, or None."""
    own = row | {
        f"{k}.{n}": v for k, held in row.items() if isinstance(held, dict) for n, v in held.items()
    }
    return next((own[k] for k in keys if own.get(k) is not None), None)


def scale_quantities(report: Row, truth: Row) -> list[Row]:
    """Return the three scales, in percent."""
    value, true = scales(report, truth)
    claimed = (report.get("interval_95") or {}).get("scale") or [None] * 3
    return [
        quantity("scale_" + "xyz"[k], 100 * value[k], 100 * true[k], claimed[k], 100.0)
        for k in range(3)
    ]


def offset_quantities(report: Row, truth: Row) -> list[Row]:
    """Return the offset of all walls (um); true is 0: walls are moved by defects alone."""
    if report.get("offset_um") is None or any(d.get("whole_vessel") for d in truth["defects"]):
        return []
    return [
        quantity(
            "offset", report["offset_um"], 0.0, (report.get("interval_95") or {}).get("offset_um")
        )
    ]


def diameter_quantities(report: Row, truth: Row) -> list[Row]:
    """Return every section's diameter and every vessel's mean over its gauged sections, um.

    A section is measured as it is, its walls' roughness included.
    """
    out: list[Row] = []
    for row in report["vessels"]:
        if not row.get("along_mm") or not row.get("diameter_um"):
            continue
        along = np.array(row["along_mm"], float)
        real = true_at(truth["vessels"][row["vessel"]], along, rough=True)
        value = np.array([np.nan if d is None else d for d in row["diameter_um"]], float)
        known = np.flatnonzero(np.isfinite(value) & (np.nan_to_num(real) > 0))
        claimed = first_of(row, SECTION_KEYS)
        if np.ndim(claimed) == 0 or len(claimed) != len(value):
            claimed = [None] * len(value)
        noise = row.get(SECTION_NOISE) or [None] * len(value)
        for k in known:
            out.append(quantity("section", value[k], real[k], claimed[k]) | {"noise_um": noise[k]})
        # A mean is held against that of the same sections: most of them must be known.
        same = len(known) >= MOST_KNOWN * (np.nan_to_num(value) > 0).sum()
        if len(known) and same and row.get("measured_um") is not None:
            mean = first_of(row, MEAN_KEYS)
            usable = mean if np.ndim(mean) == 0 or len(mean) == 2 else None
            out.append(
                quantity("mean", row["measured_um"], float(real[known].mean()), usable)
                | {"vessel": row["vessel"]}
            )
    return out


def resistance(section: Row, diameter: np.ndarray) -> float:
    """Return Poiseuille's resistance but for 128 mu / pi: the integral of ds / d^4, 1/mm^3."""
    along = np.array(section["along_mm"], float)
    return float(np.trapezoid((np.maximum(diameter, 1.0) / 1e3) ** -4.0, along))


def resistances(truth: Row) -> list[tuple[float, float]]:
    """Return each vessel's resistance as designed and as printed, 1/mm^3; inf if closed."""
    out = []
    for section in truth["vessels"]:
        printed = np.array([d or 0.0 for d in section["diameter_um"]])
        stretch = section.get("stretch", float(np.mean(truth["scale"][:2])))
        closed = bool((printed < 1).any())
        designed = resistance(section, np.array(section["designed_um"], float))
        out.append((designed, np.inf if closed else stretch * resistance(section, printed)))
    return out


def flow_quantities(report: Row, truth: Row) -> list[Row]:
    """Return resistance ratios (percent) and the pressure ratio (percent), by Poiseuille."""
    out, known = [], resistances(truth)
    for row in report["vessels"]:
        designed, printed = known[row["vessel"]]
        if row.get("resistance_ratio") and np.isfinite(printed):
            true = 100 * printed / designed
            out.append(
                quantity(
                    "resistance",
                    100 * row["resistance_ratio"],
                    true,
                    first_of(row, RATIO_KEYS),
                    100.0,
                )
            )
    perfusion = report.get("perfusion") or {}
    drop, before = perfusion.get("pressure_drop_pa"), perfusion.get("designed_pressure_drop_pa")
    shares = {r["vessel"]: r.get("designed_share") for r in perfusion.get("vessels") or []}
    if drop and before and all(np.isfinite(p) for _, p in known) and not truth["defects"]:
        true_ratio = power_ratio(known, shares)
        if true_ratio:
            out.append(
                quantity(
                    "pressure",
                    100 * drop / before,
                    100 * true_ratio,
                    first_of(perfusion, PRESSURE_KEYS),
                    100.0,
                )
            )
    return out


def power_ratio(known: list[tuple[float, float]], shares: dict[int, float | None]) -> float | None:
    """Return the pressure ratio from the power lost, flows taken as designed; None without them.

    With one inlet the drop is sum(R q^2) / q0. Flows shift by percents only, and a first-order
    shift changes the power to second order (Thomson's principle), so the designed flows do.
    """
    flow = np.array(
        [np.nan if shares.get(k) is None else float(shares[k] or 0) for k in range(len(known))]
    )
    if not np.isfinite(flow).all():
        return None
    designed, printed = (np.array(r) for r in zip(*known, strict=True))
    return float((printed * flow**2).sum() / (designed * flow**2).sum())


def judge_intervals(report: Row, truth: Row, turned: bool) -> list[Row]:
    """Return all quantities; a turned symmetric design has its scales alone."""
    rows = scale_quantities(report, truth)
    if not turned:
        rows += (
            offset_quantities(report, truth)
            + diameter_quantities(report, truth)
            + flow_quantities(report, truth)
        )
    return rows
