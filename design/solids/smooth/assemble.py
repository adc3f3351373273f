"""Sew meshes of tubes, single junctions and overlapping junctions to one closed surface."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from manifold3d import Manifold
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.solids.facets import area_factor
from design.solids.manifolds import to_manifold
from design.solids.smooth.conflicts import overlapping_runs
from design.solids.smooth.group_walls import crowd_rounding
from design.solids.smooth.layout import Layout, absorb_runs, keep_clear_of_balls
from design.solids.smooth.overlap_group import (
    COARSER_BALLS,
    LostRingError,
    ball,
    connecting_tube,
    unite_parts,
)
from design.solids.smooth.plain_tubes import add_plain_tubes
from design.solids.smooth.round_seams import round_seams
from design.solids.smooth.sewing import FaceArray, Sewing
from design.solids.smooth.star import star_mesh
from design.solids.tube import EndShape, tube_mesh
from design.solids.twins import pair_half_edges
from kernels.arrays import FloatArray

_MIDDLES = 1.0
"""Facet tolerances between a junction's surface and its triangles' middles, as tubes have it."""

_LEAST_EDGE = 0.05
"""Of the thinnest radius: shorter edges of a junction aren't parted."""

_MOST_POINTS = 6000

_TRIES = 3
"""Of taking more vessels into a group, before all are."""

_SLIVER = 1e-4
"""Of the thinnest radius: what facets that nearly coincide leave between them, and what would
cross once it is moved."""

_FLAT_MM, _FLAT = 2e-5, 1e-3
"""Slivers of groups that stay sharp: two steps of float32 at 100 mm, at most this share of the
thinnest radius."""

_CRUMB = 0.1
"""Of the thinnest radius: side of a cube that is no part of a lumen."""


def sew_parts(layout: Layout, shapes: list[tuple[EndShape, EndShape]]) -> Sewing:
    """Make all parts and sew them to one closed surface.

    Parameters
    ----------
    layout : Layout
    shapes : list of pairs
        How each run ends where it isn't joined.
    """
    overlaps = overlapping_runs(layout)
    absorb_runs(layout, np.unique(overlaps).tolist())
    for _ in range(_TRIES):
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
    """As `sew_parts`, and the runs around groups that couldn't be parted from the rest."""
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
        _MIDDLES * layout.facets_of.at(thin),
        _LEAST_EDGE * thin,
        _MOST_POINTS,
    )
    if status or not _fits(faces, ring_of, len(known)):
        return False
    fresh = np.full(len(points) - len(known), -1)
    sewing.sew(points, faces, np.concatenate([known, fresh]))
    return True


def _fits(faces: FaceArray, ring_of: NDArray[np.int64], count: int) -> bool:
    """Whether the rim of ``faces`` is the rings (their vertices come first), and nothing else."""
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
    """Junctions and swallowed runs that hang together."""
    joints = len(layout.ends)
    parent = list(range(joints + len(layout.runs)))

    def top(item: int) -> int:
        while parent[item] != item:
            parent[item] = parent[parent[item]]
            item = parent[item]
        return item

    def join(one: int, two: int) -> None:
        parent[max(top(one), top(two))] = min(top(one), top(two))

    swallowed = [run for run, is_in in enumerate(layout.swallowed) if is_in]
    joined = layout.joint_of()
    for run in swallowed:
        for end in (0, 1):
            if (run, end) in joined:
                join(joints + run, joined[run, end])
    for one, two in overlaps.tolist():
        join(joints + one, joints + two)
    members: dict[int, tuple[list[int], list[int]]] = defaultdict(lambda: ([], []))
    for joint in range(joints):
        if layout.crowded(joint):
            members[top(joint)][0].append(joint)
    for run in swallowed:
        members[top(joints + run)][1].append(run)
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
    finer = COARSER_BALLS if rounds else 1.0
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
    sliver = _SLIVER * thin if rounds else min(_FLAT_MM, _FLAT * thin)
    vertices, faces, where = unite_parts(parts, places, _CRUMB * thin, sliver)
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
