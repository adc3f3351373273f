"""Find a heart's base, right side, cavities, grooves and epicardium from surface samples."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull, cKDTree

from design.anatomy.openness import SurfaceSamples
from design.errors import TissueError
from kernels.arrays import BoolArray, FloatArray, IntArray


class _Shape(NamedTuple):
    """Shares, cosines and ratios by which a heart's directions are found in its shape."""

    # Epicardium, wall and grooves.
    basal: float = 0.5  # cosine of outward normal and base's direction above which a place is base
    sectors: int = 36  # of a turn about the base's direction
    agree: float = 0.7  # cosine of two directions of the right side above which they agree
    uneven: float = 0.1  # deviation of the wall's thickness over its mean that tells a side
    # Rims of the cavities.
    opens: float = 1e-3  # share of a cavity's rays that leave where it opens at all
    rim: float = 2.0  # distance from the outer surface over that between places, at a rim
    beside: int = 12  # outer places among which a rim's place has one near
    opposite: float = -0.5  # cosine between the normals on both sides of a wall, at most
    least_rim: int = 12  # places of a rim
    plane: float = 0.2  # deviation of rims off a plane over the lesser one in it
    likely: float = 0.5  # cosine of that plane's normal to the way out, at least
    # The base as the one flat side.
    alike: float = 0.99  # cosine between normals of one flat side
    lid: float = 0.06  # share of the outer surface; a round one has 0.005 within that angle
    other: float = 0.5  # size of another flat side, over the largest, that makes it doubtful
    elsewhere: float = 0.9  # cosine below which a normal belongs to another side
    flat: float = 0.1  # deviation across a flat side over the lesser one along it
    # Two cavities.
    links: int = 8  # neighbours of a place
    longest: float = 5.0  # link over the distance between places
    through: float = 0.5  # cosine of a link to the normal above which it leads through the wall
    least_cavity: float = 0.1  # places in the smaller cavity, of all in cavities
    hull: int = 1000  # places by which a cavity's convex hull is judged
    # Mean depth in the hull over the cube root of its volume, above which another body bulges in.
    # The septum makes it 0.028 to 0.071 in the right ventricle of 38 hearts, two of them real; the
    # left one has 0.016 at most, 0.023 with an aneurysm.
    hollow: float = 0.015
    clear: float = 0.25  # difference of the two depths over their sum that tells them apart


SHAPE = _Shape()
FEWEST: Final = 0.03
"""Share of the surface that isn't outer below which there are no cavities to go by."""
GIVE: Final = "give base_direction: [x, y, z], from the apex to the base"
_FLAT_SIDE: Final = f"the heart's one flat side was taken for its base; where it isn't, {GIVE}"
_BY_SHAPE = (
    "the right ventricle was told by its cavity's shape, a crescent about the left one's, as the "
    "wall isn't thinner on that side; where it isn't the right one, give right_direction: "
    "[x, y, z], from the left ventricle to the right one"
)
_UNKNOWN = (
    "the left ventricle can't be told from the right one, neither by the wall's thickness nor by "
    "the cavities' shapes, so that the right side may be the left one; give right_direction: "
    "[x, y, z], from the left ventricle to the right one"
)


@dataclass(frozen=True)
class HeartPlaces:
    """Directions (unit vectors) and places of a heart."""

    middle: FloatArray  # (3,), mm, of the ventricles' cavities
    base: FloatArray  # from the apex to the base
    right: FloatArray  # across it, towards the right ventricle
    anterior: FloatArray  # across both
    # Angles of the anterior and posterior interventricular grooves from ``right`` towards
    # ``anterior``, rad: between 0 and π, and between -π and 0.
    grooves: tuple[float, float]
    epicardium: IntArray  # numbers of the surface samples that are epicardium
    doubts: tuple[str, ...] = ()  # notes on directions that are guessed, with the remedy

    def height(self, points: FloatArray) -> FloatArray:
        """Return along the base's direction from the middle, mm."""
        height: FloatArray = (points - self.middle) @ self.base
        return height

    def angle(self, points: FloatArray) -> FloatArray:
        """Return about the base's direction, from ``right`` towards ``anterior``, rad."""
        along = points - self.middle
        angle: FloatArray = np.arctan2(along @ self.anterior, along @ self.right)
        return angle


