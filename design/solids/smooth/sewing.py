"""Sew rings, tubes and junctions of vessels into one surface."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry.crossings import find_new_crossings
from design.solids.smooth.layout import End, Layout, first_piece
from design.solids.solid import Solid
from design.solids.topology import is_closed
from design.solids.tube import Chain, EndShape, straight_tubes, tube_mesh
from kernels.arrays import FloatArray, IntArray

FaceArray = NDArray[np.int64]


class _Limits(NamedTuple):
    """Limits of sewing; lengths in the thinnest radius."""

    junction_edge: float = 0.05  # shorter edges of a junction aren't parted
    junction_points: int = 6000
    tries: int = 3  # of taking more vessels into a group, before all are
    sliver: float = 1e-4  # between facets that nearly coincide; it would cross itself when moved
    sharp_sliver: float = 1e-3  # of groups that stay sharp, and
    sharp_sliver_mm: float = 2e-5  # at most, two steps of float32 at 100 mm
    crumb: float = 0.1  # side of a cube that is no part of a lumen
    clear_of_tubes: float = 0.999  # of balls inside the tubes' facets, so that there are no slivers
    coarser_balls: float = 4.0  # tolerance of balls, which show in a bend's outer corner alone
    same_place: float = 1e-9  # of a ring's size, within which its vertices are found again
    same_ring: float = 1e-6  # of a tube's radius, between a ring and one that takes its place
    beyond_ring: float = 4.0  # of plain tube beyond a group's ring that the ball can touch
    clearance: float = 0.03  # of the thinner radius, of a polygon's corners over its circle
    bend: float = 2.5  # both radii: pieces of a run no farther apart along it are one bend


LIMITS: Final = _Limits()


Shape = tuple[EndShape, EndShape]


def add_plain_tubes(layout: Layout, shapes: list[Shape], sewing: Sewing) -> None:
    """Add the tubes of all runs that have room for one, open where they are joined.

    They are the first piece of ``sewing``; a closed end's unused apex is dropped later.
    """
    joined = layout.joint_of()
    meshes, all_faces, first, begun = [np.empty((0, 3))], [np.empty((0, 3), np.int64)], 0, 0
    for alike in _alike(layout, shapes):
        facets, opened = layout.facets[alike[0]], [(alike[0], end) in joined for end in (0, 1)]
        parts = [trimmed(layout, index, layout.runs[index]) for index in alike]
        points = np.stack([part.points for part in parts])
        radius = np.stack([part.radius for part in parts])
        if points.shape[1] == 2:
            vertices, triangles = straight_tubes(points, radius, facets, shapes[alike[0]])
        else:
            vertices, triangles = tube_mesh(points[0], radius[0], facets, shapes[alike[0]])
            vertices = vertices[None]
        faces, rings = opened_tube(triangles, vertices.shape[1], facets, opened)
        for index in alike:
            sewing.tubes[index] = slice(begun, begun + len(faces))
            sewing.rings.update({(index, end): first + ring for end, ring in rings.items()})
            all_faces.append(faces + first)
            first += vertices.shape[1]
            begun += len(faces)
        meshes.append(vertices.reshape(-1, 3))
    sewing.add(np.concatenate(meshes), np.concatenate(all_faces))


def _alike(layout: Layout, shapes: list[Shape]) -> list[list[int]]:
    """Group the runs that have a tube: straight ones by facets and ends, others alone."""
    joined = layout.joint_of()
    groups: dict[tuple[object, ...], list[int]] = defaultdict(list)
    for index, run in enumerate(layout.runs):
        if not layout.swallowed[index]:
            opened = tuple((index, end) in joined for end in (0, 1))
            key = (layout.facets[index], opened, shapes[index])
            groups[key if len(run.points) == 2 else (index,)].append(index)
    return list(groups.values())


def opened_tube(
    triangles: FaceArray, count: int, facets: int, opened: list[bool]
) -> tuple[FaceArray, dict[int, NDArray[np.int64]]]:
    """Return a tube's faces without the fans at its open ends, and the rings there by end."""
    sides = len(triangles) - 2 * facets
    last = (count - 2) // facets - 1
    ring = {0: np.arange(facets), 1: last * facets + np.arange(facets)}
    fans = [triangles[sides + end * facets : sides + (end + 1) * facets] for end in (0, 1)]
    kept = [
        triangles[:sides],
        *(fan for fan, is_open in zip(fans, opened, strict=True) if not is_open),
    ]
    return np.concatenate(kept), {end: ring[end] for end in (0, 1) if opened[end]}


def trimmed(layout: Layout, index: int, run: Chain) -> Chain:
    """``run`` between the junctions at the ends of the layout's run ``index``."""
    points, radius = run.points.copy(), run.radius.copy()
    for end in (0, 1):
        reach = layout.reach.get((index, end))
        if reach is not None:
            start, axis, _, near, slope = first_piece(run, end)
            points[-end] = start + reach * axis
            radius[-end] = near + slope * reach
    return Chain(points, radius, run.node)


