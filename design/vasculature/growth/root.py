"""Place a tree's stem (the root's entry into the tissue), and lengthen one too short."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from design.errors import (
    RootError,
    ThinTissueError,
    TrunkWallError,
)
from design.tissue import Tissue
from design.vasculature.growth.kernels.cost import Segments, place, refresh
from design.vasculature.growth.kernels.index import Clearances
from design.vasculature.growth.mouths import find_mouths
from design.vasculature.options import GrowthOptions, Law
from kernels.arrays import FloatArray


class StemSettings(NamedTuple):
    """Size of the root's segment."""

    depth_factor: float = 1.5
    """Depth of its end over what its children need: they leave it sideways."""
    length_factor: float = 1.15
    """Length over the least: the final radius may be larger than predicted."""
    lengthening_factor: float = 1.01
    """The same where it turned out too short."""
    mouth_factor: float = 2.0
    """Length of a trunk's mouth at most, over its radius and wall: of one that enters at 30
    degrees to the face."""
    guess_margin: float = 1.25
    """Room for a trunk over its radius as predicted from the pressure drop: trees of 200 to 1000
    terminals in the shipped shapes became up to 1.1 times as wide."""
    max_steps: int = 1000
    """Samples along each straight tried for the vessel of a tree with one terminal."""


STEM = StemSettings()


def stem(
    tissue: Tissue, options: GrowthOptions, root_radius: float, wall_mm: float
) -> tuple[FloatArray, FloatArray]:
    """Ends of the root's segment, (3,) each, mm.

    It runs straight from the root point along its direction, to the first place deep enough
    for its children with half as much again, or else to the deepest place before it leaves the
    tissue; in either case so far that it is long enough for its radius. Only its mouth opens the
    surface (`trunk_gap`). Without a root point the first of `find_mouths` where all this fits is
    taken.

    Raises
    ------
    ThinTissueError
        When the tissue nowhere holds the children of the root.
    RootError
        When the direction misses the tissue, or is too shallow for the children, too short for
        the root's radius or too near to another face for its wall.
    """
    child = root_radius * 0.5 ** (1.0 / options.murray_exponent)
    if tissue.grid.deepest_mm < child + wall_mm:
        raise ThinTissueError(
            f"tissue is too thin for these vessels: {tissue.grid.deepest_mm:.3g} mm deep at most, "
            f"and the first branches need {child + wall_mm:.3g} mm (radius {child:.3g} and "
            f"{wall_mm:.3g} to the surface); ask for fewer terminals, a smaller "
            "smallest_diameter_mm or clearance_mm"
        )
    direction = None
    if options.root_direction is not None:
        direction = np.array(options.root_direction, dtype=np.float64)
        direction = direction / np.linalg.norm(direction)
    if options.root_at_top:
        point, inward = tissue.top_vertex()
        return _stem_from(tissue, options, root_radius, wall_mm, point, inward)
    if options.root_point_mm is not None:
        point = np.array(options.root_point_mm, dtype=np.float64)
        direction = -_outward(tissue, point) if direction is None else direction
        return _stem_from(tissue, options, root_radius, wall_mm, point, direction)
    for reach in mouth_reaches(options, root_radius, wall_mm):
        for mouth in find_mouths(tissue, reach, direction):
            way = mouth.inward if direction is None else direction
            with suppress(RootError):
                return _stem_from(tissue, options, root_radius, wall_mm, mouth.point, way)
    raise RootError(
        f"no face of the tissue has room for a trunk of {2 * root_radius:.3g} mm with walls of "
        f"{wall_mm:.3g} mm; choose a root (root_mm, root_direction), fewer terminals, a smaller "
        "smallest_diameter_mm or clearance_mm"
    )


