"""Read a closed solid from a mesh file (STL, 3MF, PLY, OBJ, OFF), in mm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Final

import numpy as np

from design.errors import SolidError
from design.geometry.mesh import merge_equal
from design.geometry.mesh_files import read_mesh
from design.solids.manifolds import sections_solid
from design.solids.solid import Solid
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray, IntArray

if TYPE_CHECKING:
    import trimesh


MESHES_WITHOUT_UNIT: Final = (".stl", ".ply", ".obj", ".off")
SUFFIXES: Final = (*MESHES_WITHOUT_UNIT, ".3mf")
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
        None only for 3MF, which holds it; a given one must agree.
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
    read = read_mesh(path, SUFFIXES)
    if path.suffix.lower() != ".3mf":
        if unit is None:
            raise SolidError(
                f"{path}: the file doesn't say its unit; give one of {', '.join(MM_PER)}"
            )
        return _solid(read.vertices * MM_PER[unit], read.faces, path, for_sections)
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
    import trimesh  # heavy: scipy's statistics, networkx

    read = read_mesh(path, SUFFIXES)
    # Those that are equal, and those only: trimesh's own merging rounds to 1e-8.
    vertices, index = merge_equal(read.vertices)
    return trimesh.Trimesh(vertices, index[read.faces], process=False)
