"""Find the direction of a heart's base: across its cavities' rims, where they open, or its lid."""

from __future__ import annotations

from typing import Final

import numpy as np
from scipy.spatial import cKDTree

from design.anatomy.cavities import way_between
from design.anatomy.openness import SurfaceSamples
from design.errors import TissueError
from kernels.arrays import BoolArray, FloatArray

FEWEST: Final = 0.03
"""Share of the surface that isn't outer below which there are no cavities to go by."""
_OPENS: Final = 1e-3
"""Of the rays from a cavity's walls, those that leave where it opens at all."""

_RIM: Final = 2.0
"""Way of a cavity's place from the outer surface within which it lies at the rim, over the way
between places."""
_BESIDE: Final = 12
_OPPOSITE: Final = -0.5
"""Cosine between the normals on both sides of a wall, at most."""
_FEWEST_RIM: Final = 12
_FLAT: Final = 0.2
"""Standard deviation of rims off a plane, over the lesser one in it, up to which they have one."""
_LIKELY: Final = 0.5
"""Cosine between that plane's normal and the direction found without, below which it is no base."""

_ALIKE: Final = 0.99
"""Cosine between normals of one flat side."""
_LID: Final = 0.06
"""Of the outer surface, a flat side that may be a base; a round one has 0.005 within that angle."""
_OTHER: Final = 0.5
"""Of the largest flat side, another one that makes it doubtful which is the base."""
_ELSEWHERE: Final = 0.9
_THICK: Final = 0.1
"""Standard deviation across a flat side over the lesser one along it, at most."""

GIVE: Final = "give base_direction: [x, y, z], from the apex to the base"
_FLAT_SIDE: Final = f"the heart's one flat side was taken for its base; where it isn't, {GIVE}"


def find_base(samples: SurfaceSamples, middle: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Unit vector (3,) from the apex to the base, and notes on what makes it doubtful.

    Across the cavities' rims where these lie in a plane; else the one flat side; else the mean of
    where cavities open, and of apex to middle. A right ventricle that is cut low opens sideways,
    which turned that mean by up to 45 degrees.

    Raises
    ------
    TissueError
        Where cavities are closed and no side, or more than one, is flat.
    """
    inner = ~samples.outer
    hollow = float(inner.mean()) >= FEWEST
    out = samples.way_out[inner].sum(axis=0) if hollow else np.zeros(3)
    if np.linalg.norm(out) < _OPENS * max(1, inner.sum()):
        return _closed_base(samples, middle, hollow)
    outer = samples.points[samples.outer]
    out = _unit(out)
    below = (outer - middle) @ out < 0
    apex = outer[below][np.argmax(np.linalg.norm(outer[below] - middle, axis=1))]
    mean = _unit(out + _unit(middle - apex))
    across = _across_rims(samples, middle, mean)
    along = float(across @ mean)
    if abs(along) >= _LIKELY:
        return np.sign(along) * across, ()
    side = _flat_side(samples)
    if side is not None and side @ mean >= _LIKELY:
        return side, (f"the cavities' rims lie in no plane: {_FLAT_SIDE}",)
    doubt = (
        "the cavities' rims lie in no plane, so that the base is where they open, some 30 degrees "
        f"off at times; where it isn't right, {GIVE}"
    )
    return mean, (doubt,)


def _closed_base(
    samples: SurfaceSamples, middle: FloatArray, hollow: bool
) -> tuple[FloatArray, tuple[str, ...]]:
    """The base of a heart no cavity of which opens: its flat side."""
    side = _flat_side(samples)
    if side is not None:
        return side, (f"no cavity opens: {_FLAT_SIDE}",)
    if hollow:
        raise TissueError(
            "the heart's base can't be told: its cavities are closed, and its surface has no side, "
            f"or several, as flat as a base; {GIVE}"
        )
    outer = samples.points[samples.outer]
    apex = outer[np.argmax(np.linalg.norm(outer - middle, axis=1))]
    return _unit(middle - apex), ()


def _flat_side(samples: SurfaceSamples) -> FloatArray | None:
    """Outward normal (3,) of the outer surface's flat side; None where there isn't just one."""
    points, normal = samples.points[samples.outer], -samples.inward[samples.outer]
    reach = float(np.sqrt(2.0 - 2.0 * _ALIKE))
    alike = cKDTree(normal).query_ball_point(normal, reach, return_length=True)
    best = int(np.argmax(alike))
    elsewhere = normal @ normal[best] < _ELSEWHERE
    if alike[best] < _LID * len(points):
        return None
    if elsewhere.any() and alike[elsewhere].max() > _OTHER * alike[best]:
        return None
    side = normal @ normal[best] > _ALIKE
    off = points[side] - np.median(points[side], axis=0)
    spread = np.linalg.eigvalsh(off.T @ off)
    return _unit(normal[side].mean(axis=0)) if spread[0] < _THICK**2 * spread[1] else None


def _across_rims(samples: SurfaceSamples, middle: FloatArray, up: FloatArray) -> FloatArray:
    """Unit normal of the plane in which the cavities' rims lie, 0 where they don't lie in one.

    Clefts below the middle, as between two apices, are no rims of theirs.
    """
    none = np.zeros(3)
    inner = samples.points[~samples.outer]
    rim = inner[_at_outer(samples) & ((inner - middle) @ up > 0.0)]
    if len(rim) < _FEWEST_RIM:
        return none
    off = rim - rim.mean(axis=0)
    spread, axes = np.linalg.eigh(off.T @ off)
    return axes[:, 0] if spread[0] < _FLAT**2 * spread[1] else none


def _at_outer(samples: SurfaceSamples) -> BoolArray:
    """Which places (k,) in cavities have an outer one near; not those beyond a thin wall."""
    inner = ~samples.outer
    reach = _RIM * way_between(samples.points)
    index = cKDTree(samples.points[samples.outer])
    away, near = index.query(samples.points[inner], _BESIDE, distance_upper_bound=reach)
    outwards = np.append(samples.inward[samples.outer], np.zeros((1, 3)), axis=0)[near]
    cosine = np.einsum("nkx,nx->nk", outwards, samples.inward[inner])
    return np.asarray(((away < reach) & (cosine > _OPPOSITE)).any(axis=1))


def _unit(vector: FloatArray) -> FloatArray:
    unit: FloatArray = np.asarray(vector, dtype=np.float64) / np.linalg.norm(vector)
    return unit
