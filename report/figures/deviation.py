"""SVG figures of the report: deviation histogram, vessel diameters against design, network."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize, TwoSlopeNorm, to_rgba
from numpy.typing import NDArray

from design.network import VesselNetwork
from kernels.arrays import FloatArray
from registration.json_ready import Record, is_number
from report.drawing import aspect, blank, draw_scaled_lines, set_limits, styled, to_svg
from report.picture.colours import DIVERGING, NO_DATA, SEQUENTIAL
from report.svg import ACCENT, BAD, INK, MUTED, PAPER
from report.wording import plain

OUTSIDE: Final = "#b85a14"
UNDECIDED: Final = "#a97a00"
DECIDED: Final = {
    "": ("o", ACCENT),
    "pass": ("o", ACCENT),
    "undecided": ("^", UNDECIDED),
    "fail": ("s", BAD),
}
"""Marker and colour of each decision; of what wasn't judged, too."""
LABELLED_VESSELS = 14
"""A plot with more vessels than this leaves every crowded point without a name."""


def histogram_figure(edges_um: Sequence[float], counts: Sequence[float]) -> bytes:
    """Histogram of the signed deviation, coloured like the 3D view.

    Parameters
    ----------
    edges_um : (n + 1,) floats, µm
        Ascending.
    counts : (n,) floats
        Of points, or area; shown as shares of their sum.

    Returns
    -------
    bytes
        SVG.
    """
    edges, share = np.asarray(edges_um, float), np.asarray(counts, float)
    share = 100.0 * share / max(share.sum(), 1e-300)
    middle = (edges[1:] + edges[:-1]) / 2.0
    reach = max(float(np.abs(edges).max()), 1e-9)
    colours = DIVERGING(TwoSlopeNorm(0.0, -reach, reach)(middle))
    with styled():
        figure, axes = blank(5.2, 3.1)
        axes.add_collection(
            PolyCollection(
                list(_bars(edges, share)), facecolors=colours, edgecolors=MUTED, linewidths=0.4
            )
        )
        axes.axvline(0.0, color=INK, linewidth=0.8)
        axes.set(xlabel="signed deviation / µm", ylabel="share of the surface / %")
        axes.set_xlim(edges[0], edges[-1])
        axes.set_ylim(0.0, 1.06 * float(share.max()) or 1.0)
        return to_svg(figure, "histogram")


def _bars(edges: FloatArray, height: FloatArray) -> FloatArray:
    """Corners of a histogram's bars, (n, 4, 2): one collection draws faster than n patches."""
    left, right, floor = edges[:-1], edges[1:], np.zeros(len(height))
    x = np.stack([left, left, right, right], axis=1)
    return np.stack([x, np.stack([floor, height, height, floor], axis=1)], axis=2)


def diameter_figure(rows: Sequence[Record]) -> bytes:
    """Each vessel's mean diameter against the designed one, with what is allowed there.

    Parameters
    ----------
    rows : sequence of mapping
        ``vessel``, ``designed_um`` and ``value_um`` (deviation); of judged ones ``u_um`` (half
        width of the 95 % interval), ``lower_um`` and ``upper_um`` (allowed deviation), and
        ``decision``. A vessel without a value is left out.

    Returns
    -------
    bytes
        SVG.
    """
    shown = [row for row in rows if is_number(row.get("value_um"))]
    x, error = (np.array([row[key] for row in shown], float) for key in ("designed_um", "value_um"))
    half, *edges = (_known(shown, key) for key in ("u_um", "lower_um", "upper_um"))
    reach = [*x, *(x + error), *(x + error - half), *(x + error + half), *(x + e for e in edges)]
    ends = np.concatenate([np.atleast_1d(one) for one in reach]) if shown else np.array([0.0, 1.0])
    room = 0.05 * (np.nanmax(ends) - np.nanmin(ends)) + 1.0
    low, top = np.nanmin(ends) - room, np.nanmax(ends) + room
    decisions = np.array([str(row.get("decision", "")) for row in shown])
    with styled():
        figure, axes = blank(5.2, 3.6)
        axes.plot([low, top], [low, top], color=MUTED, linewidth=0.8, label="as designed")
        # Of vessels alike once: bars over each other would look darker.
        at, least, most = np.unique(np.stack([x, x + edges[0], x + edges[1]]), axis=1)
        axes.vlines(at, least, most, color=ACCENT, alpha=0.22, linewidth=7, label="allowed")
        axes.vlines(x, x + error - half, x + error + half, color=INK, linewidth=0.8)
        for decision, (marker, colour) in DECIDED.items():
            _mark(axes, x, x + error, decisions == decision, marker, colour, decision or "measured")
        for i in _worth_a_name(x, x + error, decisions == "fail", 0.04 * (top - low)):
            axes.annotate(plain(shown[i]["vessel"]), (x[i], x[i] + error[i]), (5, -8),
                          textcoords="offset points", color=MUTED, fontsize=7.5)  # fmt: skip
        axes.set(xlabel="designed diameter / µm", ylabel="measured mean diameter / µm")
        axes.set(xlim=(low, top), ylim=(low, top))
        axes.legend(loc="upper left")
        return to_svg(figure, "diameters")


