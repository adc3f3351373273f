"""Read a tissue or its surface from a mesh file (STL, OBJ, PLY, 3MF), repaired if needed."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from design.errors import SolidError, TissueError
from design.geometry.surface import Surface, cut_short
from design.geometry.threemf_read import read_3mf
from design.tissue.repair import repair_surface
from design.tissue.spacing import SpacingRule
from design.tissue.surface import SizeLimits, check_size, tissue_from_surface
from design.tissue.tissue import Tissue
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray, IntArray

SUFFIXES: Final = (".stl", ".obj", ".ply", ".3mf")

_DECLARED: Final[dict[str, LengthUnit]] = {
    "micron": "um",
    "microns": "um",
    "millimeter": "mm",
    "millimeters": "mm",
    "centimeter": "cm",
    "centimeters": "cm",
    "meter": "m",
    "meters": "m",
    "inch": "in",
    "inches": "in",
}


def load_tissue(
    path: Path,
    unit: LengthUnit,
    *,
    limits: SizeLimits | None = None,
    spacing_mm: float | None = None,
    rule: SpacingRule | None = None,
) -> Tissue:
    """Read a tissue from an STL, OBJ, PLY or 3MF file; a mesh that can be mended is.

    Parameters
    ----------
    path : Path
    unit : {"um", "mm", "cm", "m", "in"}
        Of the file's coordinates; files of meshes don't say, and it is never guessed.
    limits, spacing_mm, rule
        As in `tissue_from_surface`.

    Returns
    -------
    Tissue
        Its notes say what was mended.

    Raises
    ------
    TissueError
        When the file is missing, unreadable, declares another unit, or its mesh can't be used.
    """
    surface, notes = load_surface(path, unit, limits=limits)
    try:
        return tissue_from_surface(
            surface.vertices,
            surface.faces,
            limits=limits,
            spacing_mm=spacing_mm,
            rule=rule,
            notes=notes,
        )
    except TissueError as error:
        raise TissueError(f"{path}: {error}") from error


def load_surface(
    path: Path, unit: LengthUnit, *, limits: SizeLimits | None = None
) -> tuple[Surface, tuple[str, ...]]:
    """Read a closed surface, in mm, and what was mended on it.

    Raises
    ------
    TissueError
        As `load_tissue`.
    """
    path = Path(path)
    check_file(path, unit, SUFFIXES)
    vertices, faces, units, left_out = _read(path)
    declared = _DECLARED.get(units)
    if declared is not None and declared != unit:
        raise TissueError(f"{path} declares its unit as {declared}, not {unit}; state that unit")
    try:
        check_size(vertices[np.unique(faces)], unit, limits or SizeLimits())
        mended, notes = repair_surface(vertices, faces, unit)
    except TissueError as error:
        raise TissueError(f"{path}: {error}") from error
    surface = Surface(mended.vertices * MM_PER[unit], mended.faces)
    return surface, tuple(f"{path.name}: {note}" for note in (*left_out, *notes))


def check_file(path: Path, unit: LengthUnit, suffixes: tuple[str, ...]) -> None:
    """Raise `TissueError` for an unknown unit or suffix, or a file that isn't there."""
    if unit not in MM_PER:
        raise TissueError(f"unit {unit!r} of {path} isn't one of {', '.join(MM_PER)}")
    if path.is_dir():
        raise TissueError(f"{path} is a folder; give a file, one of {', '.join(suffixes)}")
    if not path.name.lower().endswith(suffixes):
        raise TissueError(
            f"{path}: {path.suffix or 'no suffix'} isn't one of {', '.join(suffixes)}"
        )
    if not path.is_file():
        raise TissueError(f"{path}: there is no such file")


def _read(path: Path) -> tuple[FloatArray, IntArray, str, tuple[str, ...]]:
    """Vertices, faces, the unit that the file says or nothing, and what of it was left out."""
    if path.suffix.lower() == ".3mf":
        try:
            read = read_3mf(path)
        except SolidError as error:
            raise TissueError(str(error)) from error
        return read.vertices, read.faces, read.unit, read.notes
    import trimesh  # heavy, and few who name a tissue read one

    if path.suffix.lower() == ".stl" and (missing := cut_short(path)):
        raise TissueError(f"{path}: {missing}; export or copy it again")
    # trimesh's readers raise whatever their parsers do, KeyError and struct.error included.
    try:
        mesh = trimesh.load_mesh(path, process=False)
    except Exception as error:
        # An STL that isn't binary asks for what tells a text's encoding, which isn't installed.
        why = "neither binary nor plain text" if isinstance(error, ImportError) else error
        raise TissueError(f"{path}: can't be read as a mesh ({why}); export it again") from error
    if not isinstance(mesh, trimesh.Trimesh) or len(mesh.faces) == 0:
        raise TissueError(f"{path}: mesh is empty: it has no faces; give a closed surface")
    vertices = np.asarray(mesh.vertices, dtype=np.float64)
    faces = np.asarray(mesh.faces, dtype=np.int64).reshape(-1, 3)
    return vertices, faces, str(mesh.units or ""), ()
