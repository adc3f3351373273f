"""Sew meshes of tubes, single junctions and overlapping junctions to one closed surface."""

from __future__ import annotations

from collections import defaultdict
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
from design.solids.smooth.layout import Layout, absorb_runs, first_piece, keep_clear_of_balls
from design.solids.smooth.round_seams import Rounding, round_seams
from design.solids.smooth.sewing import LIMITS, FaceArray, Sewing, add_plain_tubes
from design.solids.smooth.star import star_mesh
from design.solids.topology import pair_half_edges, vertex_parts
from design.solids.tube import (
    EndShape,
    Facets,
    area_factor,
    facet_count,
    inscribed_factor,
    tube_mesh,
)
from kernels.arrays import FloatArray, IntArray


def sew_parts(layout: Layout, shapes: list[tuple[EndShape, EndShape]]) -> Sewing:
    """Make all parts, whose free ends have ``shapes``, and sew them to one closed surface."""
    overlaps = overlapping_runs(layout)
    absorb_runs(layout, np.unique(overlaps).tolist())
    for _ in range(LIMITS.tries):
        sewing, torn = _sewn(layout, shapes, overlaps)
        if not torn:
            open_at = _open_places(sewing)
            if not len(open_at):
                return sewing
            torn = _plain_runs_around(layout, open_at)
        # Vessels lie in one another's end planes there: take in those around as well.
        absorb_runs(layout, torn or range(len(layout.runs)))
    absorb_runs(layout, range(len(layout.runs)))
    return _sewn(layout, shapes, overlaps)[0]


