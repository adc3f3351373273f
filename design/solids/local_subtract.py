"""Subtract a large tool from a body near the body's surface alone.

A tree's lumen meets the surface of its tissue at a few ports; elsewhere it lies within, and its
triangles are the construct's as they are. So the part that meets the surface is cut off along the
tool's own edges, closed by flat fans and subtracted; then the fans are taken out and the rest of
the tool's triangles, turned round, is sewn in. Whatever isn't certain is left to the whole boolean.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.geometry.bvh import build_triangle_tree
from design.geometry.crossings import find_crossings, find_meetings, find_new_crossings
from design.solids.manifolds import solid_manifold, subtract, to_manifold
from design.solids.snap import solid_from_manifold
from design.solids.solid import Solid
from design.solids.topology import is_closed, surface_genus, vertex_parts
from design.tissue.grid import enclosed
from kernels.arrays import FloatArray, IntArray

Mask = NDArray[np.bool_]

MAX_ROWS = 4
"""Of triangles around those that meet the surface, until the piece's rims are clean."""
MAX_NEAR_SHARE = 0.5
"""Of the tool's triangles: where more are near the surface, nothing is saved."""


class _Piece(NamedTuple):
    """Part of a tool, closed by fans.

    Attributes
    ----------
    vertices : (n, 3) float64, mm
    faces : (m, 3) int64
        Those of the fans last.
    fans : int
        How many these are.
    loops : list of (k,) int64
        The tool's vertices around each fan.
    middles : (l, 3) float64, mm
        Of the fans.
    """

    vertices: FloatArray
    faces: IntArray
    fans: int
    loops: list[IntArray]
    middles: FloatArray


def subtract_near(body: Solid, tool: Solid, what: str) -> Solid | None:
    """``body`` minus ``tool``; None where it can't be done locally.

    Parameters
    ----------
    body : Solid
        Of one shell.
    tool : Solid
    what : str
        Names the result in messages.

    Raises
    ------
    SolidError
        As `solid_from_manifold`.
    """
    if surface_genus(body.faces)[1] != 1:
        return None
    near = _near_surface(body, tool)
    for _ in range(MAX_ROWS):
        if not near.any() or near.mean() > MAX_NEAR_SHARE:
            return None
        piece = _closed_piece(tool, near)
        if piece is not None and _is_clean(piece, body):
            return _with_rest(_cut(body, piece, what), tool, near, piece)
        around = np.zeros(len(tool.vertices), dtype=np.bool_)
        around[tool.faces[near]] = True
        near = np.asarray(around[tool.faces].any(axis=1))
    return None


def _near_surface(body: Solid, tool: Solid) -> Mask:
    """Faces (m,) of the tool that meet the body's surface, or lie outside."""
    tree = build_triangle_tree(body.vertices, body.faces)
    count = len(body.vertices)
    vertices = np.concatenate([body.vertices, tool.vertices])
    met = find_meetings(vertices, tool.faces + np.int32(count), tree, body.faces)[:, 0]
    near: Mask = np.zeros(len(tool.faces), dtype=np.bool_)
    near[met] = True
    part = vertex_parts(tool.faces[~near], len(tool.vertices))
    own, first = np.unique(part[tool.faces[~near][:, 0]], return_index=True)
    places = tool.vertices[tool.faces[~near][first, 0]]
    outside = own[~enclosed(tree, places)]
    near[~near & np.isin(part[tool.faces[:, 0]], outside)] = True
    return near


def _closed_piece(tool: Solid, near: Mask) -> _Piece | None:
    """The near faces, closed by a fan over each loop of their rim; None where loops touch."""
    faces = tool.faces[near].astype(np.int64)
    loops = _rim_loops(faces)
    if loops is None:
        return None
    middles = np.reshape([tool.vertices[loop].mean(axis=0) for loop in loops], (-1, 3))
    first = len(tool.vertices)
    # The rim is walked with the near faces on its left: a fan walks it the other way.
    fans = [
        np.stack([np.roll(loop, -1), loop, np.full(len(loop), first + number)], axis=1)
        for number, loop in enumerate(loops)
    ]
    used, numbers = np.unique(np.concatenate([faces, *fans]), return_inverse=True)
    vertices = np.concatenate([tool.vertices, middles])[used]
    count = sum(len(fan) for fan in fans)
    return _Piece(vertices, numbers.reshape(-1, 3), count, loops, middles)