def mouth_reaches(options: GrowthOptions, radius: float, wall_mm: float) -> tuple[float, ...]:
    """Least distances of a mouth from every edge, in the order in which they are tried, mm.

    A radius that follows from the smallest one is the largest that the trunk gets; one that follows
    from the pressure drop is a guess, and may turn out larger.
    """
    if options.smallest_radius_mm is not None:
        return (radius + wall_mm,)
    return (STEM.guess_margin * radius + wall_mm, radius + wall_mm)


def _stem_from(
    tissue: Tissue,
    options: GrowthOptions,
    root_radius: float,
    wall_mm: float,
    point: FloatArray,
    direction: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    step = 0.25 * tissue.grid.spacing_mm
    far = float(np.linalg.norm(np.ptp(tissue.bounds, axis=0))) + float(
        np.linalg.norm(point - tissue.bounds.mean(axis=0))
    )
    along: FloatArray = step * np.arange(1, int(far / step) + 2, dtype=np.float64)
    depth = -tissue.grid.distance(point + along[:, None] * direction)
    depth = _first_stay(depth, along, point, direction, root_radius)
    need = root_radius * 0.5 ** (1.0 / options.murray_exponent) + wall_mm
    if depth.max() < need:
        raise RootError(
            f"root at {_say(point)} along {_say(direction)} reaches {depth.max():.3g} mm below the "
            f"surface, and its first branches need {need:.3g} mm; choose another root point or "
            "direction, fewer terminals, a smaller smallest_diameter_mm or clearance_mm"
        )
    long = along[: len(depth)] >= STEM.length_factor * options.length_to_radius * root_radius
    if depth[long].max(initial=-np.inf) < need:
        raise RootError(
            f"root at {_say(point)} along {_say(direction)} leaves no room for a stem "
            f"{options.length_to_radius:g} times as long as its radius of {root_radius:.3g} mm "
            "(length_to_radius); choose another root point or direction, fewer terminals, "
            "a smaller smallest_diameter_mm or length_to_radius"
        )
    enough = np.flatnonzero(long & (depth >= STEM.depth_factor * need))
    end = int(enough[0]) if len(enough) else int(np.argmax(np.where(long, depth, -np.inf)))
    tip = point + along[end] * direction
    if not options.root_at_top:
        check_trunk_wall(tissue, point, tip, root_radius, wall_mm)
    return point, tip


def check_trunk_wall(
    tissue: Tissue, begin: FloatArray, end: FloatArray, radius: float, wall_mm: float
) -> None:
    """Refuse a trunk that opens the surface beyond its mouth.

    The mouth ends where the tissue is as deep as the radius and the wall all round. In a face that
    is met squarely it is as long as these, and twice as long where it is met at 30 degrees: a trunk
    that hasn't its wall by then, or loses it later, runs beside or through another face. What
    follows is measured exactly.

    Raises
    ------
    RootError
        With the place and the wall there.
    """
    need, length = radius + wall_mm, float(np.linalg.norm(end - begin))
    way = (end - begin) / length
    step = 0.25 * tissue.grid.spacing_mm
    along: FloatArray = np.append(np.arange(step, length, step), length)
    depth = -tissue.grid.distance(begin + along[:, None] * way)
    enters = float(along[int(np.argmax(depth > 0))])
    deep = np.flatnonzero((depth >= need) & (along <= enters + STEM.mouth_factor * need + step))
    if len(deep):
        # Two steps on, a depth read between samples is no longer below the exact one.
        start = begin + min(float(along[deep[0]]) + 2.0 * step, length) * way
        if tissue.grid.capsule_inside(start[None], end[None], np.array([radius]), wall_mm)[0]:
            return
    within = along >= (along[deep[0]] if len(deep) else min(enters + need, length))
    least = int(np.argmin(np.where(within, depth, np.inf)))
    raise TrunkWallError(
        f"trunk of {2 * radius:.3g} mm from the root at {_say(begin)} mm along {_say(way)}: its "
        f"wall is {depth[least] - radius:.2g} mm thick at {_say(begin + along[least] * way)} mm, "
        f"and clearance_mm asks for {wall_mm:.3g} mm; enter at least {need:.3g} mm away from every "
        "edge (root_mm), or ask for fewer terminals or a smaller smallest_diameter_mm",
        radius,
    )


def rooted_at(options: GrowthOptions, point: FloatArray, way: FloatArray) -> GrowthOptions:
    """Return the options with a root at a point, mm, that enters along a direction."""
    x, y, z = point.tolist()
    dx, dy, dz = way.tolist()
    return replace(
        options,
        root_at_top=False,
        root_candidates=0,
        root_point_mm=(x, y, z),
        root_direction=(dx, dy, dz),
    )


def has_default_root(options: GrowthOptions) -> bool:
    """Whether the root is left to `stem`."""
    named = options.root_at_top or options.root_candidates or options.root_point_mm is not None
    return not named


def default_root_note(begin: FloatArray, end: FloatArray, what: str = "root") -> str:
    """Where a root was put that nobody named."""
    way = np.round((end - begin) / np.linalg.norm(end - begin), 2) + 0.0
    return (
        "{} placed at ({:g}, {:g}, {:g}) mm, pointing along ({:g}, {:g}, {:g}); "
        "set root_mm to enter elsewhere".format(what, *(np.round(begin, 2) + 0.0), *way)
    )


def stem_is_short(segments: Segments, clearances: Clearances) -> bool:
    """Whether the root's segment is shorter than its radius asks for."""
    return bool(segments[0]["length"] < clearances.length_to_radius * segments[0]["radius"])


def lengthen_stem(segments: Segments, clearances: Clearances, law: Law) -> None:
    """Move the root's bifurcation on along the stem; the audit that follows judges it there."""
    s = segments[0]
    begin = np.array([s["px"], s["py"], s["pz"]])
    end = np.array([s["dx"], s["dy"], s["dz"]])
    longer = STEM.lengthening_factor * clearances.length_to_radius * s["radius"] / s["length"]
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


def sole_end(
    tissue: Tissue, begin: FloatArray, ends: FloatArray, middle: FloatArray, depth_mm: float
) -> FloatArray:
    """The one of ``ends`` nearest to the middle that a straight vessel can reach.

    A vessel enters through the surface: twice its depth on it has to lie in the tissue, and once it
    is deep enough it has to stay so up to its end.

    Parameters
    ----------
    tissue : Tissue
    begin : (3,) float64, mm
        The root.
    ends : (n, 3) float64, mm
    middle : (3,) float64, mm
        Of what the terminal has to supply.
    depth_mm : float
        The vessel's radius and its wall.

    Raises
    ------
    RootError
        When none can be reached.
    """
    for end in ends[np.argsort(np.linalg.norm(ends - middle, axis=1), kind="stable")]:
        if _stays_deep(tissue, begin, end, depth_mm):
            return np.asarray(end, dtype=np.float64)
    raise RootError(
        f"no straight vessel of {depth_mm:.3g} mm with its wall leads from the root at "
        + "({:.4g}, {:.4g}, {:.4g}) mm to the one terminal; choose ".format(*begin)
        + "another place of the root, more terminals, a smaller smallest_diameter_mm or "
        "clearance_mm"
    )


def _stays_deep(tissue: Tissue, begin: FloatArray, end: FloatArray, depth_mm: float) -> bool:
    steps = int(np.linalg.norm(end - begin) / (0.25 * tissue.grid.spacing_mm)) + 2
    part = np.linspace(0.0, 1.0, min(steps, STEM.max_steps))
    depth = -tissue.grid.distance(begin + part[:, None] * (end - begin))
    entered = part * np.linalg.norm(end - begin) > 2.0 * depth_mm + tissue.grid.spacing_mm
    deep = depth >= depth_mm
    return bool(deep[-1] and deep[int(np.argmax(deep)) :].all() and (depth[entered] > 0).all())