@dataclass
class Sewing:
    """Closed surface under assembly."""

    vertices: list[FloatArray] = field(default_factory=list)
    faces: list[FaceArray] = field(default_factory=list)
    count: int = 0  # of vertices
    # Vertices (n,) of the open end of each plain tube.
    rings: dict[End, NDArray[np.int64]] = field(default_factory=dict)
    # Faces of each plain tube, among all.
    tubes: dict[int, slice] = field(default_factory=dict)

    def add(self, vertices: FloatArray, faces: FaceArray) -> int:
        """Add a piece whose vertices are all its own; returns the number of its first one."""
        first = self.count
        self.vertices.append(vertices)
        self.faces.append(faces + first)
        self.count += len(vertices)
        return first

    def sew(self, vertices: FloatArray, faces: FaceArray, known: NDArray[np.int64]) -> None:
        """Add a piece with vertices that are here already: ``known`` (n,), -1 for the others."""
        number = known.copy()
        fresh = number < 0
        number[fresh] = self.count + np.arange(int(fresh.sum()))
        self.vertices.append(vertices[fresh])
        self.faces.append(number[faces])
        self.count += int(fresh.sum())

    def place(self, ring: NDArray[np.int64]) -> FloatArray:
        """Return the places of a ring of the tubes, which were added first as one array."""
        return self.vertices[0][ring]

    def tube(self, run: int) -> FaceArray:
        """Return the faces (m, 3) of a run's plain tube."""
        return self.faces[0][self.tubes[run]]

    def surface(self) -> tuple[FloatArray, FaceArray]:
        """Return all vertices (n, 3), mm, and faces (m, 3) so far."""
        return np.concatenate(self.vertices), np.concatenate(self.faces)


def with_other_tubes(
    solid: Solid,
    middle: FloatArray,
    layout: Layout,
    sewing: Sewing,
    others: Mapping[int, Chain],
) -> Solid | None:
    """Swap the tubes of some runs for others with round free ends; None where one can't be.

    ``solid`` is that of the sewing, moved by ``middle`` (3,) mm and rounded to float32; ``others``
    are the same runs with their free ends elsewhere. Where it is known to be uncrossed, only the
    new tubes are tried.
    """
    gone = np.zeros(len(solid.faces), dtype=np.bool_)
    places, added, count = [solid.vertices], list[IntArray](), len(solid.vertices)
    for index, run in others.items():
        if layout.swallowed[index]:
            return None
        old = _take_out(solid, middle, sewing, index, gone)
        if old is None:
            return None
        points, faces, rings = _tube(layout, index, run)
        number = count + np.arange(len(points))
        for end, ring in rings.items():
            known = sewing.rings[index, end]
            if (
                np.abs(points[ring] - sewing.place(known)).max()
                > LIMITS.same_ring * run.radius[-end]
            ):
                return None
            number[ring] = [old[vertex] for vertex in known.tolist()]
        places.append((points + middle).astype(np.float32).astype(np.float64))
        added.append(number[faces])
        count += len(points)
    return _swapped(solid, gone, np.concatenate(places), np.concatenate(added))


def _take_out(
    solid: Solid, middle: FloatArray, sewing: Sewing, index: int, gone: NDArray[np.bool_]
) -> dict[int, int] | None:
    """Mark the faces of a run's tube; its vertices' numbers in the solid by those of the sewing.

    None where the solid doesn't hold just that tube: mending may have changed it.
    """
    faces = sewing.tube(index)
    vertices = np.unique(faces)
    places = (sewing.place(vertices) + middle).astype(np.float32).astype(np.float64)
    near = np.flatnonzero(np.isin(solid.vertices[:, 0], places[:, 0]))
    number_of = {tuple(solid.vertices[number].tolist()): number for number in near.tolist()}
    number = [number_of.get(tuple(place), -1) for place in places.tolist()]
    own = np.zeros(len(solid.vertices), dtype=np.bool_)
    own[number] = True
    known = dict(zip(vertices.tolist(), number, strict=True))
    mine = np.flatnonzero(own[solid.faces].all(axis=1))
    wanted = {_turned(*(known[vertex] for vertex in face)) for face in faces.tolist()}
    if min(number) < 0 or {_turned(*face) for face in solid.faces[mine].tolist()} != wanted:
        return None
    gone[mine] = True
    return known


def _turned(a: int, b: int, c: int) -> tuple[int, int, int]:
    """Return a face's corners in their order, the least first."""
    least = min(a, b, c)
    return (a, b, c) if a == least else (b, c, a) if b == least else (c, a, b)


def _tube(
    layout: Layout, index: int, run: Chain
) -> tuple[FloatArray, IntArray, dict[int, NDArray[np.int64]]]:
    """Return vertices, faces and joined rings of a run's tube with other, round free ends."""
    joined = layout.joint_of()
    facets, part = layout.facets[index], trimmed(layout, index, run)
    opened = [(index, end) in joined for end in (0, 1)]
    ends: list[EndShape] = ["flat" if is_open else "round" for is_open in opened]
    points, triangles = tube_mesh(part.points, part.radius, facets, (ends[0], ends[1]))
    return points, *opened_tube(triangles, len(points), facets, opened)


def _swapped(
    solid: Solid, gone: NDArray[np.bool_], vertices: FloatArray, added: IntArray
) -> Solid | None:
    """Replace the faces ``gone`` by those ``added``; None where that isn't closed."""
    faces = np.concatenate([solid.faces[~gone], added])
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    vertices, faces = vertices[used], (np.cumsum(used) - 1)[faces]
    if not is_closed(faces):
        return None
    fresh = np.arange(len(faces)) >= len(faces) - len(added)
    uncrossed = solid.uncrossed and not len(find_new_crossings(vertices, faces, fresh).pairs)
    return Solid(vertices, faces.astype(np.int32), uncrossed=uncrossed)
