"""Start a tree: connect its stem to the first two terminals that fit."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.errors import RootError
from design.geometry import point_segment
from design.tissue import Tissue
from design.vasculature.growth.cost import place, refresh
from design.vasculature.growth.fit import angles_fit, distance, in_tissue, shares_fit
from design.vasculature.growth.index import Clearances, kept_apart
from design.vasculature.growth.points import Samples
from design.vasculature.options import Law
from kernels import jit
from kernels.arrays import FloatArray


@jit
def first_pair(
    segments: Any, room: Clearances, law: Law, root_radius: float, samples: Samples, least: float
) -> bool:
    """Grow the stem's two first terminals from two of the samples; False when none fit.

    Each is at least ``least`` away from the stem and from the other one's segment.
    """
    s, points, flow = segments[0], samples.at, samples.flow
    e = (s.dx, s.dy, s.dz)
    one = -1
    for n in range(len(points)):
        t = points[n]
        length = distance(e[0], e[1], e[2], t[0], t[1], t[2])
        if length < least:
            continue
        if one < 0:
            radius = root_radius * 0.5 ** (1.0 / law.gamma)
            if _stands(room, s, t, radius, root_radius):
                one = n
            continue
        other = points[one]
        m = distance(e[0], e[1], e[2], other[0], other[1], other[2])
        a, b = np.sqrt(np.sqrt(flow[n] * length)), np.sqrt(np.sqrt(flow[one] * m))
        total = (a**law.gamma + b**law.gamma) ** (1.0 / law.gamma)
        r0, r1 = root_radius * b / total, root_radius * a / total
        if not (_stands(room, s, t, r1, root_radius) and _stands(room, s, other, r0, root_radius)):
            continue
        gap = r0 + r1 + kept_apart(room, r0, r1) + 0.25 * least
        if _ends_apart(e, t, other) < gap:
            continue
        if room.limits.on and not (
            angles_fit(room.limits, (s.px, s.py, s.pz), e, other, t)
            and shares_fit(room.limits, flow[one], flow[n])
        ):
            continue
        for i in range(1, 3):
            place(segments, i, e, (other[0], other[1], other[2]) if i == 1 else (t[0], t[1], t[2]))
            segments[i].parent = 0
            segments[i].left, segments[i].right = -1, -1
            segments[i].full = 0
            segments[i].flow = flow[one] if i == 1 else flow[n]
            refresh(segments, i, law)
        segments[0].left, segments[0].right = 1, 2
        refresh(segments, 0, law)
        return True
    return False


@jit
def _stands(room: Clearances, stem: Any, t: Any, radius: float, root_radius: float) -> bool:
    """Whether a vessel from the stem's end to ``t`` is in the tissue and leaves the stem."""
    gap = radius + root_radius + kept_apart(room, radius, root_radius)
    away, _ = point_segment(t[0], t[1], t[2], stem.px, stem.py, stem.pz, stem.dx, stem.dy, stem.dz)
    return bool(
        away >= gap and in_tissue(room, stem.dx, stem.dy, stem.dz, t[0], t[1], t[2], radius)
    )


@jit
def _ends_apart(e: tuple[float, float, float], t: Any, other: Any) -> float:
    """Least distance of either end from the other one's segment."""
    one, _ = point_segment(t[0], t[1], t[2], e[0], e[1], e[2], other[0], other[1], other[2])
    two, _ = point_segment(other[0], other[1], other[2], e[0], e[1], e[2], t[0], t[1], t[2])
    return min(one, two)


# Find where the straight vessel of a tree with one terminal ends.

_LONGEST = 1000
"""Steps along each straight that is tried."""


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
        + "another place of the root, more terminals, a smaller smallest radius or clearance"
    )


def _stays_deep(tissue: Tissue, begin: FloatArray, end: FloatArray, depth_mm: float) -> bool:
    steps = int(np.linalg.norm(end - begin) / (0.25 * tissue.grid.spacing_mm)) + 2
    part = np.linspace(0.0, 1.0, min(steps, _LONGEST))
    depth = -tissue.grid.distance(begin + part[:, None] * (end - begin))
    entered = part * np.linalg.norm(end - begin) > 2.0 * depth_mm + tissue.grid.spacing_mm
    deep = depth >= depth_mm
    return bool(deep[-1] and deep[int(np.argmax(deep)) :].all() and (depth[entered] > 0).all())
