"""Figures of a lumen in two views: wall shear, pressure, and streamlines."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import Collection, LineCollection, PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure

from design.hemodynamics.three_d import Field, LumenMesh, WallShear
from design.hemodynamics.three_d.meshing.lumen_mesh import WALL
from design.hemodynamics.three_d.residence import trace_streamlines
from design.hemodynamics.three_d.solution import at_points
from design.units import DYN_CM2_PER_PA, PA_PER_MMHG
from kernels.arrays import FloatArray
from report.drawing import styled, to_svg
from report.svg import INK, RULE

View = tuple[int, int, int]
"""Coordinates drawn across, up, and looked along."""

_TOP = 98.0
"""Percentile at which the colours end: at rims and corners shear has peaks without meaning."""

_MOST = 1500
"""Triangles that are drawn as such; more are drawn as a picture, which takes less room."""

_ARROWS = 24
"""Streamlines with an arrow, at most."""


def shear_figure(mesh: LumenMesh, shear: WallShear) -> bytes:
    """Draw the wall in two views, coloured by its shear.

    Returns
    -------
    bytes
        SVG.
    """
    at_node = np.zeros(len(mesh.points))
    at_node[shear.node] = shear.magnitude * DYN_CM2_PER_PA
    names = "wall shear / (dyn/cm²); 10 dyn/cm² = 1 Pa", "Wall shear stress in steady 3D flow"
    return _wall_figure(mesh, at_node, _TOP, names)


def pressure_figure(field: Field) -> bytes:
    """Draw the wall in two views, coloured by pressure.

    Returns
    -------
    bytes
        SVG.
    """
    at_node = at_points(field.mesh, field.pressure, field.order - 1)[:, 0] / PA_PER_MMHG
    return _wall_figure(
        field.mesh, at_node, 100.0, ("pressure / mmHg", "Pressure in steady 3D flow")
    )


def _wall_figure(mesh: LumenMesh, at_node: FloatArray, top: float, names: tuple[str, str]) -> bytes:
    """Colour the wall by a value at each node, (p,), up to its percentile ``top``."""
    faces = mesh.faces[mesh.label == WALL]
    value = at_node[faces].mean(axis=1)
    scale = Normalize(min(0.0, float(value.min())), float(np.percentile(value, top)))

    def draw(axes: Axes, view: View) -> Collection:
        return _add(axes, _triangles(mesh.points[faces[:, :3]], view, value))

    return _two_views(mesh, draw, scale, names, len(faces))


def streamline_figure(field: Field) -> bytes:
    """Draw streamlines in two views, coloured by speed, with arrows, before the lumen's shadow.

    Returns
    -------
    bytes
        SVG.
    """
    lines = trace_streamlines(field)
    pieces = np.concatenate([np.stack([p[:-1], p[1:]], axis=1) for p, _ in lines])
    speed = np.concatenate([0.5 * (s[:-1] + s[1:]) for _, s in lines])
    scale = Normalize(0.0, float(np.percentile(speed, _TOP)))
    wall = field.mesh.points[field.mesh.faces[field.mesh.label == WALL, :3]]
    some = [points for points, _ in lines[:: 1 + len(lines) // _ARROWS]]
    places = np.linspace(0.1, 0.9, len(some))
    starts = [int(place * (len(p) - 1)) for p, place in zip(some, places, strict=True)]
    arrows = np.array([p[n : n + 2] for p, n in zip(some, starts, strict=True)])
    # A line's last step may have no length.
    arrows = arrows[(arrows[:, 0] != arrows[:, 1]).any(axis=1)]

    def draw(axes: Axes, view: View) -> Collection:
        across, up, depth = view
        order = np.argsort(pieces[:, :, depth].mean(axis=1))
        _add(axes, _triangles(wall, view))
        found = _add(axes, LineCollection(
            list(pieces[order][:, :, [across, up]]), array=speed[order], cmap="viridis",
            linewidths=0.6,
        ))  # fmt: skip
        way = arrows[:, 1] - arrows[:, 0]
        way /= np.linalg.norm(way, axis=1, keepdims=True)
        axes.quiver(
            arrows[:, 0, across], arrows[:, 0, up], way[:, across], way[:, up], color=INK,
            angles="xy", pivot="mid", scale=18.0, width=0.005, zorder=3,
        )  # fmt: skip
        return found

    names = "speed / (mm/s)", "Streamlines of steady 3D flow; arrows point downstream"
    return _two_views(field.mesh, draw, scale, names, len(pieces) + len(wall))


def _add(axes: Axes, parts: Collection) -> Collection:
    axes.add_collection(parts)
    return parts


def _two_views(
    mesh: LumenMesh,
    draw: Callable[[Axes, View], Collection],
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
            parts = draw(axes, view)
            parts.set_norm(scale)
            for each in axes.collections:
                each.set_rasterized(count > _MOST)
            axes.set_title(f"seen along {'xyz'[view[2]]}")
            axes.set_aspect("equal")
            axes.autoscale_view()
            axes.set_xlabel(f"{'xyz'[view[0]]} / mm")
            axes.set_ylabel(f"{'xyz'[view[1]]} / mm")
            axes.spines[["top", "right"]].set_visible(False)
        # Above the colours' end lie peaks at rims and corners.
        coloured: Any = parts.get_array()
        beyond = "max" if coloured.max() > scale.vmax else "neither"
        figure.colorbar(parts, ax=list(grid), label=names[0], shrink=0.8, extend=beyond)
        figure.suptitle(names[1])
        return to_svg(figure, names[1])


def _panels(wide: FloatArray, high: FloatArray) -> tuple[Figure, list[Axes]]:
    """Two drawings of these sizes: one above the other where they are flat, else side by side."""
    if high.sum() <= 0.8 * wide[0]:
        figure = Figure(figsize=(7.4, 1.8 + 6.0 * high.sum() / wide[0]), layout="constrained")
        ratios = np.maximum(high, 0.15 * wide[0])
        return figure, list(figure.subplots(2, 1, height_ratios=ratios))
    figure = Figure(figsize=(9.4, 1.2 + 4.0 * high.max() / wide[0]), layout="constrained")
    return figure, list(figure.subplots(1, 2))


def _triangles(corners: FloatArray, view: View, value: FloatArray | None = None) -> PolyCollection:
    """Return triangles (f, 3, 3) seen along the last axis of ``view``, the nearest drawn last.

    They are coloured by their ``value`` (f,), or all grey.
    """
    across, up, depth = view
    order = np.argsort(corners[:, :, depth].mean(axis=1))
    return PolyCollection(
        list(corners[order][:, :, [across, up]]),
        array=None if value is None else value[order], cmap="viridis", facecolors=RULE,
        edgecolors="face", linewidths=0.2,
    )  # fmt: skip
