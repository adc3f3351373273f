"""Swap plain tubes of a finished solid for tubes with other free ends."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from design.geometry.crossings import find_new_crossings
from design.solids.chains import Chain
from design.solids.smooth.layout import Layout
from design.solids.smooth.plain_tubes import opened_tube, trimmed
from design.solids.smooth.sewing import Sewing
from design.solids.solid import Solid
from design.solids.topology import is_closed
from design.solids.tube import EndShape, tube_mesh
from kernels.arrays import FloatArray, IntArray

_SAME_RING = 1e-6
"""Of a tube's radius: how far a ring made anew may lie from the one that it takes the place of."""


def with_other_tubes(
    solid: Solid,
    middle: FloatArray,
    layout: Layout,
    sewing: Sewing,
    others: Mapping[int, Chain],
) -> Solid | None:
    """A solid with the tubes of some runs swapped, round at free ends; None where one can't be.

    Parameters
    ----------
    solid : Solid
        Of the sewing, moved by ``middle`` (3,) mm and rounded to float32. Where it is known to be
        uncrossed, only the new tubes are tried.
    layout : Layout
    sewing : Sewing
    others : mapping of run to Chain
        The same run with its free ends elsewhere.
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
            if np.abs(points[ring] - sewing.place(known)).max() > _SAME_RING * run.radius[-end]:
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
    """A face's corners in their order, the least first."""
    least = min(a, b, c)
    return (a, b, c) if a == least else (b, c, a) if b == least else (c, a, b)


def _tube(
    layout: Layout, index: int, run: Chain
) -> tuple[FloatArray, IntArray, dict[int, NDArray[np.int64]]]:
    """Vertices, faces and joined rings of a run's tube with other free ends, which are round."""
    joined = layout.joint_of()
    facets, part = layout.facets[index], trimmed(layout, index, run)
    opened = [(index, end) in joined for end in (0, 1)]
    ends: list[EndShape] = ["flat" if is_open else "round" for is_open in opened]
    points, triangles = tube_mesh(part.points, part.radius, facets, (ends[0], ends[1]))
    return points, *opened_tube(triangles, len(points), facets, opened)


def _swapped(
    solid: Solid, gone: NDArray[np.bool_], vertices: FloatArray, added: IntArray
) -> Solid | None:
    """The solid without the faces ``gone``, with those ``added``; None where that isn't closed."""
    faces = np.concatenate([solid.faces[~gone], added])
    used = np.zeros(len(vertices), dtype=np.bool_)
    used[faces] = True
    vertices, faces = vertices[used], (np.cumsum(used) - 1)[faces]
    if not is_closed(faces):
        return None
    fresh = np.arange(len(faces)) >= len(faces) - len(added)
    uncrossed = solid.uncrossed and not len(find_new_crossings(vertices, faces, fresh).pairs)
    return Solid(vertices, faces.astype(np.int32), uncrossed=uncrossed)
