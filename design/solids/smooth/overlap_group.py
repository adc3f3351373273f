"""Unite overlapping junctions and crossing vessels exactly by manifold3d."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from design.errors import SolidError
from design.geometry.segments import close_pairs
from design.solids.manifolds import to_manifold, unite
from design.solids.smooth.fillet import wall_rows
from design.solids.smooth.layout import Layout, first_piece
from design.solids.smooth.round_seams import Rounding
from design.solids.tube import EndShape, Facets, area_factor, facet_count, inscribed_factor
from kernels.arrays import FloatArray, IntArray

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


# Collect the walls and fixed end rings of a group of overlapping vessels, to be rounded.

_BEYOND_RING = 4.0
"""Radii of the plain tube beyond a group's ring that the ball can touch."""


def crowd_rounding(
    layout: Layout,
    joints: list[int],
    runs: list[int],
    shapes: list[tuple[EndShape, EndShape]],
    tolerance_mm: float,
) -> Rounding:
    """Walls and fixed ends of a group of ``joints`` and absorbed ``runs``."""
    pieces: list[tuple[FloatArray, FloatArray, float, float, float]] = []
    ends: list[FloatArray] = []
    for run in runs:
        pieces += list(_pieces(layout, run))
        for end in (0, 1):
            if shapes[run][end] == "flat" and (run, end) not in layout.joint_of():
                start, axis, _, radius, _ = first_piece(layout.runs[run], end)
                ends.append(np.array([*start, *axis, 1.05 * radius]))
    for joint in joints:
        for run, end in layout.ends[joint]:
            if layout.swallowed[run]:
                continue
            start, axis, length, radius, slope = first_piece(layout.runs[run], end)
            reach, wide = layout.reach[run, end], area_factor(layout.facets[run])
            goes_on = min(length, reach + _BEYOND_RING * radius)
            pieces.append((start, axis, goes_on, wide * radius, wide * slope))
            at_ring = 1.05 * (radius + slope * reach)
            ends.append(np.array([*(start + reach * axis), *axis, at_ring]))
    columns = [np.array(column) for column in zip(*pieces, strict=True)]
    lengths, radii, slopes = columns[2:]
    thinnest = np.minimum(radii, radii + slopes * lengths)
    asked = layout.fillet_mm
    rho = layout.fillet_ratio * thinnest if asked is None else np.full(len(radii), asked)
    rows = wall_rows(columns[0], columns[1], lengths, radii, slopes)
    return Rounding(rows, rho, np.reshape(np.array(ends), (-1, 7)), tolerance_mm)


def _pieces(
    layout: Layout, run: int
) -> Iterator[tuple[FloatArray, FloatArray, float, float, float]]:
    """Start, axis, length, radius and slope of each piece of a swallowed run."""
    chain, wide = layout.runs[run], area_factor(layout.facets[run])
    step = np.diff(chain.points, axis=0)
    for k, length in enumerate(np.linalg.norm(step, axis=1).tolist()):
        radius, slope = wide * chain.radius[k], wide * (chain.radius[k + 1] - chain.radius[k])
        yield chain.points[k], step[k] / length, length, float(radius), float(slope / length)


# Find vessel runs whose walls overlap without a common junction.

_CLEARANCE = 0.03
"""Of the thinner radius: a polygon's corners stand that far over its circle."""
_BEND = 2.5
"""Pieces of one run no farther apart along it than this many times both radii are one bend."""


def overlapping_runs(layout: Layout) -> IntArray:
    """Pairs of runs (k, 2) whose walls overlap away from a common junction.

    A run paired with itself winds into itself.
    """
    starts, ends, radii, nodes, run_of, along = _wall_pieces(layout)
    pairs, _, _ = close_pairs(starts, ends, radii, nodes, 0.0, _CLEARANCE)
    if len(pairs) == 0:
        return np.empty((0, 2), dtype=np.int64)
    both = radii[pairs].sum(axis=1)
    one, two = run_of[pairs].T
    length = np.linalg.norm(ends - starts, axis=1)
    near = np.abs(along[pairs[:, 0]] - along[pairs[:, 1]]) - length[pairs].sum(axis=1) / 2
    bend = (one == two) & (near <= _BEND * both)
    return np.unique(np.stack([one, two], axis=1)[~bend], axis=0)


def _wall_pieces(layout: Layout) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Start, end, radius, end nodes, run and place along it (of the middle) of all pieces."""
    joint_of = layout.joint_of()
    starts, ends, radii, nodes, run_of, along = [], [], [], [], [], []
    free = len(layout.ends)
    for index, run in enumerate(layout.runs):
        count = len(run.points)
        own = free + np.arange(count)
        free += count
        for end in (0, 1):
            own[-end] = joint_of.get((index, end), own[-end])
        starts.append(run.points[:-1])
        ends.append(run.points[1:])
        radii.append(np.maximum(run.radius[:-1], run.radius[1:]))
        nodes.append(np.stack([own[:-1], own[1:]], axis=1))
        run_of.append(np.full(count - 1, index))
        step = np.linalg.norm(np.diff(run.points, axis=0), axis=1)
        along.append(np.cumsum(step) - 0.5 * step)
    arrays = [np.concatenate(x) for x in (starts, ends, radii, nodes, run_of, along)]
    return arrays[0], arrays[1], arrays[2], arrays[3], arrays[4], arrays[5]
