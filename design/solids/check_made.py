"""Check a solid just made, and whether a file written of it holds exactly its triangles."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from design.errors import SolidError
from design.geometry.crossings import find_crossings
from design.geometry.threemf_read import read_3mf
from design.solids.check_result import SolidCheck
from design.solids.merge import merge_equal
from design.solids.solid import Solid
from design.solids.stl import read_float32
from design.solids.topology import edge_faults, surface_genus


def held_solid(path: Path, made: Sequence[Solid]) -> int | None:
    """Number of the solid whose triangles a file holds, in order, to the last bit; None without.

    Binary STL and 3MF; other formats aren't read.

    Raises
    ------
    OSError
        When the file can't be opened.
    """
    kind = path.suffix.lower()
    if kind == ".stl":
        corners = read_float32(path)
        return None if corners is None else _first(made, lambda one: _has_corners(one, corners))
    if kind != ".3mf":
        return None
    try:
        read = read_3mf(path)
    except SolidError:
        return None
    if read.unit != "millimeter" or read.notes:
        return None
    return _first(
        made,
        lambda one: (
            np.array_equal(read.vertices, one.vertices) and np.array_equal(read.faces, one.faces)
        ),
    )


def _first(made: Sequence[Solid], holds: Callable[[Solid], bool]) -> int | None:
    return next((number for number, solid in enumerate(made) if holds(solid)), None)


def _has_corners(solid: Solid, corners: NDArray[np.float32]) -> bool:
    """Whether ``corners`` (m, 3, 3) are those of the solid's faces."""
    if len(corners) != len(solid.faces):
        return False
    places = solid.vertices.astype(np.float32)
    return all(np.array_equal(corners[:, k], places[solid.faces[:, k]]) for k in range(3))


def check_made(solid: Solid) -> SolidCheck | None:
    """What `validate_file` finds in a file that holds ``solid``; None where anything is wrong.

    A reader merges equal corners. Where the solid's vertices are different places, that gives its
    own faces back, and where each edge has two faces that run along it in opposite directions,
    trimesh finds them watertight and wound alike and manifold3d takes them: those are its rules.
    What fails is checked from the file itself, by all three.
    """
    if len(merge_equal(solid.vertices)[0]) != len(solid.vertices):
        return None
    volume = solid.volume_mm3
    if not volume > 0.0 or edge_faults(solid.faces):
        return None
    genus, shells = surface_genus(solid.faces)
    crossing = 0 if solid.uncrossed else len(find_crossings(solid.vertices, solid.faces).faces)
    return SolidCheck(
        file="",
        vertices=int(np.count_nonzero(np.bincount(solid.faces.ravel()))),
        faces=len(solid.faces),
        watertight=True,
        oriented=True,
        manifold=True,
        volume=volume,
        genus=genus,
        shells=shells,
        open_edges=0,
        wrong_edges=0,
        crossing_faces=crossing,
    )
