"""Repair a tissue's triangle surface as far as is safe, and report the repairs.

A closed, consistently oriented surface whose faces don't pass through one another is handed on
untouched. Otherwise, in turn: duplicate faces are dropped, vertices next to one another merged
along open edges, edges split at vertices that lie on them, sheets left out, faces turned to agree
with their neighbours, small holes filled, shells that look inward turned, small places where a
shell passes through itself replaced, shells that overlap united. What is too large to be mended
without guessing is refused.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from design.errors import TissueError
from design.geometry.mesh import connected_parts, edges_of
from design.geometry.surface import Surface
from design.tissue.closed import (
    FaceArray,
    check_closed,
    enclosed_volume,
    face_areas,
    format_points,
    merged_surface,
)
from design.tissue.parts import crossing_faces, enclosures, neighbours, shells_of, unite_shells
from kernels.arrays import FloatArray


class RepairLimits(NamedTuple):
    """How far a surface is mended; lengths are shares of its largest extent."""

    # Height of a flat face, and distance of a vertex from an edge it lies on: some float32
    # steps.
    rounding: float = 2e-6
    gap: float = 1e-4  # Widest gap between open edges that is merged over
    # The same over a short open edge (the fifth percentile): no face may collapse.
    gap_per_edge: float = 0.25
    # One edge of a face is split in each; a face has three, and new ones arise.
    joint_rounds: int = 8
    # Area that closes an open piece's rims, over its own, above which it is a sheet: 0.95 for
    # a bent one, 0.5 for half a ball, 0.2 for a box without lid.
    sheet_lid: float = 0.6
    sheet_compactness: float = 0.002  # 36 π V² / A³ (1 for a ball) below which it is one, too
    hole_width: float = 0.15  # Widest hole that is filled
    hole_area: float = 0.02  # Of all holes, over the surface's
    # Corners of a rim up to which the least patch is searched (its time grows with the cube);
    # beyond, a fan from its middle.
    exact_rim: int = 64
    crossing_faces: float = 0.05  # Share of the faces that may pass through others
    crossing_rounds: int = 5  # Of replacing them, each but the first with one more row of faces


LIMITS = RepairLimits()


@dataclass
class _Work:
    """The surface as it stands, and what was done so far."""

    points: FloatArray
    faces: FaceArray
    done: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)

    def did(self, count: int, what: str) -> None:
        if count:
            self.done.append(f"{count} {what}")


def repair_surface(
    vertices: FloatArray, faces: NDArray[np.integer], unit: str = "mm"
) -> tuple[Surface, tuple[str, ...]]:
    """Mend a surface.

    Parameters
    ----------
    vertices : (n, 3) float64
    faces : (m, 3) integer
    unit : str
        Of the vertices, for the notes.

    Returns
    -------
    Surface
        Closed and consistently oriented; the enclosed volume is positive.
    notes : tuple of str
        What was done, how much of it and where, and what the volume was before and is now; empty
        when nothing had to be done.

    Raises
    ------
    TissueError
        When the mesh is empty or can't be mended: large holes, faces that can't be oriented,
        large parts that pass through themselves; with counts and places.
    """
    work = _Work(*merged_surface(vertices, faces))
    before = enclosed_volume(work.points, work.faces)
    _close(work, unit)
    work.faces, turned = turn_shells(work.points, work.faces)
    work.did(turned, "shell(s) turned that looked inward")
    check_closed(work.points, work.faces)
    _untangle(work, unit)
    _unite(work)
    after = enclosed_volume(work.points, work.faces)
    if work.done:
        work.notes.insert(0, _say(work.done, before, after, unit))
    return Surface(work.points, work.faces), tuple(work.notes)


def _say(done: list[str], before: float, after: float, unit: str) -> str:
    change = f"{100 * (after / before - 1):+.2g} %" if before > 0 else "it was inside out"
    return (
        f"mesh repaired: {'; '.join(done)}; volume {before:.6g} before, {after:.6g} {unit}³ now "
        f"({change}); look at tissue.stl"
    )


def _close(work: _Work, unit: str) -> None:
    """Drop duplicates, merge rims, agree on orientation and fill holes."""
    work.faces, dropped = drop_duplicates(work.faces)
    work.did(dropped, "duplicate face(s) dropped")
    edges = edges_of(work.faces)
    if not edges.open and not edges.turned:
        return
    work.faces, flat = drop_flat_faces(work.points, work.faces)
    work.did(flat, "face(s) without area left out")
    work.points, work.faces, welded, gap = weld_rims(work.points, work.faces)
    work.did(welded, f"vertices merged with others at most {gap:.2g} {unit} away")
    work.faces, split = split_joints(work.points, work.faces)
    work.did(split, "edge(s) split at vertices that lay on them")
    work.faces, extra = drop_duplicates(work.faces)
    work.did(extra, "face(s) dropped that had become duplicates")
    work.faces, sheets, area = drop_sheets(work.points, work.faces)
    if sheets:
        work.did(
            len(sheets),
            f"sheet(s) of {area:.3g} {unit}² in all left out, which enclose nothing, "
            f"{format_points(np.array(sheets))}",
        )
    work.faces, turned = agree(work.points, work.faces)
    work.did(turned, "face(s) turned to agree with their neighbours")
    work.points, work.faces, holes = fill_holes(work.points, work.faces)
    if holes:
        centres = np.array([hole.centre for hole in holes])
        widest = max(hole.width for hole in holes)
        work.did(
            len(holes), f"hole(s) filled, up to {widest:.3g} {unit} wide, {format_points(centres)}"
        )


def _untangle(work: _Work, unit: str) -> None:
    """Replace small patches where a shell passes through itself."""
    replaced = 0
    places: list[FloatArray] = []
    for attempt in range(LIMITS.crossing_rounds):
        crossing = _own_crossings(work)
        if len(crossing) == 0:
            break
        middles = work.points[work.faces[crossing]].mean(axis=1)
        places.append(middles)
        too_many = len(crossing) > LIMITS.crossing_faces * len(work.faces)
        if too_many or attempt == LIMITS.crossing_rounds - 1:
            raise _entangled(work, middles)
        around = np.isin(work.faces, np.unique(work.faces[crossing])).any(axis=1)
        if attempt:
            around = np.isin(work.faces, np.unique(work.faces[around])).any(axis=1)
        try:
            patched = fill_holes(work.points, work.faces[~around])[:2]
            work.points, work.faces = merged_surface(*patched)
            check_closed(work.points, work.faces)
        except TissueError as error:
            # The holes are ours: what is wrong with the mesh are the faces that were there.
            raise _entangled(work, np.concatenate(places)) from error
        replaced += int(around.sum())
    if replaced:
        work.did(
            replaced,
            f"faces replaced where the surface passed through itself, "
            f"{format_points(np.concatenate(places))}",
        )


def _entangled(work: _Work, middles: FloatArray) -> TissueError:
    return TissueError(
        f"mesh passes through itself: {len(middles)} of {len(work.faces)} faces meet others of "
        f"their own shell ({format_points(middles)}), too many or too large to be replaced "
        "safely; make it one solid there with a mesh editor (a remesh, or a union with itself) "
        "and try again"
    )


def _own_crossings(work: _Work) -> NDArray[np.int64]:
    """Faces that pass through others of their own shell."""
    pairs = crossing_faces(work.points, work.faces)
    shell = shells_of(work.points, work.faces)
    own = shell[pairs[:, 0]] == shell[pairs[:, 1]]
    return np.unique(pairs[own])


def _unite(work: _Work) -> None:
    """Make one solid of shells that overlap or lie within one another without a cavity."""
    work.points, work.faces, united, kept = unite_shells(work.points, work.faces)
    work.did(united, "overlapping shells united, or touching ones (overlaps counted twice before)")
    if kept:
        work.notes.append(
            f"{kept} shell(s) inside others look outward and were taken for solid; where that is a "
            "cavity, turn its faces inward in the file"
        )


# Remove stray open pieces of a triangle surface that enclose no volume.


def drop_sheets(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, list[FloatArray], float]:
    """Leave out open pieces that enclose next to nothing, where others are closed.

    Returns
    -------
    faces : (k, 3) int32
    middles : list of (3,) float64
        Of the sheets left out.
    area : float
        Of them all.
    """
    edges = edges_of(faces)
    if not edges.open:
        return faces, [], 0.0
    shell = shells_of(points, faces)
    single = (edges.uses == 1)[edges.of_face].reshape(-1, 3).any(axis=1)
    opened = np.unique(shell[single])
    count = int(shell.max()) + 1
    if len(opened) == count:
        return faces, [], 0.0
    sheets = [n for n in opened if _is_sheet(points, faces[shell == n])]
    out: NDArray[np.bool_] = np.isin(shell, sheets)
    middles = [points[np.unique(faces[shell == n])].mean(axis=0) for n in sheets]
    return faces[~out], middles, float(face_areas(points, faces[out]).sum())


def drop_flat_faces(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, int]:
    """Leave out faces without area whose three edges each have one face too many.

    Others without area stay: they may close a slit between edges that were split differently.
    """
    near = LIMITS.rounding * float(np.ptp(points, axis=0).max())
    corners = points[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    flat = 2.0 * face_areas(points, faces) <= near * longest
    if not flat.any():
        return faces, 0
    edges = edges_of(faces)
    odd = (edges.uses % 2 == 1)[edges.of_face].reshape(-1, 3).all(axis=1)
    out = flat & odd
    return faces[~out], int(out.sum())


def _is_sheet(points: FloatArray, faces: FaceArray) -> bool:
    """Whether an open piece, each rim closed by a point in its middle, is next to flat."""
    rim = _open_sides(faces)
    used, number = np.unique(rim, return_inverse=True)
    ends = number.reshape(-1, 2)
    group = connected_parts(ends, len(used))
    middles = np.stack([points[used[group == n]].mean(axis=0) for n in range(group.max() + 1)])
    lids = np.column_stack([rim[:, ::-1], len(points) + group[ends[:, 0]]])
    every = np.concatenate([points, middles])
    volume = enclosed_volume(every, np.concatenate([faces, lids]))
    area = float(face_areas(points, faces).sum())
    lid = float(face_areas(every, lids).sum())
    return bool(
        lid > LIMITS.sheet_lid * area
        or 36.0 * np.pi * volume**2 < LIMITS.sheet_compactness * (area + lid) ** 3
    )


# Split faces at vertices that lie on their open edges (T-junctions).


def split_joints(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, int]:
    """Give faces the vertices of their open edges that neighbours have there.

    A program that splits an edge of one face only leaves a slit without width: the edges are open,
    and nothing is missing.

    Returns
    -------
    faces : (m, 3) int32
    count : int
        Edges split.
    """
    done = 0
    near = LIMITS.rounding * float(np.ptp(points, axis=0).max())
    for _ in range(LIMITS.joint_rounds):
        faces, count = _split_once(points, faces, near)
        done += count
        if count == 0:
            break
    return faces, done


def _split_once(points: FloatArray, faces: FaceArray, near: float) -> tuple[FaceArray, int]:
    """Split one edge of each face that has one to be split."""
    edges = edges_of(faces)
    side = np.flatnonzero(edges.uses[edges.of_face] == 1)
    if len(side) == 0:
        return faces, 0
    rim = np.unique(edges.ends[edges.uses == 1])
    tree = cKDTree(points[rim])
    taken: set[int] = set()
    new: list[tuple[int, int, int]] = []
    for face, k in zip((side // 3).tolist(), (side % 3).tolist(), strict=True):
        a, b, c = (int(faces[face, (k + n) % 3]) for n in range(3))
        on = [] if face in taken else _between(points, rim, tree, (a, b, c), near)
        if on:
            taken.add(face)
            new += [(p, q, c) for p, q in zip([a, *on], [*on, b], strict=True)]
    if not taken:
        return faces, 0
    rest = np.delete(faces, sorted(taken), axis=0)
    return np.concatenate([rest, np.array(new, dtype=np.int32)]), len(taken)


def _between(
    points: FloatArray,
    rim: NDArray[np.int64],
    tree: cKDTree,
    corners: tuple[int, int, int],
    near: float,
) -> list[int]:
    """Rim vertices on edge ab of a face, in order from a."""
    a, b, _ = corners
    way = points[b] - points[a]
    length = float(np.linalg.norm(way))
    some = rim[tree.query_ball_point(points[a] + 0.5 * way, 0.5 * length + near)]
    some = some[~np.isin(some, corners)]
    along = (points[some] - points[a]) @ way / length
    beside = np.linalg.norm(points[some] - points[a] - np.outer(along / length, way), axis=1)
    on = (beside <= near) & (along > near) & (along < length - near)
    return [int(v) for v in some[on][np.argsort(along[on])]]


# Drop duplicate faces of a mesh and weld the vertices along narrow gaps.


def drop_duplicates(faces: FaceArray) -> tuple[FaceArray, int]:
    """Keep one of each set of faces with the same corners, unless that opens edges.

    Where as many look one way as the other, two solids meet: the wall between them goes, if that
    leaves fewer edges open.
    """
    key = np.sort(faces, axis=1)
    _, first, group = np.unique(key, axis=0, return_index=True, return_inverse=True)
    if len(first) == len(faces):
        return faces, 0
    group = group.ravel()
    looks = np.bincount(group, weights=_way_round(faces, key), minlength=len(first))
    once, no_walls = faces[np.sort(first)], faces[np.sort(first[looks != 0])]
    fewer = min((once, no_walls), key=_faults)
    if edges_of(fewer).open > edges_of(faces).open:
        return faces, 0
    return fewer, len(faces) - len(fewer)


def _faults(faces: FaceArray) -> tuple[bool, int, int]:
    edges = edges_of(faces)
    return len(faces) == 0, edges.open, edges.turned


def _way_round(faces: FaceArray, key: FaceArray) -> NDArray[np.int64]:
    """+1 for faces whose corners ascend when gone round, -1 for the others."""
    at = (faces == key[:, :1]).argmax(axis=1)
    after = faces[np.arange(len(faces)), (at + 1) % 3]
    return np.where(after == key[:, 1], 1, -1)


def weld_rims(points: FloatArray, faces: FaceArray) -> tuple[FloatArray, FaceArray, int, float]:
    """Merge vertices on open edges that are nearly in one place.

    Returns
    -------
    points, faces
    count : int
        Vertices merged away.
    gap : float
        The farthest any of them lay from its group's first.
    """
    sides = _open_sides(faces)
    if len(sides) == 0:
        return points, faces, 0, 0.0
    rim = np.unique(sides)
    edge = np.linalg.norm(points[sides[:, 1]] - points[sides[:, 0]], axis=1)
    reach = min(
        LIMITS.gap * float(np.ptp(points, axis=0).max()),
        LIMITS.gap_per_edge * float(np.percentile(edge, 5)),
    )
    pairs = cKDTree(points[rim]).query_pairs(reach, output_type="ndarray")
    if len(pairs) == 0:
        return points, faces, 0, 0.0
    group = connected_parts(pairs, len(rim))
    groups = int(group.max()) + 1
    leader = np.full(groups, len(rim))
    np.minimum.at(leader, group, np.arange(len(rim)))
    number = np.arange(len(points))
    number[rim] = rim[leader[group]]
    gap = float(np.linalg.norm(points[rim] - points[number[rim]], axis=1).max())
    joined = points[number]
    new_points, new_faces = merged_surface(joined, faces)
    return new_points, new_faces, len(rim) - groups, gap


# Fill the small holes of a triangle surface, each with the patch of least area.


@dataclass(frozen=True)
class Hole:
    """A rim that was filled: its middle, and its largest extent."""

    centre: FloatArray
    width: float


def fill_holes(points: FloatArray, faces: FaceArray) -> tuple[FloatArray, FaceArray, list[Hole]]:
    """Close each rim of open edges with the patch of least area (Barequet & Sharir 1995).

    Raises
    ------
    TissueError
        When a hole or all of them are too large (`LIMITS`), or the open edges don't form rims.
    """
    rims = _rims(points, faces)
    if not rims:
        return points, faces, []
    extent = float(np.ptp(points, axis=0).max())
    holes = [
        Hole(points[rim].mean(axis=0), float(np.ptp(points[rim], axis=0).max())) for rim in rims
    ]
    wide = [hole for hole in holes if hole.width > LIMITS.hole_width * extent]
    if wide:
        raise TissueError(
            f"mesh is open: {len(wide)} of {len(holes)} holes are too wide to be filled without "
            f"guessing, the widest {max(h.width for h in wide):.3g} of "
            f"{LIMITS.hole_width * extent:.3g} allowed "
            f"({format_points(np.array([h.centre for h in wide]))}); "
            f"{sum(len(rim) for rim in rims)} of {len(edges_of(faces).uses)} edges aren't shared "
            "by two faces; close them in a mesh editor and try again"
        )
    area = float(face_areas(points, faces).sum())
    new: list[NDArray[np.int64]] = []
    for rim in rims:
        points, patch = _patch(points, rim)
        new.append(patch)
    patches = np.concatenate(new)
    filled = float(face_areas(points, patches).sum())
    if filled > LIMITS.hole_area * area:
        raise TissueError(
            f"mesh is open: {len(holes)} holes make up {100 * filled / area:.2g} % of its surface, "
            f"above {100 * LIMITS.hole_area:g} % "
            f"({format_points(np.array([h.centre for h in holes]))}); close them in a mesh editor "
            "and try again"
        )
    return points, np.concatenate([faces, patches.astype(np.int32)]), holes


def _open_sides(faces: FaceArray) -> FaceArray:
    """The sides of faces without a neighbour, as their two vertices in order, (k, 2)."""
    edges = edges_of(faces)
    sides = faces[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2)
    return sides[edges.uses[edges.of_face] == 1]


def _rims(points: FloatArray, faces: FaceArray) -> list[NDArray[np.int64]]:
    """Loops of open edges, each the way round in which its patch is to be wound."""
    sides = _open_sides(faces)
    onward: dict[int, list[int]] = {}
    for b, a in sides.tolist():
        onward.setdefault(a, []).append(b)
    rims: list[NDArray[np.int64]] = []
    while onward:
        path = [next(iter(onward))]
        while True:
            ways_on = onward.get(path[-1])
            if not ways_on:
                raise TissueError(
                    f"mesh is open, and its {len(sides)} open edges form no closed rims "
                    f"({format_points(points[[path[-1]]])}); mend it there and try again"
                )
            following = ways_on.pop()
            if not ways_on:
                del onward[path[-1]]
            if following in path:
                # Rims that touch in a vertex are taken apart there.
                at = path.index(following)
                rims.append(np.array(path[at:]))
                path = path[: at + 1]
                if len(path) == 1:
                    break
            else:
                path.append(following)
    return rims


def _patch(points: FloatArray, rim: NDArray[np.int64]) -> tuple[FloatArray, NDArray[np.int64]]:
    """Triangles that fill a rim; a long one gets a new vertex in its middle."""
    if len(rim) < 3:
        return points, np.empty((0, 3), dtype=np.int64)
    if len(rim) <= LIMITS.exact_rim:
        return points, rim[_least_patch(points[rim])]
    middle = np.full(len(rim), len(points))
    fan = np.stack([rim, np.roll(rim, -1), middle], axis=1)
    return np.concatenate([points, points[rim].mean(axis=0, keepdims=True)]), fan


def _least_patch(rim: FloatArray) -> NDArray[np.int64]:
    """Triangulation of a closed polygon (n, 3) of least area, by dynamic programming."""
    n = len(rim)
    cost = np.zeros((n, n))
    choice = np.zeros((n, n), dtype=np.int64)
    for span in range(2, n):
        for i in range(n - span):
            j = i + span
            m = np.arange(i + 1, j)
            across = np.cross(rim[m] - rim[i], rim[j] - rim[i])
            total = cost[i, m] + cost[m, j] + np.linalg.norm(across, axis=1)
            best = int(np.argmin(total))
            cost[i, j], choice[i, j] = total[best], m[best]
    triangles: list[tuple[int, int, int]] = []
    todo = [(0, n - 1)]
    while todo:
        i, j = todo.pop()
        if j - i < 2:
            continue
        middle = int(choice[i, j])
        triangles.append((i, middle, j))
        todo += [(i, middle), (middle, j)]
    return np.array(triangles, dtype=np.int64)


# Orient a mesh's faces consistently outwards.


def agree(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, int]:
    """Turn as little area as possible so that neighbours agree; how many faces were turned.

    Faces that agree form patches; of the patches joined across an edge one is turned.

    Raises
    ------
    TissueError
        When that can't be done (a Möbius strip).
    """
    one, two, alike = neighbours(edges_of(faces))
    if alike.all():
        return faces, 0
    patch = connected_parts(np.stack([one, two], axis=1)[alike], len(faces))
    count = int(patch.max()) + 1
    side = np.full(count, -1)
    against: dict[int, set[int]] = {}
    for a, b in np.unique(np.stack([patch[one[~alike]], patch[two[~alike]]], axis=1), axis=0):
        against.setdefault(int(a), set()).add(int(b))
        against.setdefault(int(b), set()).add(int(a))
    area = np.bincount(patch, weights=face_areas(points, faces), minlength=count)
    for first in range(count):
        if side[first] < 0:
            group = _two_sides(first, against, side)
            turned = group[side[group] == 1]
            if area[turned].sum() > 0.5 * area[group].sum():
                side[group] = 1 - side[group]
    wrong = side[patch[one]] != side[patch[two]]
    clash = wrong == alike
    if clash.any():
        where = points[faces[one[clash]]].mean(axis=1)
        raise TissueError(
            f"mesh can't be oriented: {int(clash.sum())} pairs of neighbouring faces contradict "
            f"one another ({format_points(where)}), as on a Möbius strip; mend the mesh there"
        )
    flip = side[patch] == 1
    agreeing = faces.copy()
    agreeing[flip] = agreeing[flip, ::-1]
    return agreeing, int(flip.sum())


def _two_sides(
    first: int, against: dict[int, set[int]], side: NDArray[np.int64]
) -> NDArray[np.int64]:
    """Give patches joined to ``first`` alternating sides, in place; return them."""
    side[first] = 0
    queue, group = deque([first]), [first]
    while queue:
        here = queue.popleft()
        for other in sorted(against.get(here, ())):
            if side[other] < 0:
                side[other] = 1 - side[here]
                queue.append(other)
                group.append(other)
    return np.array(group)


def turn_shells(points: FloatArray, faces: FaceArray) -> tuple[FaceArray, int]:
    """Turn shells that lie in no other and look inward, with what they hold; how many.

    When all look the wrong way the mesh is merely inside out, which counts as nothing done.
    """
    if enclosed_volume(points, faces) < 0:
        faces = np.ascontiguousarray(faces[:, ::-1])
    shell = shells_of(points, faces)
    count = int(shell.max()) + 1
    if count == 1:
        return faces, 0
    holds = enclosures(points, faces, shell)
    turn = np.zeros(count, dtype=bool)
    for n in np.flatnonzero(~holds.any(axis=0)):
        if enclosed_volume(points, faces[shell == n]) < 0:
            turn[n] = True
            turn |= holds[n]
    turned = faces.copy()
    flip = turn[shell]
    turned[flip] = turned[flip, ::-1]
    return turned, int(turn.sum())
