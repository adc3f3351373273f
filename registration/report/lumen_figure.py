"""Figure of a lumen's wall coloured by wall shear, in two views."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from design.hemodynamics.three_d import LumenMesh, WallShear
from design.hemodynamics.three_d.lumen_mesh import WALL
from design.network import FloatArray
from design.units import DYN_CM2_PER_PA
from registration.report.drawing import styled, to_svg

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
    span = np.ptp(mesh.points, axis=0)
    # The thinnest direction is looked along first.
    order = np.argsort(span)
    views = [(order[2], order[1], order[0]), (order[2], order[0], order[1])]
    with styled():
        figure, grid = _panels(span[[view[0] for view in views]], span[[view[1] for view in views]])
        for axes, view in zip(grid, views, strict=True):
            drawn = _view(mesh.points[faces[:, :3]], value, view)
            drawn.set_norm(scale)
            drawn.set_rasterized(len(faces) > _MOST)
            axes.add_collection(drawn)
            axes.set_aspect("equal")
            axes.autoscale_view()
            axes.set_xlabel(f"{'xyz'[view[0]]} / mm")
            axes.set_ylabel(f"{'xyz'[view[1]]} / mm")
            axes.spines[["top", "right"]].set_visible(False)
        figure.colorbar(drawn, ax=list(grid), label="wall shear / (dyn/cm²)", shrink=0.6)
        return to_svg(figure, "wall shear")


def _panels(wide: FloatArray, high: FloatArray) -> tuple[Figure, list[Axes]]:
    """Two drawings of these sizes: one above the other where they are flat, else side by side."""
    if high.sum() <= 0.8 * wide[0]:
        figure = Figure(figsize=(7.4, 1.8 + 6.0 * high.sum() / wide[0]), layout="constrained")
        ratios = np.maximum(high, 0.15 * wide[0])
        return figure, list(figure.subplots(2, 1, height_ratios=ratios))
    figure = Figure(figsize=(9.4, 1.2 + 4.0 * high.max() / wide[0]), layout="constrained")
    return figure, list(figure.subplots(1, 2))


def _view(corners: FloatArray, value: FloatArray, view: tuple[int, int, int]) -> PolyCollection:
    """Triangles (f, 3, 3) seen along the last axis of ``view``, the nearest drawn last."""
    across, up, depth = view
    order = np.argsort(corners[:, :, depth].mean(axis=1))
    return PolyCollection(
        list(corners[order][:, :, [across, up]]), array=value[order], cmap="viridis",
        edgecolors="face", linewidths=0.2,
    )  # fmt: skip
