"""Drawings of what was gauged: deviation both fits, diameters along vessels, layers."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from registration.report.drawing import blank, broken, small_multiples, styled, to_svg
from registration.report.svg import ACCENT, INK, MUTED
from registration.report.wording import is_number

FloatArray = NDArray[np.float64]
Record = Mapping[str, Any]

OUTSIDE: Final = "#b85a14"
MOST_PROFILES: Final = 12
"""Vessels drawn along their length: those with defects, then the worst."""


def curve_figure(
    tolerance_um: Sequence[float], rigid: Sequence[Any], scaled: Sequence[Any]
) -> bytes:
    """Share of the surface within any tolerance, after both fits, as SVG."""
    with styled():
        figure, axes = blank(5.2, 2.7)
        for share, colour, label in ((scaled, ACCENT, "scaled fit"), (rigid, OUTSIDE, "rigid fit")):
            axes.plot(tolerance_um, 100 * _numbers(share), color=colour, label=label)
        axes.set(xlabel="tolerance / µm", ylabel="share within / %", ylim=(0, 102))
        axes.set_xlim(0, max(tolerance_um))
        axes.legend(loc="lower right")
        return to_svg(figure, "within")


def profile_figure(
    vessels: Sequence[Record], defects: Sequence[Record], tolerance_percent: float = 10.0
) -> bytes | None:
    """Diameter along the vessels that say most, with the design, a band and the defects.

    Parameters
    ----------
    vessels : sequence of dict
        ``vessel``, ``designed_um``, ``length_mm``, ``along_mm``, ``diameter_um``, ``unseen_mm``.
    defects : sequence of dict
        ``kind``, ``vessel``, ``from_mm``, ``to_mm``.
    tolerance_percent : float, %
        Half width of the band.

    Returns
    -------
    bytes or None
        SVG; None where no vessel has a section.
    """
    shown = _worth_showing(vessels, defects)
    if not shown:
        return None
    with styled():
        figure, grid, columns = small_multiples(len(shown))
        for axes, vessel in zip(grid, shown, strict=True):
            own = [d for d in defects if vessel["vessel"] in (d.get("vessel"), d.get("other"))]
            _profile(axes, vessel, own, tolerance_percent / 100)
        for axes in grid[::columns]:
            axes.set_ylabel("diameter / µm")
        for axes in grid[-columns:]:
            axes.set_xlabel("along / mm")
        return to_svg(figure, "profiles")


def _worth_showing(vessels: Sequence[Record], defects: Sequence[Record]) -> list[Record]:
    ill = {d.get("vessel") for d in defects}

    def rank(vessel: Record) -> tuple[bool, float]:
        error = vessel.get("error_percent")
        return (vessel["vessel"] not in ill, -abs(error) if is_number(error) else 0.0)

    usable = [v for v in vessels if isinstance(v.get("along_mm"), list) and v["along_mm"]]
    chosen = sorted(usable, key=rank)[:MOST_PROFILES]
    return sorted(chosen, key=lambda vessel: vessel["vessel"])


def _profile(axes: Axes, vessel: Record, defects: Sequence[Record], part: float) -> None:
    along, diameter = _numbers(vessel["along_mm"]), _numbers(vessel["diameter_um"])
    designed, length = float(vessel["designed_um"]), float(vessel["length_mm"])
    for first, last in vessel.get("unseen_mm") or []:
        axes.axvspan(first, last, color=MUTED, alpha=0.15, linewidth=0)
    for defect in defects:
        if defect.get("vessel") == vessel["vessel"]:
            axes.axvspan(defect["from_mm"], defect["to_mm"], color=OUTSIDE, alpha=0.18, linewidth=0)
    axes.axhspan(
        designed * (1 - part), designed * (1 + part), color=ACCENT, alpha=0.12, linewidth=0
    )
    axes.axhline(designed, color=MUTED, linewidth=0.8)
    axes.plot(
        *broken(along, diameter),
        color=INK,
        linewidth=1.1,
        marker="." if len(along) < 4 else "",
        markersize=4,
    )
    names = ", ".join(dict.fromkeys(str(d["kind"]) for d in defects))
    axes.set_title(f"vessel {vessel['vessel']}" + (f": {names}" if names else ""), loc="left",
                   fontsize=8.6, color=OUTSIDE if names else INK)  # fmt: skip
    axes.set_xlim(0, length)
    finite = diameter[np.isfinite(diameter)]
    low = min([designed * 0.8, *finite.tolist()])
    axes.set_ylim(
        0 if low < 0.4 * designed else 0.97 * low, max([designed * 1.2, *(1.03 * finite)])
    )


def layer_deviation_figure(rows: Sequence[Record]) -> bytes | None:
    """Mean and RMS deviation of each written layer over its height, as SVG; None without any."""
    z = _numbers([row.get("z_mm") for row in rows])
    mean, rms = (_numbers([row.get(key) for row in rows]) for key in ("mean_um", "rms_um"))
    if not np.isfinite(rms).any():
        return None
    with styled():
        figure, axes = blank(5.2, 2.7)
        axes.axhline(0.0, color=MUTED, linewidth=0.8)
        axes.plot(z, mean, color=ACCENT, label="mean")
        axes.plot(z, rms, color=OUTSIDE, label="RMS")
        axes.set(xlabel="top of the layer, z / mm", ylabel="deviation, scaled fit / µm")
        axes.legend(loc="best")
        return to_svg(figure, "layers")


def _numbers(values: Sequence[Any]) -> FloatArray:
    return np.array([value if is_number(value) else np.nan for value in values], dtype=np.float64)
