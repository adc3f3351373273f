"""Place a tree's stem (the root's entry into the tissue), and lengthen one too short."""

from __future__ import annotations

import numpy as np

from design.errors import RootError, TissueError
from design.tissue import Tissue
from design.vasculature.growth.clearances import Clearances
from design.vasculature.growth.state import Segments, place, refresh
from design.vasculature.options import GrowthOptions, Law
from kernels.arrays import FloatArray

_STEM_DEPTH = 1.5
"""Depth of the stem's end over what its children need: they leave it sideways."""

_STEM_LENGTH = 1.15
"""Length of the stem over its least: the final radius may be larger than predicted."""

_LONGER = 1.01
"""The same where the stem turned out too short."""


def stem(
    tissue: Tissue, options: GrowthOptions, root_radius: float, wall_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Ends of the root's segment, (3,) each, mm.

    It runs straight from the root point along its direction, to the first place deep enough
    for its children with half as much again, or else to the deepest place before it leaves the
    tissue; in either case so far that it is long enough for its radius.

    Raises
    ------
    TissueError
        When the tissue nowhere holds the children of the root.
    RootError
        When the direction misses the tissue, or is too shallow for the children or too short for
        the root's radius.
    """
    point, direction = tissue.top_vertex()
    if options.root_point_mm is not None:
        point = np.array(options.root_point_mm, dtype=np.float64)
        direction = -_outward(tissue, point)
    if options.root_direction is not None:
        given = np.array(options.root_direction, dtype=np.float64)
        direction = given / np.linalg.norm(given)
    step = 0.25 * tissue.grid.spacing_mm
    far = float(np.linalg.norm(np.ptp(tissue.bounds, axis=0))) + float(
        np.linalg.norm(point - tissue.bounds.mean(axis=0))
    )
    along: FloatArray = step * np.arange(1, int(far / step) + 2, dtype=np.float64)
    depth = -tissue.grid.distance(point + along[:, None] * direction)
    depth = _first_stay(depth, along, point, direction, root_radius)
    child = root_radius * 0.5 ** (1.0 / options.murray_exponent)
    need = child + wall_mm
    if tissue.grid.deepest_mm < need:
        raise TissueError(
            f"tissue is too thin for these vessels: {tissue.grid.deepest_mm:.3g} mm deep at most, "
            f"and the first branches need {need:.3g} mm (radius {child:.3g} and {wall_mm:.3g} to "
            "the surface); ask for fewer terminals, a smaller smallest radius or clearance"
        )
    if depth.max() < need:
        raise RootError(
            f"root at {_say(point)} along {_say(direction)} reaches {depth.max():.3g} mm below the "
            f"surface, and its first branches need {need:.3g} mm; choose another root point or "
            "direction, fewer terminals, a smaller smallest radius or clearance"
        )
    long = along[: len(depth)] >= _STEM_LENGTH * options.length_to_radius * root_radius
    if depth[long].max(initial=-np.inf) < need:
        raise RootError(
            f"root at {_say(point)} along {_say(direction)} leaves no room for a stem "
            f"{options.length_to_radius:g} times as long as its radius of {root_radius:.3g} mm "
            "(length_to_radius); choose another root point or direction, fewer terminals, "
            "a smaller smallest radius or length_to_radius"
        )
    enough = np.flatnonzero(long & (depth >= _STEM_DEPTH * need))
    end = int(enough[0]) if len(enough) else int(np.argmax(np.where(long, depth, -np.inf)))
    return point, point + along[end] * direction


def stem_is_short(segments: Segments, room: Clearances) -> bool:
    """Whether the root's segment is shorter than its radius asks for."""
    return bool(segments[0]["length"] < room.length_to_radius * segments[0]["radius"])


def lengthen_stem(segments: Segments, room: Clearances, law: Law) -> None:
    """Move the root's bifurcation on along the stem; the audit that follows judges it there."""
    s = segments[0]
    begin = np.array([s["px"], s["py"], s["pz"]])
    end = np.array([s["dx"], s["dy"], s["dz"]])
    longer = _LONGER * room.length_to_radius * s["radius"] / s["length"]
    end = begin + longer * (end - begin)
    place(segments, 0, tuple(begin), tuple(end))
    for child in (int(s["left"]), int(s["right"])):
        if child >= 0:
            tip = segments[child]
            place(segments, child, tuple(end), (tip["dx"], tip["dy"], tip["dz"]))
            refresh(segments, child, law)
    refresh(segments, 0, law)


def _first_stay(
    depth: FloatArray, along: FloatArray, point: FloatArray, direction: FloatArray, near: float
) -> FloatArray:
    """Depths up to where the line leaves the tissue for the first time."""
    inside = depth > 0
    if not inside.any():
        raise RootError(
            f"root at {_say(point)} along {_say(direction)} never enters the tissue; give a "
            "root point on its surface and a direction into it"
        )
    first = int(np.argmax(inside))
    if along[first] > 2.0 * near + 4.0 * along[0]:
        raise RootError(
            f"root at {_say(point)} is outside the tissue, {along[first]:.3g} mm before its "
            "surface; give a root point on the surface"
        )
    leaves = np.flatnonzero(~inside[first:])
    return depth[: first + int(leaves[0])] if len(leaves) else depth


def _outward(tissue: Tissue, point: FloatArray) -> FloatArray:
    """Direction in which the signed distance rises at a point."""
    h = tissue.grid.spacing_mm
    ends = np.concatenate([point + h * np.eye(3), point - h * np.eye(3)])
    value = tissue.grid.distance(ends)
    slope = value[:3] - value[3:]
    size = float(np.linalg.norm(slope))
    if not size > 0:
        raise RootError(f"root at {_say(point)}: no surface near it; give a root_direction too")
    unit: FloatArray = slope / size
    return unit


def _say(vector: FloatArray) -> str:
    return "({:.4g}, {:.4g}, {:.4g})".format(*vector)
