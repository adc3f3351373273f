"""Read a closed solid from a mesh file (STL, 3MF, PLY, OBJ, OFF), in mm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from design.errors import SolidError
from design.geometry.surface import cut_short
from design.geometry.threemf_read import read_3mf
from design.solids.manifolds import sections_solid
from design.solids.solid import Solid
from design.solids.topology import merge_equal
from design.solids.write import read_corners
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh


SUFFIXES: Final = (".stl", ".3mf", ".ply", ".obj", ".off")
_MM_OF_3MF: Final = {
    "micron": 1e-3,
    "millimeter": 1.0,
    "centimeter": 10.0,
    "inch": 25.4,
    "foot": 304.8,
    "meter": 1000.0,
}
"""Millimetres of 3MF's units, as it spells them."""


def read_solid(path: Path, unit: LengthUnit | None, *, for_sections: bool = False) -> Solid:
    """Read a closed mesh whose coordinates are in ``unit``.

    Parameters
    ----------
    path : Path
        STL, 3MF, PLY, OBJ or OFF.
    unit : "um", "mm", "cm", "m" or "in"
        None only for 3MF, which says it; where both do they must agree.
    for_sections : bool
        Leave touching sheets and crossing faces as they are; see `sections_solid`.

    Returns
    -------
    Solid
        In mm.

    Raises
    ------
    SolidError
        Unknown or unreadable format, no or contradicting unit, surface not closed and oriented;
        with the file.
    OSError
        When the file can't be opened.
    """
    corners = read_corners(path) if path.suffix.lower() == ".stl" and unit is not None else None
    if corners is not None and unit is not None:
        corners *= MM_PER[unit]
        faces = np.arange(3 * len(corners)).reshape(-1, 3)
        return _solid(corners.reshape(-1, 3), faces, path, for_sections)
    if path.suffix.lower() == ".3mf" and path.is_file():
        read = read_3mf(path)
        scale = _MM_OF_3MF.get(read.unit)
        if scale is None:
            raise SolidError(
                f"{path}: the file's unit is {read.unit}, which isn't read; export it in one of "
                f"{', '.join(_MM_OF_3MF)}"
            )
        if unit is not None and MM_PER[unit] != scale:
            raise SolidError(f"{path}: the file says {read.unit}, not {unit}; leave the unit out")
        solid = _solid(read.vertices * scale, read.faces, path, for_sections)
        return replace(solid, notes=tuple(f"{path.name}: {note}" for note in read.notes))
    mesh = load_mesh(path)
    if unit is None:
        raise SolidError(f"{path}: the file doesn't say its unit; give one of {', '.join(MM_PER)}")
    vertices = np.asarray(mesh.vertices) * MM_PER[unit]
    return _solid(vertices, np.asarray(mesh.faces), path, for_sections)


def _solid(vertices: FloatArray, faces: IntArray, path: Path, for_sections: bool) -> Solid:
    used = np.zeros(len(vertices), np.bool_)
    used[faces] = True
    bad = int((used & ~np.isfinite(vertices).all(axis=1)).sum())
    if bad:
        raise SolidError(f"{path}: {bad} corners aren't numbers (NaN or infinite); export it again")
    try:
        if for_sections:
            return sections_solid(vertices, faces)
        # Loads the kernels that mend a surface; sections need none of them.
        from design.solids.construct import solid_from_surface

        return solid_from_surface(vertices, faces)
    except SolidError as exc:
        raise SolidError(f"{path}: {exc}") from exc


def load_mesh(path: Path) -> trimesh.Trimesh:
    """Read the triangles of a file, equal vertices merged, in the file's unit.

    Raises
    ------
    SolidError
        Unknown or unreadable format, or no triangles.
    OSError
        When the file can't be opened.
    """
    import trimesh  # heavy: scipy's statistics, networkx; a binary STL needs none of it

    kind = path.suffix.lower()
    if path.is_dir():
        raise SolidError(f"{path} is a folder; give a file, one of {', '.join(SUFFIXES)}")
    if kind not in SUFFIXES:
        raise SolidError(f"{path}: {kind or 'no suffix'} isn't one of {', '.join(SUFFIXES)}")
    if kind == ".stl" and (missing := cut_short(path)):
        raise SolidError(f"{path}: {missing}; export or copy it again")
    if kind == ".3mf":
        read = read_3mf(path)
        return _merged(trimesh.Trimesh(read.vertices, read.faces, process=False))
    if kind == ".stl" and (corners := read_corners(path)) is not None:
        mesh = trimesh.Trimesh(
            corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3), process=False
        )
        return _merged(mesh)
    with path.open("rb") as handle:
        try:
            mesh = trimesh.load_mesh(handle, file_type=kind[1:], process=False)
        except (OSError, MemoryError):
            raise
        except Exception as exc:  # trimesh and lxml raise what they like for a damaged file
            name = type(exc).__name__
            raise SolidError(
                f"{path}: not a readable {kind[1:].upper()} file ({name}: {exc})"
            ) from exc
    if isinstance(mesh, trimesh.Scene):
        mesh = mesh.to_mesh()
    if len(mesh.faces) == 0:
        raise SolidError(f"{path}: no triangles in the file; export the surface again")
    if mesh.faces.min() < 0 or mesh.faces.max() >= len(mesh.vertices):
        raise SolidError(
            f"{path}: a triangle names a corner that isn't there (of {len(mesh.vertices)}); export "
            "the surface again"
        )
    return _merged(mesh)


def _merged(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """Merge vertices that are equal, and those only: trimesh's own merging rounds to 1e-8."""
    import trimesh  # as above

    unique, index = merge_equal(np.asarray(mesh.vertices, dtype=np.float64))
    return trimesh.Trimesh(unique, index[np.asarray(mesh.faces)], process=False)
