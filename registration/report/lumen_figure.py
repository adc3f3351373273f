"""Figures of a lumen in two views: wall shear, and streamlines."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from design.hemodynamics.three_d import Field, LumenMesh, WallShear
from design.hemodynamics.three_d.lumen_mesh import WALL
from design.hemodynamics.three_d.streamlines import trace_streamlines
from design.units import DYN_CM2_PER_PA
from kernels.arrays import FloatArray
from registration.report.drawing import styled, to_svg

View = tuple[int, int, int]
"""Coordinates drawn across, up, and looked along."""

_TOP = 98.0
"""Percentile at which the colours end: at rims and corners shear has peaks without meaning."""

_MOST = 1500
"""Triangles that are drawn as such; more are drawn as a picture, which takes less room."""


def shear_figure(mesh: LumenMesh, shear: WallShear) -> bytes:
    """The wall from the front and from above, in the colours of its shear.

    Returns
    -------
    bytes
        SVG.
    """
    faces = mesh.faces[mesh.label == WALL]
    at_node = np.zeros(len(mesh.points))
    at_node[shear.node] = shear.magnitude * DYN_CM2_PER_PA
    value = at_node[faces].mean(axis=1)
    scale = Normalize(0.0, float(np.percentile(value, _TOP)))

    def drawn(view: View) -> Collection:
        return _view(mesh.points[faces[:, :3]], value, view)

    return _two_views(mesh, drawn, scale, ("wall shear / (dyn/cm²)", "wall shear"), len(faces))


def streamline_figure(field: Field) -> bytes:
    """Streamlines from the front and from above, coloured by speed.

    Returns
    -------
    bytes
        SVG.
    """
    lines = trace_streamlines(field)
    pieces = np.concatenate([np.stack([p[:-1], p[1:]], axis=1) for p, _ in lines])
    speed = np.concatenate([0.5 * (s[:-1] + s[1:]) for _, s in lines])
    scale = Normalize(0.0, float(np.percentile(speed, _TOP)))

    def drawn(view: View) -> Collection:
        order = np.argsort(pieces[:, :, view[2]].mean(axis=1))
        return LineCollection(
            list(pieces[order][:, :, list(view[:2])]), array=speed[order], cmap="viridis",
            linewidths=0.6,
        )  # fmt: skip

    return _two_views(field.mesh, drawn, scale, ("speed / (mm/s)", "streamlines"), len(pieces))


def _two_views(
    mesh: LumenMesh,
    drawn: Callable[[View], Collection],
    scale: Normalize,
    names: tuple[str, str],
    count: int,
) -> bytes:
    """Draw ``count`` parts along the two thinnest directions; label and title are ``names``."""
    span = np.ptp(mesh.points, axis=0)
    # The thinnest direction is looked along first.
    order = np.argsort(span)
    views = [(order[2], order[1], order[0]), (order[2], order[0], order[1])]
    with styled():
        figure, grid = _panels(span[[view[0] for view in views]], span[[view[1] for view in views]])
        for axes, view in zip(grid, views, strict=True):
            parts = drawn(view)
            parts.set_norm(scale)
            parts.set_rasterized(count > _MOST)
            axes.add_collection(parts)
            axes.set_aspect("equal")
            axes.autoscale_view()
            axes.set_xlabel(f"{'xyz'[view[0]]} / mm")
            axes.set_ylabel(f"{'xyz'[view[1]]} / mm")
            axes.spines[["top", "right"]].set_visible(False)
        figure.colorbar(parts, ax=list(grid), label=names[0], shrink=0.6)
        return to_svg(figure, names[1])


def _panels(wide: FloatArray, high: FloatArray) -> tuple[Figure, list[Axes]]:
    """Two drawings of these sizes: one above the other where they are flat, else side by side."""
    if high.sum() <= 0.8 * wide[0]:
        figure = Figure(figsize=(7.4, 1.8 + 6.0 * high.sum() / wide[0]), layout="constrained")
        ratios = np.maximum(high, 0.15 * wide[0])
        return figure, list(figure.subplots(2, 1, height_ratios=ratios))
    figure = Figure(figsize=(9.4, 1.2 + 4.0 * high.max() / wide[0]), layout="constrained")
    return figure, list(figure.subplots(1, 2))


def _view(corners: FloatArray, value: FloatArray, view: View) -> PolyCollection:
    """Triangles (f, 3, 3) seen along the last axis of ``view``, the nearest drawn last."""
    across, up, depth = view
    order = np.argsort(corners[:, :, depth].mean(axis=1))
    return PolyCollection(
        list(corners[order][:, :, [across, up]]), array=value[order], cmap="viridis",
        edgecolors="face", linewidths=0.2,
    )  # fmt: skip