def _known(rows: Sequence[Record], key: str) -> FloatArray:
    return np.array([row[key] if is_number(row.get(key)) else np.nan for row in rows], float)


def _mark(
    axes: Axes, x: FloatArray, y: FloatArray, which: NDArray[np.bool_], marker: str, colour: str,
    label: str,
) -> None:  # fmt: skip
    if which.any():
        axes.plot(x[which], y[which], marker, markersize=5, color=colour, markeredgecolor=PAPER,
                  markeredgewidth=0.7, linestyle="", label=f"{label} ({which.sum()})")  # fmt: skip


def _worth_a_name(x: FloatArray, y: FloatArray, off: NDArray[np.bool_], crowd: float) -> list[int]:
    """Points with none of the others nearer than ``crowd``; of few points, all that are off."""
    alone = np.array(
        [(np.hypot(x - a, y - b) < crowd).sum() == 1 for a, b in zip(x, y, strict=True)]
    )
    few = len(x) <= LABELLED_VESSELS
    return [i for i in range(len(x)) if alone[i] or (few and off[i])]


def network_figure(
    network: VesselNetwork,
    values: NDArray[np.floating[Any]] | None = None,
    label: str = "diameter / mm",
) -> bytes:
    """The network in the plane of its two longest extents, lumens drawn to scale.

    Parameters
    ----------
    network : VesselNetwork
    values : (v,) or (p,) float or None
        A number for each vessel (flow, say) or each point of the polylines (pressure); None
        colours by the local diameter in mm. NaN is drawn grey.
    label : str
        Name and unit of `values`, beside the colour bar.

    Returns
    -------
    bytes
        SVG.
    """
    start, end, r0, r1, _ = network.pieces()
    start, end = flush_ends(network, start, end, r0, r1)
    colour = piece_values(network, values)
    extent = np.ptp(network.points, axis=0)
    across, up = sorted(np.argsort(-extent, kind="stable")[:2])
    # Deep pieces first, so that what lies above is drawn above.
    depth = ({0, 1, 2} - {int(across), int(up)}).pop()
    order = np.argsort((start + end)[:, depth], kind="stable")
    lines = np.stack([start, end], axis=1)[order][:, :, [across, up]]
    finite = colour[np.isfinite(colour)]
    low, high = (float(finite.min()), float(finite.max())) if len(finite) else (0.0, 1.0)
    norm = Normalize(low, high if high > low else low + (abs(low) or 1.0))
    rgba = SEQUENTIAL(norm(np.nan_to_num(colour[order], nan=low)))
    rgba[~np.isfinite(colour[order])] = to_rgba(NO_DATA)
    with styled():
        figure, axes = blank(5.2, 5.2 * aspect(extent[[across, up]]) + 0.5)
        names = "xyz"
        axes.set(xlabel=f"{names[across]} / mm", ylabel=f"{names[up]} / mm", aspect="equal")
        set_limits(axes, network.points[:, [across, up]], float(network.radius.max()))
        bar = figure.colorbar(ScalarMappable(norm, SEQUENTIAL), ax=axes, pad=0.02, shrink=0.9)
        if high == low:
            bar.set_ticks([low])
        bar.set_label(label)
        bar.outline.set_visible(False)
        draw_scaled_lines(figure, list(lines), (r0 + r1)[order], rgba)
        return to_svg(figure, "network")


def piece_values(network: VesselNetwork, values: NDArray[np.floating[Any]] | None) -> FloatArray:
    """A number for each straight piece from one per vessel or one per point (its mean)."""
    vessel = network.pieces()[4]
    if values is None:
        values = 2.0 * network.radius
    if len(values) == network.vessel_count:
        return np.asarray(values, dtype=np.float64)[vessel]
    of_point = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    first = np.flatnonzero(of_point[:-1] == of_point[1:])
    return np.asarray((values[first] + values[first + 1]) / 2.0, dtype=np.float64)


def flush_ends(
    network: VesselNetwork, start: FloatArray, end: FloatArray, r0: FloatArray, r1: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Pieces (n, 3) drawn back by their radius at open ends, so that a round cap ends flush."""
    along = end - start
    length = np.linalg.norm(along, axis=1, keepdims=True)
    pieces_before = np.concatenate([[0], np.cumsum(np.diff(network.offset) - 1)])
    is_open = network.degree()[network.vessel_nodes] == 1
    first, last = pieces_before[:-1][is_open[:, 0]], pieces_before[1:][is_open[:, 1]] - 1
    back = np.zeros((2, len(start), 1))
    back[0, first, 0], back[1, last, 0] = r0[first], r1[last]
    step = along / np.maximum(length, 1e-12)
    # A stub shorter than its radius keeps a little of itself.
    back = np.minimum(back, 0.45 * length)
    return start + back[0] * step, end - back[1] * step
