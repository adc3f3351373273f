"""Judge vessel decisions against true sections, and listed findings against plotted ones."""

from __future__ import annotations

import numpy as np

from benchmarks.common import Row
from benchmarks.scans.judge_defects import true_at, true_errors

ROUNDING_UM = 0.02


def judge_vessels(report: Row, truth: Row, tolerance: float, guard: float = 1.5) -> list[Row]:
    """Return each vessel's decision, its worst true error, U there, and what isn't listed.

    `touched`: a change or a way was planted in it. `guarded`: the decision is a pass though a true
    section is beyond `guard` times the tolerance. `unlisted`: sections plotted outside their band
    that no finding of the vessel covers.
    """
    planted = truth["defects"]
    touched = {d["vessel"] for d in planted} | {d.get("other") for d in planted}
    out = []
    for row in report["vessels"]:
        section = truth["vessels"][row["vessel"]]
        worst = float(np.abs(true_errors(section)).max(initial=0))
        decision = row.get("decision")
        out.append(
            {
                "vessel": row["vessel"],
                "decision": decision,
                "touched": row["vessel"] in touched,
                "worst_percent": worst,
                "u_percent": u_there(row, section),
                "guarded": decision == "pass" and worst > guard * tolerance,
                "unlisted": unlisted(report, row),
            }
        )
    return out


def u_there(row: Row, section: Row) -> float | None:
    """Return U of the section that truly errs most, percent of the design; None without one."""
    along = np.array(row.get("along_mm") or [], float)
    half = [np.nan if u is None else u for u in row.get("interval_95_um") or []]
    if not len(along) or len(half) != len(along):
        return None
    designed = np.interp(along, section["along_mm"], section["designed_um"])
    error = np.abs(true_at(section, along) / designed - 1)
    known = np.isfinite(error) & np.isfinite(half)
    if not known.any():
        return None
    k = int(np.argmax(np.where(known, error, -1)))
    return float(100 * half[k] / designed[k])


def unlisted(report: Row, row: Row) -> int:
    """Return how many sections outside their plotted band lie in no finding of their vessel."""
    keys = ("along_mm", "diameter_um", "lower_um", "upper_um")
    if any(not row.get(key) for key in keys):
        return 0
    along, measured, low, high = (
        np.array([np.nan if v is None else v for v in row[key]], float) for key in keys
    )
    outside = (measured > high + ROUNDING_UM) | (measured < low - ROUNDING_UM)
    for found in report.get("findings") or []:
        if row["vessel"] in (found.get("vessel"), found.get("other")):
            for one in [found, *(found.get("changes") or [])]:
                if one.get("from_mm") is not None:
                    outside &= (along < one["from_mm"] - 1e-6) | (along > one["to_mm"] + 1e-6)
    return int(outside.sum())