def find_heart_places(
    samples: SurfaceSamples,
    base: FloatArray | None = None,
    right: FloatArray | None = None,
) -> HeartPlaces:
    """Find base, right side and grooves; a direction that is given is taken.

    For base and right side see `find_base` and `_right_side`. The grooves are where the wall's
    thickness changes, a third of a turn from the right side at most, or 60 degrees where nothing
    tells.

    Raises
    ------
    TissueError
        Where base and right side are one direction, or the base can't be told.
    """
    outer = samples.outer
    hollow = bool((~outer).mean() >= FEWEST)
    middle = (samples.points[~outer] if hollow else samples.points).mean(axis=0)
    up, doubt = (_unit(base), ()) if base is not None else find_base(samples, middle)
    normal = -samples.inward
    epicardium = np.flatnonzero(outer & (normal @ up < SHAPE.basal))
    wall = _wall(samples, epicardium)
    points = samples.points[epicardium] - middle
    thin, cavities = _thin_side(points, up, wall), find_cavities(samples)
    if right is None:
        right, doubts = _right_side(samples, up, thin, cavities)
        right = _widest_across(points, up) if right is None else right
        doubt = (*doubt, *doubts) if hollow else doubt
    across = right - (right @ up) * up
    if np.linalg.norm(across) < 1e-3 * np.linalg.norm(right):
        raise TissueError(
            f"the heart's right side, {np.round(right, 3).tolist()}, lies in the direction of its "
            "base; give a right_direction across base_direction"
        )
    side = _unit(across)
    front = np.cross(up, side)
    places = HeartPlaces(middle, up, side, front, (np.pi / 3, -np.pi / 3), epicardium)
    angle = places.angle(samples.points[epicardium])
    if cavities is not None and not (thin is not None and thin @ side > SHAPE.agree):
        wall = _is_left(samples, places, cavities)
    return replace(places, grooves=_grooves(angle, wall), doubts=doubt)


def _thin_side(points: FloatArray, up: FloatArray, wall: FloatArray) -> FloatArray | None:
    """Return the unit vector (3,) across ``up`` to the thinner wall; None where it is even."""
    across = points - np.outer(points @ up, up)
    thin = (across * (wall.mean() - wall)[:, None]).sum(axis=0)
    return _unit(thin) if wall.std() > SHAPE.uneven * wall.mean() else None


def _is_left(samples: SurfaceSamples, places: HeartPlaces, cavities: Cavities) -> FloatArray:
    """Return 1 for each epicardial place nearer to the left cavity than to the right one."""
    points = samples.points[places.epicardium]
    one, two = samples.points[cavities.one], samples.points[cavities.two]
    if (two.mean(axis=0) - one.mean(axis=0)) @ places.right < 0.0:
        one, two = two, one
    nearer = cKDTree(one).query(points)[0] < cKDTree(two).query(points)[0]
    return np.asarray(nearer, dtype=np.float64)


def _right_side(
    samples: SurfaceSamples,
    up: FloatArray,
    thin: FloatArray | None,
    cavities: Cavities | None,
) -> tuple[FloatArray | None, tuple[str, ...]]:
    """Return the right ventricle's direction (3,), if it is found, and notes on doubts.

    Where the wall is thinner; from the left cavity to the right one where that is another side, or
    the wall is as thick everywhere.
    """
    if cavities is None:
        return thin, () if thin is not None else (_UNKNOWN,)
    apart = samples.points[cavities.two].mean(axis=0) - samples.points[cavities.one].mean(axis=0)
    apart = _unit(apart - (apart @ up) * up)
    along = 0.0 if thin is None else float(thin @ apart)
    if abs(along) > SHAPE.agree and (along > 0.0 or not cavities.known):
        return thin, ()
    if cavities.known:
        return apart, (_BY_SHAPE,)
    reach = [(samples.points[each] @ up).min() for each in (cavities.one, cavities.two)]
    return apart if reach[0] <= reach[1] else -apart, (_UNKNOWN,)


