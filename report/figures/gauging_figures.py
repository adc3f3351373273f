"""SVG figures of measured deviation: share within tolerance, along vessels, and by layer."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes

from kernels.arrays import FloatArray
from registration.json_ready import Record, is_number
from report.drawing import blank, broken_line, small_multiples, styled, to_svg
from report.figures.deviation import DECIDED, OUTSIDE
from report.svg import ACCENT, INK, MUTED

MOST_PROFILES: Final = 15
"""Vessels drawn along their length: by decision, then those with findings, then the worst."""
_SEVERE: Final = {"pass": 1, "undecided": 2, "fail": 3}


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


def parted_curve_figure(parts: Mapping[str, Mapping[str, Any]]) -> bytes:
    """The same of several surfaces (name to ``tolerance_um``, ``rigid``, ``scaled``), as SVG."""
    with styled():
        figure, axes = blank(5.2, 2.7)
        for (name, curve), colour in zip(parts.items(), (ACCENT, OUTSIDE), strict=False):
            for fit, dash in (("scaled", "-"), ("rigid", "--")):
                axes.plot(curve["tolerance_um"], 100 * _numbers(curve[fit]), dash, color=colour,
                          label=f"{name}, {fit}")  # fmt: skip
        axes.set(xlabel="tolerance / µm", ylabel="share within / %", ylim=(0, 102))
        axes.set_xlim(0, max(max(curve["tolerance_um"]) for curve in parts.values()))
        axes.legend(loc="lower right")
        return to_svg(figure, "within")


def profile_figure(vessels: Sequence[Record], defects: Sequence[Record]) -> bytes | None:
    """Diameter ± U along the vessels that say most, with their limits, decisions and findings.

    Parameters
    ----------
    vessels : sequence of dict
        ``vessel``, ``designed_um``, ``length_mm``, ``along_mm``, ``diameter_um``, ``unseen_mm``;
        of judged ones ``interval_95_um``, ``lower_um``, ``upper_um``, ``decision_along``.
    defects : sequence of dict
        The list of findings: ``kind``, ``vessel``, ``from_mm``, ``to_mm``, ``decision``.

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
            _profile(axes, vessel, own)
        for axes in grid[::columns]:
            axes.set_ylabel("diameter / µm")
        for axes in grid[-columns:]:
            axes.set_xlabel("along / mm")
        return to_svg(figure, "profiles")


def _worth_showing(vessels: Sequence[Record], defects: Sequence[Record]) -> list[Record]:
    """Fails first, then undecided ones, then those farthest off; in the network's order."""
    severe = {one["vessel"]: _SEVERE.get(str(one.get("decision")), 1) - 1 for one in vessels}
    for d in defects:
        rank_of = _SEVERE.get(str(d.get("decision")), 1)
        severe[d.get("vessel")] = max(rank_of, severe.get(d.get("vessel"), 0))

    def rank(vessel: Record) -> tuple[int, float]:
        error = vessel.get("error_percent")
        return (-severe.get(vessel["vessel"], 0), -abs(error) if is_number(error) else 0.0)

    usable = [v for v in vessels if isinstance(v.get("along_mm"), list) and v["along_mm"]]
    chosen = sorted(usable, key=rank)[:MOST_PROFILES]
    return sorted(chosen, key=lambda vessel: vessel["vessel"])


def _profile(axes: Axes, vessel: Record, defects: Sequence[Record]) -> None:
    along, diameter = _numbers(vessel["along_mm"]), _numbers(vessel["diameter_um"])
    designed, length = float(vessel["designed_um"]), float(vessel["length_mm"])
    for first, last in vessel.get("unseen_mm") or []:
        axes.axvspan(first, last, color=MUTED, alpha=0.15, linewidth=0)
    for defect in defects:
        if defect.get("vessel") == vessel["vessel"]:
            colour = _colour(defect.get("decision"))
            axes.axvspan(defect["from_mm"], defect["to_mm"], color=colour, alpha=0.13, linewidth=0)
    edges = _limits(axes, vessel, along, length)
    axes.axhline(designed, color=MUTED, linewidth=0.8)
    half = _along(vessel, "interval_95_um", along)
    x, low = broken_line(along, diameter - half)
    axes.fill_between(
        x, low, broken_line(along, diameter + half)[1], color=INK, alpha=0.16, linewidth=0
    )
    axes.plot(*broken_line(along, diameter), color=INK, linewidth=0.9)
    _decided(axes, vessel, along, diameter)
    _title(axes, vessel, defects)
    axes.set_xlim(0, length)
    # The page finds the section under a click by its panel's frame.
    axes.patch.set_gid(f"along-{vessel['vessel']}-{length:.4f}")
    reach = np.concatenate([diameter, diameter - half, diameter + half, edges])
    reach = reach[np.isfinite(reach)]
    low_um, high_um = reach.min(initial=0.85 * designed), reach.max(initial=1.15 * designed)
    room = 0.06 * (high_um - low_um)
    axes.set_ylim(0 if low_um < 0.4 * designed else low_um - room, high_um + room)


def _along(vessel: Record, name: str, along: FloatArray) -> FloatArray:
    """Numbers along a vessel; unknown where it wasn't judged."""
    values = vessel.get(name)
    return _numbers(values) if isinstance(values, list) else np.full(len(along), np.nan)


def _limits(axes: Axes, vessel: Record, along: FloatArray, length: float) -> FloatArray:
    """Draw the band of what is allowed, carried on to the vessel's ends; return its edges."""
    lower, upper = (_along(vessel, name, along) for name in ("lower_um", "upper_um"))
    whole = np.concatenate([[0.0], along, [length]])
    band = [np.concatenate([edge[:1], edge, edge[-1:]]) for edge in (lower, upper)]
    axes.fill_between(whole, band[0], band[1], color=ACCENT, alpha=0.12, linewidth=0)
    for edge in band:
        axes.plot(whole, edge, color=ACCENT, linewidth=0.7)
    return np.concatenate(band)


def _decided(axes: Axes, vessel: Record, along: FloatArray, diameter: FloatArray) -> None:
    """Mark each section by its decision, by shape and by colour."""
    decisions = vessel.get("decision_along")
    if not isinstance(decisions, list):
        if len(along) < 4:
            axes.plot(along, diameter, ".", color=INK, markersize=4)
        return
    for decision, (marker, colour) in DECIDED.items():
        chosen = np.array([one == decision for one in decisions], dtype=np.bool_)
        axes.plot(along[chosen], diameter[chosen], marker, color=colour,
                  markersize=2.4 if decision == "pass" else 3.8, markeredgewidth=0)  # fmt: skip


def _title(axes: Axes, vessel: Record, defects: Sequence[Record]) -> None:
    said = [
        f"{d['kind']} ({d['decision']})" if d.get("decision") else str(d["kind"]) for d in defects
    ]
    worst = max((d.get("decision") for d in defects), default="pass",
                key=lambda decision: _SEVERE.get(str(decision), 1))  # fmt: skip
    names = ", ".join(dict.fromkeys(said))
    axes.set_title(
        f"vessel {vessel['vessel']}" + (f": {names}" if names else ""),
        loc="left",
        fontsize=8.6,
        color=_colour(worst) if names else INK,
    )


def _colour(decision: object) -> str:
    """Colour of what a finding's decision says; of none, as in an older file, its own."""
    return DECIDED[decision][1] if isinstance(decision, str) and decision else OUTSIDE


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
