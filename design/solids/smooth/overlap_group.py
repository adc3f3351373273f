"""Unite overlapping junctions and crossing vessels exactly by manifold3d."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.errors import SolidError
from design.solids.facets import Facets, facet_count, inscribed_factor
from design.solids.manifolds import to_manifold, unite
from kernels.arrays import FloatArray

FaceArray = NDArray[np.int64]

CLEAR_OF_TUBES = 0.999
"""Balls stay this factor inside the tubes' facets, so that the union has no slivers."""

COARSER_BALLS = 4.0
"""Balls show only in the outer corner of a bend: half the tubes' facets make half the time."""

_SAME_PLACE = 1e-9
"""A ring's vertex is found again within this share of the ring's size."""


class LostRingError(SolidError):
    """A ring at which a group should open isn't on its surface; caught where groups are made."""


def ball(centre: FloatArray, radius: float, facets_of: Facets, finer: float = 1.0) -> Manifold:
    """A ball that fills the outer corner between tubes of ``radius``; ``finer`` than by default."""
    tolerance_mm = facets_of.at(radius) / finer
    sides = facets_of.count(radius) if finer == 1.0 else facet_count(radius, tolerance_mm)
    inscribed = inscribed_factor(sides) * CLEAR_OF_TUBES
    facets = facet_count(radius, COARSER_BALLS * tolerance_mm)
    return Manifold.sphere(radius * inscribed, facets).translate(centre.tolist())


def connecting_tube(centre: FloatArray, near: float, ring: FloatArray, reach: float) -> Manifold:
    """A tube from a junction's ``centre``, as wide as ``near``, to the first ring of a plain one.

    Parameters
    ----------
    centre : (3,) float64, mm
    near : float
        The tube's radius at ``centre`` over that at the ring.
    ring : (n, 3) float64, mm
        Counter-clockwise as seen against the way outwards.
    reach : float, mm
        From ``centre`` to the ring's middle.
    """
    middle = ring.mean(axis=0)
    first = centre + near * (ring - middle)
    count = len(ring)
    here = np.arange(count)
    following = (here + 1) % count
    a, b, c, d = here, following, here + count, following + count
    inner, outer = np.full(count, 2 * count), np.full(count, 2 * count + 1)
    faces = np.concatenate(
        [
            np.stack([a, b, d], -1),
            np.stack([a, d, c], -1),
            np.stack([b, a, inner], -1),
            np.stack([c, d, outer], -1),
        ]
    )
    axis = middle - centre
    turn = np.cross(ring[0] - middle, ring[1] - middle) @ axis
    vertices = np.concatenate([first, ring, [centre], [middle]])
    return to_manifold(vertices, faces if turn > 0.0 else faces[:, ::-1], f"a stub of {reach:g} mm")


def unite_parts(
    parts: Sequence[Manifold],
    rings: Sequence[FloatArray],
    crumb_mm: float,
    simpler_mm: float = 0.0,
) -> tuple[FloatArray, FaceArray, list[NDArray[np.int64]]]:
    """Union of ``parts``, opened at ``rings`` that are faces of it.

    Parameters
    ----------
    parts : sequence of Manifold
    rings : sequence of (k, 3) float64, mm
    crumb_mm : float, mm
        Closed surfaces as small as a cube of this side are dropped: where facets of several
        vessels nearly coincide, slits stay between them.
    simpler_mm : float, mm
        Slivers thinner than this are taken away; 0 leaves them.

    Returns
    -------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int64
    where : list of (k,) int64
        The vertices of each ring.

    Raises
    ------
    LostRingError
        When a ring isn't on the union's surface.
    """
    whole = unite(parts)
    mesh = (whole.simplify(simpler_mm) if simpler_mm else whole).to_mesh64()
    vertices = mesh.vert_properties[:, :3]
    faces = _without_crumbs(vertices, mesh.tri_verts.astype(np.int64), crumb_mm)
    if not rings:
        return vertices, faces, []
    tree = cKDTree(vertices)
    where = []
    for ring in rings:
        middle = ring.mean(axis=0)
        size = float(np.linalg.norm(ring[0] - middle))
        gap, index = tree.query(ring)
        if gap.max() > _SAME_PLACE * max(size, 1.0) or len(np.unique(index)) < len(ring):
            raise LostRingError("a vessel's end isn't on the union of a group of junctions")
        own = np.zeros(len(vertices), dtype=bool)
        own[index] = True
        at_middle, centre = tree.query(middle)
        if at_middle <= _SAME_PLACE * max(size, 1.0):
            own[centre] = True
        faces = faces[~own[faces].all(axis=1)]
        where.append(index.astype(np.int64))
    return vertices, faces, where


def _without_crumbs(vertices: FloatArray, faces: FaceArray, crumb_mm: float) -> FaceArray:
    tail = faces[:, [0, 1]].ravel()
    head = faces[:, [1, 2]].ravel()
    joined = coo_array((np.ones(len(tail), np.int8), (tail, head)), shape=2 * (len(vertices),))
    shell = connected_components(joined, directed=False)[1][faces[:, 0]]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.bincount(shell, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)
    return faces[np.abs(volume[shell]) > crumb_mm**3]
