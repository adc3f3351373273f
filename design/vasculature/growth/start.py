"""Start a tree: connect its stem to the first two terminals that fit."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.geometry import point_segment
from design.vasculature.growth.bifurcation import distance
from design.vasculature.growth.clearances import Clearances, kept_apart
from design.vasculature.growth.fit import in_tissue
from design.vasculature.growth.joint_limits import angles_fit, shares_fit
from design.vasculature.growth.state import place, refresh
from design.vasculature.growth.target_points import Samples
from design.vasculature.options import Law
from kernels import jit


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