def _rim_loops(faces: IntArray) -> list[IntArray] | None:
    """Loops of the edges that have a face on one side only; None where two touch in a vertex."""
    tail, head = faces.ravel(), np.roll(faces, -1, axis=1).ravel()
    size = int(faces.max()) + 1
    rim = ~np.isin(tail * size + head, head * size + tail)
    following = dict(zip(tail[rim].tolist(), head[rim].tolist(), strict=True))
    if len(following) < int(rim.sum()):
        return None
    loops: list[IntArray] = []
    while following:
        start, at = next(iter(following.items()))
        del following[start]
        loop = [start]
        while at != start:
            loop.append(at)
            at = following.pop(at)
        loops.append(np.array(loop, dtype=np.int64))
    return loops


def _is_clean(piece: _Piece, body: Solid) -> bool:
    """Whether the piece doesn't cross itself, and its fans lie within the body."""
    if len(find_crossings(piece.vertices, piece.faces).pairs):
        return False
    tree = build_triangle_tree(body.vertices, body.faces)
    vertices = np.concatenate([body.vertices, piece.vertices])
    fans = piece.faces[len(piece.faces) - piece.fans :] + len(body.vertices)
    met = find_meetings(vertices, fans.astype(np.int32), tree, body.faces)
    return len(met) == 0 and bool(enclosed(tree, piece.middles).all())


def _cut(body: Solid, piece: _Piece, what: str) -> Solid:
    tool = to_manifold(piece.vertices, piece.faces, "a part of the lumens")
    return solid_from_manifold(subtract(solid_manifold(body, "the body"), [tool]), what)


def _with_rest(cut: Solid, tool: Solid, near: Mask, piece: _Piece) -> Solid | None:
    """The cut body, opened at the fans, with the rest of the tool; None where they don't fit."""
    known = np.full(len(tool.vertices), -1, dtype=np.int64)
    closing = _opened(cut, tool, piece, known)
    if closing is None:
        return None
    rest, kept = tool.faces[~near].astype(np.int64), cut.faces[~closing].astype(np.int64)
    fresh = _used(rest, len(known)) & (known < 0)
    known[fresh] = len(cut.vertices) + np.arange(int(fresh.sum()))
    faces = np.concatenate([kept, known[rest][:, ::-1]])
    vertices = np.concatenate([cut.vertices, tool.vertices[fresh]])
    used = _used(faces, len(vertices))
    vertices, faces = vertices[used], (np.cumsum(used) - 1)[faces]
    if not is_closed(faces):
        return None
    new = np.arange(len(faces)) < len(kept)
    if len(find_new_crossings(vertices, faces, new).pairs):
        return None
    return Solid(vertices, faces.astype(np.int32), uncrossed=tool.uncrossed)


def _used(faces: IntArray, count: int) -> Mask:
    """Which of ``count`` vertices are corners of ``faces`` (m, 3)."""
    used = np.zeros(count, dtype=np.bool_)
    used[faces] = True
    return used


def _opened(cut: Solid, tool: Solid, piece: _Piece, known: IntArray) -> Mask | None:
    """Faces (m,) of the cut body that close a loop; None where a loop isn't whole.

    The numbers of the loops' vertices are written into ``known``, by the tool's own.
    """
    number = {place: n for n, place in enumerate(_keys(cut.vertices))}
    closing = np.zeros(len(cut.faces), dtype=np.bool_)
    for loop, middle in zip(piece.loops, _keys(piece.middles), strict=True):
        around = [number.get(place, -1) for place in _keys(tool.vertices[loop])]
        if min(around) < 0:
            return None
        known[loop] = around
        own = np.zeros(len(cut.vertices), dtype=np.bool_)
        own[[*around, number.get(middle, around[0])]] = True
        closing |= own[cut.faces].all(axis=1)
    return closing


def _keys(places: FloatArray) -> list[bytes]:
    """Return the bytes of each place (n, 3) in float32; -0 is 0."""
    return [row.tobytes() for row in places.astype(np.float32) + np.float32(0.0)]
