"""Judge a grown tissue: its parts, the terminals in each, the verdict; no code of the product.

Parts come from how the tissue was made. `welded_volumes` finds them once more from the faces, for
tissues whose parts don't touch and whose file isn't spoilt: a test compares the two.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.supply_bench.solids import FloatArray, IntArray, Solid, volume_of

SHARE_OFF = 0.05
"""Of the whole flow: how far a part's share may be from its share of the volume."""

LOBE_EXPECTS = 6
"""Terminals that a lobe's volume asks for, from which on none is too few."""

_RAYS = np.array([[0.577, 0.214, 0.788], [-0.318, 0.871, 0.374], [0.149, -0.528, 0.836]])


def groups(count: int, faces: IntArray) -> IntArray:
    """Number of the group of each of ``count`` vertices: joined by faces, by union and find."""
    above = list(range(count))

    def find(k: int) -> int:
        while above[k] != k:
            above[k] = above[above[k]]
            k = above[k]
        return k

    for a, b, c in faces.tolist():
        one = find(a)
        above[find(b)] = one
        above[find(c)] = one
    return np.unique([find(k) for k in range(count)], return_inverse=True)[1]


def welded_volumes(solid: Solid) -> list[float]:
    """Volumes of what hangs together once equal vertices are one, mm³, largest first."""
    points, number = np.unique(solid.points.astype(np.float32), axis=0, return_inverse=True)
    faces = number.reshape(-1)[solid.faces]
    group = groups(len(points), faces)[faces[:, 0]]
    own = [Solid(points.astype(np.float64), faces[group == n]) for n in np.unique(group)]
    return sorted(map(volume_of, own), reverse=True)


def inside(solids: tuple[Solid, ...], points: FloatArray) -> NDArray[np.bool_]:
    """Which points lie in any of the solids: most of three rays cross its surface oddly often."""
    found = np.zeros(len(points), dtype=bool)
    for solid in solids:
        corners = solid.points[solid.faces]
        odd = [_crossed(corners, points, ray) % 2 for ray in _RAYS]
        found |= np.sum(odd, axis=0) >= 2
    return found


def _crossed(corners: FloatArray, points: FloatArray, ray: FloatArray) -> IntArray:
    """How many triangles a ray from each point passes (Möller & Trumbore 1997)."""
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(ray, two)
    scale = (one * across).sum(axis=1)
    good = np.abs(scale) > 1e-300
    scale = np.where(good, scale, 1.0)
    count = np.zeros(len(points), dtype=np.int64)
    for k, point in enumerate(points):
        away = point - corners[:, 0]
        u = (away * across).sum(axis=1) / scale
        turned = np.cross(away, one)
        v = turned @ ray / scale
        t = (two * turned).sum(axis=1) / scale
        count[k] = (good & (u >= 0) & (v >= 0) & (u + v <= 1) & (t > 0)).sum()
    return count


def verdict(
    volumes: FloatArray, number: IntArray, flow: FloatArray, lobes: bool, told: str
) -> dict[str, Any]:
    """What becomes of a grown tissue.

    Parameters
    ----------
    volumes : (p,) float64
        True volumes of the parts, or of the lobes of one.
    number : (t,) int64
        Part of each terminal, -1 for none.
    flow : (t,) float64
        Solved by the judge, all inlets at one pressure.
    told : str
        All notes that the user is given.
    """
    want = volumes / volumes.sum()
    has = np.bincount(number[number >= 0], minlength=len(volumes))
    part = np.array([flow[number == n].sum() for n in range(len(volumes))]) / flow.sum()
    least = LOBE_EXPECTS / len(number) if lobes else 0.0
    empty = np.flatnonzero((has == 0) & (want >= least))
    off = np.flatnonzero((np.abs(part - want) > SHARE_OFF) & (not lobes))
    outside = int((number < 0).sum()) if not lobes else 0
    result = "supplied"
    if len(empty) and "mm³ around" not in told:
        result = "silent"
    elif outside:
        result = "outside"
    elif len(off):
        result = "uneven"
    return {
        "result": result,
        "empty": [round(float(volumes[n]), 3) for n in empty],
        "share": part.round(4).tolist(),
        "wanted": want.round(4).tolist(),
        "outside": outside,
    }
