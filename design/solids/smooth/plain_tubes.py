"""Mesh plain tubes between junctions, with open rings at the ends where junctions are sewn on."""

from __future__ import annotations

from collections import defaultdict

import numpy as np
from numpy.typing import NDArray

from design.solids.chains import Chain
from design.solids.smooth.layout import Layout, first_piece
from design.solids.smooth.sewing import FaceArray, Sewing
from design.solids.tube import EndShape, straight_tubes, tube_mesh

Shape = tuple[EndShape, EndShape]


def add_plain_tubes(layout: Layout, shapes: list[Shape], sewing: Sewing) -> None:
    """Tubes of all runs that have room for one, open where they are joined.

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
    """Runs that have a tube: straight ones with the same facets and ends together."""
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
    """A tube's faces without the fans at its open ends, and the rings there by end."""
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