def _wall(samples: SurfaceSamples, epicardium: IntArray) -> FloatArray:
    """Return thickness of the wall below each epicardial sample, mm; even over its surroundings."""
    inner = samples.points[~samples.outer]
    points = samples.points[epicardium]
    if len(inner) < FEWEST * len(samples.points):
        return np.ones(len(points))
    thick = cKDTree(inner).query(points)[0]
    near = cKDTree(points).query(points, min(40, len(points)))[1]
    even: FloatArray = thick[near].mean(axis=1)
    return even


def _grooves(angle: FloatArray, wall: FloatArray) -> tuple[float, float]:
    """Return angles on either side of 0 at which the wall becomes thick."""
    sector = (
        np.floor((angle + np.pi) / (2 * np.pi) * SHAPE.sectors).astype(np.int64) % SHAPE.sectors
    )
    count = np.bincount(sector, minlength=SHAPE.sectors)
    mean = np.bincount(sector, wall, minlength=SHAPE.sectors) / np.maximum(count, 1)
    mean[count == 0] = wall.mean()
    middle = 0.5 * (np.percentile(mean, 10) + np.percentile(mean, 90))
    angles = []
    for side in (1, -1):
        steps = [
            (SHAPE.sectors // 2 + side * n - (side < 0)) % SHAPE.sectors
            for n in range(SHAPE.sectors // 3)
        ]
        thick = [n for n in range(2, len(steps)) if mean[steps[n]] > middle]
        clear = np.ptp(mean) > 0.25 * wall.mean()
        widest = thick[0] if thick else len(steps)
        angles.append(side * (2 * np.pi / SHAPE.sectors * widest if clear else np.pi / 3))
    return angles[0], angles[1]


def _widest_across(points: FloatArray, axis: FloatArray) -> FloatArray:
    """Return the direction across an axis in which points reach furthest."""
    across = points - np.outer(points @ axis, axis)
    _, vectors = np.linalg.eigh(across.T @ across)
    widest = vectors[:, -1]
    # The sign by the largest component, so that the same shape gives the same direction.
    return np.asarray(widest * np.sign(widest[np.argmax(np.abs(widest))]), dtype=np.float64)


def _unit(vector: FloatArray) -> FloatArray:
    unit: FloatArray = np.asarray(vector, dtype=np.float64) / np.linalg.norm(vector)
    return unit


def find_base(samples: SurfaceSamples, middle: FloatArray) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the unit vector (3,) from the apex to the base, and notes on what makes it doubtful.

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
    if np.linalg.norm(out) < SHAPE.opens * max(1, inner.sum()):
        return _closed_base(samples, middle, hollow)
    outer = samples.points[samples.outer]
    out = _unit(out)
    below = (outer - middle) @ out < 0
    apex = outer[below][np.argmax(np.linalg.norm(outer[below] - middle, axis=1))]
    mean = _unit(out + _unit(middle - apex))
    across = _across_rims(samples, middle, mean)
    along = float(across @ mean)
    if abs(along) >= SHAPE.likely:
        return np.sign(along) * across, ()
    side = _flat_side(samples)
    if side is not None and side @ mean >= SHAPE.likely:
        return side, (f"the cavities' rims lie in no plane: {_FLAT_SIDE}",)
    doubt = (
        "the cavities' rims lie in no plane, so that the base is where they open, some 30 degrees "
        f"off at times; where it isn't right, {GIVE}"
    )
    return mean, (doubt,)


def _closed_base(
    samples: SurfaceSamples, middle: FloatArray, hollow: bool
) -> tuple[FloatArray, tuple[str, ...]]:
    """Return the base of a heart no cavity of which opens: its flat side."""
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
    """Return the outward normal (3,) of the one flat side; None where there isn't just one."""
    points, normal = samples.points[samples.outer], -samples.inward[samples.outer]
    reach = float(np.sqrt(2.0 - 2.0 * SHAPE.alike))
    alike = cKDTree(normal).query_ball_point(normal, reach, return_length=True)
    best = int(np.argmax(alike))
    elsewhere = normal @ normal[best] < SHAPE.elsewhere
    if alike[best] < SHAPE.lid * len(points):
        return None
    if elsewhere.any() and alike[elsewhere].max() > SHAPE.other * alike[best]:
        return None
    side = normal @ normal[best] > SHAPE.alike
    off = points[side] - np.median(points[side], axis=0)
    spread = np.linalg.eigvalsh(off.T @ off)
    return _unit(normal[side].mean(axis=0)) if spread[0] < SHAPE.flat**2 * spread[1] else None


def _across_rims(samples: SurfaceSamples, middle: FloatArray, up: FloatArray) -> FloatArray:
    """Return the unit normal of the plane of the cavities' rims, 0 where they lie in none.

    Clefts below the middle, as between two apices, are no rims of theirs.
    """
    none = np.zeros(3)
    inner = samples.points[~samples.outer]
    rim = inner[_at_outer(samples) & ((inner - middle) @ up > 0.0)]
    if len(rim) < SHAPE.least_rim:
        return none
    off = rim - rim.mean(axis=0)
    spread, axes = np.linalg.eigh(off.T @ off)
    return axes[:, 0] if spread[0] < SHAPE.plane**2 * spread[1] else none


def _at_outer(samples: SurfaceSamples) -> BoolArray:
    """Return which places (k,) in cavities have an outer one near; not those beyond a thin wall."""
    inner = ~samples.outer
    reach = SHAPE.rim * way_between(samples.points)
    index = cKDTree(samples.points[samples.outer])
    away, near = index.query(samples.points[inner], SHAPE.beside, distance_upper_bound=reach)
    outwards = np.append(samples.inward[samples.outer], np.zeros((1, 3)), axis=0)[near]
    cosine = np.einsum("nkx,nx->nk", outwards, samples.inward[inner])
    return np.asarray(((away < reach) & (cosine > SHAPE.opposite)).any(axis=1))


@dataclass(frozen=True)
class Cavities:
    """Surface samples in the two cavities of a heart."""

    one: IntArray  # where ``known``, in the left ventricle
    two: IntArray
    known: bool  # whether their shapes tell which is which: the septum bulges into the right one


def find_cavities(samples: SurfaceSamples) -> Cavities | None:
    """Return the two largest cavities; None where there is one, or none."""
    inner = np.flatnonzero(~samples.outer)
    if len(inner) <= SHAPE.links:
        return None
    part = _parts(samples.points[inner], samples.inward[inner], way_between(samples.points))
    order = np.argsort(-np.bincount(part), kind="stable")
    if len(order) < 2:
        return None
    one, two = (inner[part == number] for number in order[:2])
    if len(two) < max(SHAPE.least_cavity * len(inner), 2 * SHAPE.links):
        return None
    hollow_one, hollow_two = _hollowness(samples.points[one]), _hollowness(samples.points[two])
    if hollow_one > hollow_two:
        one, two, hollow_one, hollow_two = two, one, hollow_two, hollow_one
    known = hollow_two > SHAPE.hollow and hollow_two - hollow_one > SHAPE.clear * (
        hollow_one + hollow_two
    )
    return Cavities(one, two, bool(known))


def way_between(points: FloatArray) -> float:
    """Return the median way from each place (n, 3) to the nearest other one, mm."""
    return float(np.median(cKDTree(points).query(points, 2)[0][:, 1]))


def _parts(points: FloatArray, inward: FloatArray, between: float) -> NDArray[np.int32]:
    """Return the number of the part (n,) of each place; links through the wall join none."""
    away, near = cKDTree(points).query(points, SHAPE.links + 1)
    a, b, length = np.repeat(np.arange(len(points)), SHAPE.links), near[:, 1:].ravel(), away[:, 1:]
    length = np.maximum(length.ravel(), 1e-12)
    way = (points[b] - points[a]) / length[:, None]
    through = np.einsum("nx,nx->n", way, inward[a]) > SHAPE.through
    through |= np.einsum("nx,nx->n", way, inward[b]) < -SHAPE.through
    kept = (length < SHAPE.longest * between) & ~through
    links = coo_matrix((np.ones(kept.sum()), (a[kept], b[kept])), shape=(len(points),) * 2)
    part: NDArray[np.int32] = connected_components(links, directed=False)[1]
    return part


def _hollowness(points: FloatArray) -> float:
    """Return the mean depth of places (n, 3) in their hull, over the cube root of its volume."""
    some = points[:: max(1, len(points) // SHAPE.hull)]
    hull = ConvexHull(some)
    depth = -np.max(some @ hull.equations[:, :3].T + hull.equations[:, 3], axis=1)
    return float(depth.mean() / np.cbrt(hull.volume))
