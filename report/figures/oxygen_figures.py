"""Pictures of tissue oxygen: a section through the worst-supplied point, and a histogram."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import Normalize

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from report.drawing import blank, styled, to_svg
from report.figures.deviation import OUTSIDE
from report.picture.colours import SEQUENTIAL
from report.svg import ACCENT, INK, MUTED, PAPER

if TYPE_CHECKING:
    from design.hemodynamics.oxygen import OxygenSolution

_MOST_PX = 800


def slice_figure(solution: OxygenSolution, network: VesselNetwork) -> bytes:
    """Oxygen in the plane through the tissue's worst place in which it varies most; SVG.

    Lumens wider than a cell are blank, axes that run within a cell of the plane or cross it
    there are drawn as lines, the threshold as a line, and the worst place as a
    cross (`OxygenSolution.worst`).
    """
    # Every report loads this module; only one with oxygen waits for grids of tissue.
    from design.hemodynamics.oxygen import HALF

    worst, grid = solution.worst, solution.grid
    axis = _telling(solution)
    across, up = (k for k in range(3) if k != axis)
    field = np.take(solution.concentration, worst[axis], axis=axis)
    shown = np.take(solution.tissue_share, worst[axis], axis=axis) >= HALF
    h, low = grid.spacing_mm, grid.origin_mm
    extent = (
        low[across] - h / 2, low[across] + h * (field.shape[0] - 0.5),
        low[up] - h / 2, low[up] + h * (field.shape[1] - 0.5),
    )  # fmt: skip
    norm = Normalize(0.0, float(max(solution.conditions.inlet_millimolar, field.max())))
    rgba = SEQUENTIAL(norm(np.maximum(field, 0.0)))
    rgba[..., 3] = shown
    step = max(1, max(field.shape) // _MOST_PX)
    place = low + h * np.array(worst)
    with styled():
        high = (extent[3] - extent[2]) / (extent[1] - extent[0])
        figure, axes = blank(6.4, 5.4 * float(np.clip(high, 0.25, 1.3)) + 0.7)
        axes.imshow(
            rgba[::step, ::step].transpose(1, 0, 2), extent=extent, origin="lower",
            interpolation="nearest",
        )  # fmt: skip
        _threshold(axes, np.where(shown, field, np.nan), extent, solution)
        axes.add_collection(
            LineCollection(
                _near(network, axis, place[axis], h, (across, up)), colors=PAPER, linewidths=0.8
            )
        )
        axes.plot(place[across], place[up], "+", color=OUTSIDE, markersize=13,
                  markeredgewidth=2.0, label="worst place")  # fmt: skip
        names = "xyz"
        axes.set(xlabel=f"{names[across]} / mm", ylabel=f"{names[up]} / mm", aspect="equal")
        axes.set_title(f"{names[axis]} = {place[axis]:.4g} mm", fontsize=9, color=MUTED)
        bar = figure.colorbar(ScalarMappable(norm, SEQUENTIAL), ax=axes, pad=0.02, shrink=0.9)
        bar.set_label("oxygen / mM")
        bar.outline.set_visible(False)
        return to_svg(figure, "oxygen-slice")


def _telling(solution: OxygenSolution) -> int:
    """Axis normal to the plane through the worst place in which oxygen varies most."""

    def spread(axis: int) -> float:
        field, inside = (
            np.take(values, solution.worst[axis], axis=axis)
            for values in (solution.concentration, solution.grid.inside)
        )
        return float(np.std(field[inside]))

    return max((2, 1, 0), key=spread)


def _threshold(
    axes: Any, field: FloatArray, extent: tuple[float, ...], solution: OxygenSolution
) -> None:
    level, known = solution.conditions.threshold_millimolar, field[np.isfinite(field)]
    # Without both sides matplotlib warns that there is no line.
    if known.min() < level < known.max():
        axes.contour(
            np.ma.masked_invalid(field).T, [level], extent=extent, origin="lower",
            colors=OUTSIDE, linewidths=1.0,
        )  # fmt: skip


def _near(
    network: VesselNetwork, axis: int, at: float, h: float, plane: tuple[int, int]
) -> list[FloatArray]:
    """What lies of the axes between two planes one cell to either side."""
    start, end, _, _, _ = network.pieces()
    along = end[:, axis] - start[:, axis]
    with np.errstate(divide="ignore", invalid="ignore"):
        enter = (at - h - start[:, axis]) / along
        leave = (at + h - start[:, axis]) / along
    flat = np.abs(along) < 1e-12
    beside = flat & (np.abs(start[:, axis] - at) > h)
    enter, leave = np.where(flat, 0.0, enter), np.where(flat, 1.0, leave)
    low = np.clip(np.minimum(enter, leave), 0.0, 1.0)
    high = np.clip(np.maximum(enter, leave), 0.0, 1.0)
    kept = (high > low) & ~beside
    a, step = start[kept][:, plane], (end - start)[kept][:, plane]
    lines = np.stack([a + low[kept, None] * step, a + high[kept, None] * step], axis=1)
    return list(np.asarray(lines, dtype=np.float64))


def oxygen_histogram(histogram: Mapping[str, Any], threshold_millimolar: float) -> bytes:
    """Share of the tissue by its oxygen, with the threshold; SVG.

    Parameters
    ----------
    histogram : mapping
        ``edges_millimolar`` (n + 1) and ``share`` (n).
    threshold_millimolar : float
    """
    edges = np.asarray(histogram["edges_millimolar"], dtype=np.float64)
    share = 100.0 * np.asarray(histogram["share"], dtype=np.float64)
    with styled():
        figure, axes = blank(5.2, 3.0)
        axes.bar(edges[:-1], share, np.diff(edges), align="edge", color=ACCENT, linewidth=0.3)
        axes.axvline(threshold_millimolar, color=OUTSIDE, linewidth=1.0, label="threshold")
        axes.set(xlabel="oxygen / mM", ylabel="share of the tissue / %")
        axes.set_xlim(edges[0], edges[-1])
        axes.tick_params(colors=INK)
        axes.legend(loc="upper right")
        return to_svg(figure, "oxygen-histogram")
