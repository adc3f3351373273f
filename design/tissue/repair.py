"""Repair a tissue's triangle surface as far as is safe, and report the repairs.

A closed, consistently oriented surface whose faces don't pass through one another is handed on
untouched. Otherwise, in turn: duplicate faces are dropped, vertices next to one another merged
along open edges, edges split at vertices that lie on them, sheets left out, faces turned to agree
with their neighbours, small holes filled, shells that look inward turned, small places where a
shell passes through itself replaced, shells that overlap united. What is too large to be mended
without guessing is refused.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from design.errors import TissueError
from design.geometry.mesh import edges_of
from design.geometry.surface import Surface
from design.tissue.closed import (
    FaceArray,
    check_closed,
    enclosed_volume,
    format_points,
    merged_surface,
)
from design.tissue.mesh_repair.duplicates import drop_duplicates, weld_rims
from design.tissue.mesh_repair.holes import fill_holes
from design.tissue.mesh_repair.joints import split_joints
from design.tissue.mesh_repair.limits import LIMITS
from design.tissue.mesh_repair.orient import agree, turn_shells
from design.tissue.mesh_repair.sheets import drop_flat_faces, drop_sheets
from design.tissue.parts import crossing_faces, shells_of, unite_shells
from kernels.arrays import FloatArray


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
