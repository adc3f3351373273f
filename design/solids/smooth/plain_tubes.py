"""Mesh the tubes between junctions; give some tubes of a finished surface other free ends."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from design.network import FloatArray
from design.solids.chains import Chain
from design.solids.smooth.layout import Layout, first_piece
from design.solids.smooth.sewing import FaceArray, Sewing
from design.solids.tube import EndShape, straight_tubes, tube_mesh

Shape = tuple[EndShape, EndShape]

_SAME_RING = 1e-6
"""Of a tube's radius: how far a ring made anew may lie from the one that it takes the place of."""


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
        faces, rings = _opened(triangles, vertices.shape[1], facets, opened)
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


def _opened(
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


def with_other_tubes(
    layout: Layout, sewing: Sewing, others: Mapping[int, Chain]
) -> tuple[FloatArray, FaceArray] | None:
    """The surface with the tubes of some runs swapped, round at free ends; None where one can't be.

    Parameters
    ----------
    layout : Layout
    sewing : Sewing
    others : mapping of run to Chain
        The same run with its free ends elsewhere.
    """
    vertices, faces = sewing.surface()
    meshes, kept, count = [vertices], np.ones(len(faces), np.bool_), len(vertices)
    added: list[FaceArray] = []
    joined = layout.joint_of()
    for index, run in others.items():
        if layout.swallowed[index]:
            return None
        facets, part = layout.facets[index], trimmed(layout, index, run)
        opened = [(index, end) in joined for end in (0, 1)]
        ends: list[EndShape] = ["flat" if is_open else "round" for is_open in opened]
        points, triangles = tube_mesh(part.points, part.radius, facets, (ends[0], ends[1]))
        own, rings = _opened(triangles, len(points), facets, opened)
        number = count + np.arange(len(points))
        for end, ring in rings.items():
            known = sewing.rings[index, end]
            if np.abs(points[ring] - vertices[known]).max() > _SAME_RING * part.radius[-end]:
                return None
            number[ring] = known
        kept[sewing.tubes[index]] = False
        added.append(number[own])
        meshes.append(points)
        count += len(points)
    return np.concatenate(meshes), np.concatenate([faces[kept], *added])