def _open_places(sewing: Sewing) -> FloatArray:
    """Corners (k, 3), mm, at which the surface isn't closed."""
    vertices, faces = sewing.surface()
    rim = np.flatnonzero(pair_half_edges(faces) < 0)
    return np.asarray(vertices[faces[rim // 3, rim % 3]])


def _plain_runs_around(layout: Layout, places: FloatArray) -> list[int]:
    """Plain runs that end in the group's junction nearest to each of ``places`` (k, 3)."""
    plain = {
        joint: [run for run, _ in ends if not layout.swallowed[run]]
        for joint, ends in enumerate(layout.ends)
        if layout.crowded(joint)
    }
    joints = [joint for joint, runs in plain.items() if runs]
    if not joints:
        return []
    centres = np.array([layout.walls[joint][0, :3] for joint in joints])
    near = np.unique(cKDTree(centres).query(places)[1]).tolist()
    return sorted({run for index in near for run in plain[joints[index]]})


def _sewn(
    layout: Layout,
    shapes: list[tuple[EndShape, EndShape]],
    overlaps: NDArray[np.int64],
) -> tuple[Sewing, list[int]]:
    """Sew all parts; also return the runs around groups that couldn't be parted from the rest."""
    keep_clear_of_balls(layout)
    sewing = Sewing()
    torn: list[int] = []
    add_plain_tubes(layout, shapes, sewing)
    failed = [
        joint
        for joint in range(len(layout.ends))
        if not layout.crowded(joint) and not _lone(layout, joint, sewing)
    ]
    if failed:
        layout.forced.update(failed)
        return _sewn(layout, shapes, overlaps)
    for joints, runs in _crowds(layout, overlaps):
        try:
            _crowd(layout, joints, runs, overlaps, shapes, sewing)
        except LostRingError:
            torn += [run for joint in joints for run, _ in layout.ends[joint]]
    return sewing, torn


def _lone(layout: Layout, joint: int, sewing: Sewing) -> bool:
    """Sew in a junction that stands alone; False where it can't be made that way."""
    ends, walls = layout.ends[joint], layout.walls[joint].copy()
    wide = np.array([area_factor(layout.facets[run]) for run, _ in ends])
    walls[:, 7:9] *= wide[:, None]
    walls[:, 9] = 1.0 / np.sqrt(1.0 + walls[:, 8] ** 2)
    thin = float(walls[:, 7].min())
    rings = [sewing.rings[end] for end in ends]
    known = np.concatenate(rings)
    ring_of = np.repeat(np.arange(len(ends)), [len(ring) for ring in rings])
    status, points, faces = star_mesh(
        walls,
        layout.fillet[joint],
        np.array([layout.reach[end] for end in ends]),
        sewing.place(known),
        ring_of,
        layout.facets_of.at(thin),
        LIMITS.junction_edge * thin,
        LIMITS.junction_points,
    )
    if status or not _fits(faces, ring_of, len(known)):
        return False
    fresh = np.full(len(points) - len(known), -1)
    sewing.sew(points, faces, np.concatenate([known, fresh]))
    return True


def _fits(faces: FaceArray, ring_of: NDArray[np.int64], count: int) -> bool:
    """Return whether the rim of ``faces`` is the rings, whose vertices come first."""
    rim = np.flatnonzero(pair_half_edges(faces) < 0)
    if len(rim) != count:
        return False
    begin, end = faces[rim // 3, rim % 3], faces[rim // 3, (rim + 1) % 3]
    if begin.max() >= count or end.max() >= count:
        return False
    step = np.abs(begin - end)
    around = np.bincount(ring_of)[ring_of[begin]] - 1
    return bool(np.all((ring_of[begin] == ring_of[end]) & ((step == 1) | (step == around))))


def _crowds(layout: Layout, overlaps: NDArray[np.int64]) -> list[tuple[list[int], list[int]]]:
    """Return the groups of connected junctions and swallowed runs."""
    joints = len(layout.ends)
    swallowed = [run for run, is_in in enumerate(layout.swallowed) if is_in]
    joined = layout.joint_of()
    pairs = [
        (joints + run, joined[run, k]) for run in swallowed for k in (0, 1) if (run, k) in joined
    ]
    one, two = np.concatenate([np.reshape(pairs, (-1, 2)).astype(np.int64), joints + overlaps]).T
    size = joints + len(layout.runs)
    graph = coo_array((np.ones(len(one), np.int8), (one, two)), shape=(size, size))
    # Labels follow the least number in each part.
    group = connected_components(graph, directed=False)[1].tolist()
    members: dict[int, tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    for joint in range(joints):
        if layout.crowded(joint):
            members[group[joint]][0].append(joint)
    for run in swallowed:
        members[group[joints + run]][1].append(run)
    return [members[key] for key in sorted(members)]


def _crowd(
    layout: Layout,
    joints: list[int],
    runs: list[int],
    overlaps: NDArray[np.int64],
    shapes: list[tuple[EndShape, EndShape]],
    sewing: Sewing,
) -> None:
    """Sew in the union of what is in a group."""
    wanted = layout.fillet_ratio > 0.0 or bool(layout.fillet_mm)
    rounds = wanted and not layout.sharp.intersection(joints)
    # Facets of a ball that is to be rounded must lie as near to it as a tube's.
    finer = LIMITS.coarser_balls if rounds else 1.0
    parts: list[Manifold] = []
    winding = set(overlaps[overlaps[:, 0] == overlaps[:, 1], 0].tolist())
    for index in runs:
        parts += _whole_tube(layout, index, shapes[index], index in winding)
    rings: list[NDArray[np.int64]] = []
    for joint in joints:
        centre = layout.walls[joint][0, :3]
        radius = float(layout.ball[joint])
        parts.append(ball(centre, radius, layout.facets_of, finer))
        for (index, end), wall in zip(layout.ends[joint], layout.walls[joint], strict=True):
            if not layout.swallowed[index]:
                ring, reach = sewing.rings[index, end], layout.reach[index, end]
                near = wall[7] / (wall[7] + wall[8] * reach)
                parts.append(connecting_tube(centre, float(near), sewing.place(ring), reach))
                rings.append(ring)
    thin = _thinnest(layout, joints, runs)
    places = [sewing.place(ring) for ring in rings]
    # What rounding to float32 would flatten is better taken away by the union itself.
    sliver = (
        LIMITS.sliver * thin if rounds else min(LIMITS.sharp_sliver_mm, LIMITS.sharp_sliver * thin)
    )
    vertices, faces, where = unite_parts(parts, places, LIMITS.crumb * thin, sliver)
    known = np.full(len(vertices), -1)
    for ring, index_of in zip(rings, where, strict=True):
        known[index_of] = ring
    if rounds:
        what = crowd_rounding(layout, joints, runs, shapes, layout.facets_of.at(thin))
        vertices, faces = round_seams(vertices, faces, known >= 0, what)
        known = np.concatenate([known, np.full(len(vertices) - len(known), -1)])
    sewing.sew(vertices, faces, known)


def _thinnest(layout: Layout, joints: list[int], runs: list[int]) -> float:
    radii = [float(layout.runs[run].radius.min()) for run in runs]
    return min([*radii, *(float(layout.walls[joint][:, 7].min()) for joint in joints)])


def _whole_tube(
    layout: Layout, index: int, shape: tuple[EndShape, EndShape], winding: bool
) -> list[Manifold]:
    run, facets = layout.runs[index], layout.facets[index]
    if not winding:
        return [to_manifold(*tube_mesh(run.points, run.radius, facets, shape), "a vessel's tube")]
    pairs = zip(range(len(run.points) - 1), range(1, len(run.points)), strict=True)
    return [
        to_manifold(
            *tube_mesh(run.points[[a, b]], run.radius[[a, b]], facets, ("round", "round")),
            "a piece of a vessel's tube",
        )
        for a, b in pairs
    ]


class LostRingError(SolidError):
    """A ring at which a group should open isn't on its surface."""


def ball(centre: FloatArray, radius: float, facets_of: Facets, finer: float = 1.0) -> Manifold:
    """Make a ball that fills the outer corner between tubes, ``finer`` than by default."""
    tolerance_mm = facets_of.at(radius) / finer
    sides = facets_of.count(radius) if finer == 1.0 else facet_count(radius, tolerance_mm)
    inscribed = inscribed_factor(sides) * LIMITS.clear_of_tubes
    facets = facet_count(radius, LIMITS.coarser_balls * tolerance_mm)
    return Manifold.sphere(radius * inscribed, facets).translate(centre.tolist())


def connecting_tube(centre: FloatArray, near: float, ring: FloatArray, reach: float) -> Manifold:
    """Make a tube from a junction's ``centre``, ``near`` times as wide, to a plain tube's ring."""
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
    """Unite ``parts``, and open the union at ``rings`` (k, 3) that are faces of it.

    Closed surfaces as small as a cube of ``crumb_mm``, slits between facets that nearly coincide,
    are dropped, and slivers thinner than ``simpler_mm`` taken away.

    Returns
    -------
    vertices (n, 3), faces (m, 3), and the vertices (k,) of each ring

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
        if gap.max() > LIMITS.same_place * max(size, 1.0) or len(np.unique(index)) < len(ring):
            raise LostRingError("a vessel's end isn't on the union of a group of junctions")
        own = np.zeros(len(vertices), dtype=bool)
        own[index] = True
        at_middle, centre = tree.query(middle)
        if at_middle <= LIMITS.same_place * max(size, 1.0):
            own[centre] = True
        faces = faces[~own[faces].all(axis=1)]
        where.append(index.astype(np.int64))
    return vertices, faces, where


def _without_crumbs(vertices: FloatArray, faces: FaceArray, crumb_mm: float) -> FaceArray:
    shell = vertex_parts(faces, len(vertices))[faces[:, 0]]
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    volume = np.bincount(shell, np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)
    return faces[np.abs(volume[shell]) > crumb_mm**3]


def crowd_rounding(
    layout: Layout,
    joints: list[int],
    runs: list[int],
    shapes: list[tuple[EndShape, EndShape]],
    tolerance_mm: float,
) -> Rounding:
    """Collect walls and fixed ends of a group of ``joints`` and absorbed ``runs``."""
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
            goes_on = min(length, reach + LIMITS.beyond_ring * radius)
            pieces.append((start, axis, goes_on, wide * radius, wide * slope))
            at_ring = 1.05 * (radius + slope * reach)
            ends.append(np.array([*(start + reach * axis), *axis, at_ring]))
    columns = [np.array(column) for column in zip(*pieces, strict=True)]
    lengths, radii, slopes = columns[2:]
    thinnest = np.minimum(radii, radii + slopes * lengths)
    fillet = layout.fillet_mm
    rho = layout.fillet_ratio * thinnest if fillet is None else np.full(len(radii), fillet)
    rows = wall_rows(columns[0], columns[1], lengths, radii, slopes)
    return Rounding(rows, rho, np.reshape(np.array(ends), (-1, 7)), tolerance_mm)


def _pieces(
    layout: Layout, run: int
) -> Iterator[tuple[FloatArray, FloatArray, float, float, float]]:
    """Yield start, axis, length, radius and slope of each piece of a swallowed run."""
    chain, wide = layout.runs[run], area_factor(layout.facets[run])
    step = np.diff(chain.points, axis=0)
    for k, length in enumerate(np.linalg.norm(step, axis=1).tolist()):
        radius, slope = wide * chain.radius[k], wide * (chain.radius[k + 1] - chain.radius[k])
        yield chain.points[k], step[k] / length, length, float(radius), float(slope / length)


def overlapping_runs(layout: Layout) -> IntArray:
    """Find pairs of runs (k, 2) whose walls overlap away from a common junction.

    A run paired with itself winds into itself.
    """
    starts, ends, radii, nodes, run_of, along = _wall_pieces(layout)
    pairs, _, _ = close_pairs(starts, ends, radii, nodes, 0.0, LIMITS.clearance)
    if len(pairs) == 0:
        return np.empty((0, 2), dtype=np.int64)
    both = radii[pairs].sum(axis=1)
    one, two = run_of[pairs].T
    length = np.linalg.norm(ends - starts, axis=1)
    near = np.abs(along[pairs[:, 0]] - along[pairs[:, 1]]) - length[pairs].sum(axis=1) / 2
    bend = (one == two) & (near <= LIMITS.bend * both)
    return np.unique(np.stack([one, two], axis=1)[~bend], axis=0)


def _wall_pieces(layout: Layout) -> tuple[Any, Any, Any, Any, Any, Any]:
    """Return start, end, radius, end nodes, run and place along it of all pieces."""
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
