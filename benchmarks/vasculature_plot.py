"""Growth time against number of terminals, with its fitted exponent."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.machine import machine, row
from benchmarks.vasculature_runs import Case, grow


def growth_curve(stl: Path, most: int) -> list[dict[str, Any]]:
    """One run for each doubling of the terminals from 1,000 to at most ``most``."""
    sizes = [1000 * 2**k for k in range(15) if 1000 * 2**k <= most]
    return [{"terminals": n} | grow(Case(f"growth curve, {n:,} terminals", stl, n)) for n in sizes]


def slope_of(curve: list[dict[str, Any]], key: str, least: int = 4000) -> float:
    """Exponent p of time ~ N^p, fitted from ``least`` terminals on."""
    n = np.array([run["terminals"] for run in curve])
    t = np.array([run[key] for run in curve])
    return float(np.polyfit(np.log(n[n >= least]), np.log(t[n >= least]), 1)[0])


def slope_row(curve: list[dict[str, Any]]) -> dict[str, Any]:
    """The row of the slope, with the curve itself."""
    points = [[r["terminals"], round(r["growth_s"], 3), round(r["growth_cpu_s"], 3)] for r in curve]
    slope = slope_of(curve, "growth_cpu_s")
    made = row("biventricle: slope of growth's CPU time against N", round(slope, 3), "exponent")
    return made | {"clock": "cpu", "terminals_wall_cpu": points}


def plot_growth(curve: list[dict[str, Any]], path: Path) -> None:
    """Draw the curve on logarithmic axes."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    n = np.array([run["terminals"] for run in curve], dtype=float)
    cpu = np.array([run["growth_cpu_s"] for run in curve])
    wall = np.array([run["growth_s"] for run in curve])
    slope = slope_of(curve, "growth_cpu_s")
    figure, axes = plt.subplots(figsize=(6.4, 4.2), layout="constrained")
    axes.loglog(n, wall, "o", mfc="none", color="0.6", label="wall clock (shared cores)")
    axes.loglog(n, cpu, "o-", color="C0", label=f"CPU time, slope {slope:.2f}")
    axes.loglog(n, cpu[-1] * n / n[-1], "--", color="0.4", lw=1, label="slope 1")
    axes.set(xlabel="terminals", ylabel="growth, audited (s)")
    axes.set_title(f"Biventricle, one thread, {machine()['processor']}", fontsize=9)
    axes.grid(which="both", alpha=0.25)
    axes.legend(frameon=False)
    figure.savefig(path, dpi=150)
    plt.close(figure)
