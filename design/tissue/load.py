"""Read a tissue or its surface from a mesh file (STL, OBJ, PLY, 3MF), repaired if needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Final

import numpy as np

from design.errors import SolidError, TissueError
from design.geometry.mesh_files import read_mesh
from design.geometry.surface import Surface
from design.tissue.images import UNIT_NAMES, VolumeImage
from design.tissue.repair import repair_surface
from design.tissue.surface import SizeLimits, SpacingRule, check_size, tissue_from_surface
from design.tissue.tissue import (
    Demand,
    DepthDemand,
    FunctionDemand,
    ImageDemand,
    Tissue,
    check_values,
    checked_values,
)
from design.units import MM_PER, LengthUnit
from kernels.arrays import FloatArray

SUFFIXES: Final = (".stl", ".obj", ".ply", ".3mf")


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
        Of the file's coordinates; files of meshes hold no unit, and it is never guessed.
    limits, spacing_mm, rule
        As in `tissue_from_surface`.

    Returns
    -------
    Tissue
        Its notes list repairs.

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
    try:
        read = read_mesh(path, SUFFIXES)
    except SolidError as error:
        raise TissueError(str(error)) from error
    declared = UNIT_NAMES.get(read.unit)
    if declared is not None and declared != unit:
        raise TissueError(f"{path} declares its unit as {declared}, not {unit}; state that unit")
    try:
        check_size(read.vertices[np.unique(read.faces)], unit, limits or SizeLimits())
        mended, notes = repair_surface(read.vertices, read.faces, unit)
    except TissueError as error:
        raise TissueError(f"{path}: {error}") from error
    surface = Surface(mended.vertices * MM_PER[unit], mended.faces)
    return surface, tuple(f"{path.name}: {note}" for note in (*read.notes, *notes))


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


DEMAND_PROBES = 250_000
"""Quasi-random places in the bounding box, over which means and maxima are taken."""
R3_SEQUENCE_BASE = 1.2207440846057596
"""Root of x⁴ = x + 1: its inverse powers fill space evenly (Roberts 2018)."""
MAX_HEADROOM = 1.1
"""A function's greatest value is taken for at most this times the greatest at the probes."""
MIN_COVERED = 0.99
"""Least share of the tissue in a demand image: its rim may lie a little outside."""


def depth_demand(
    tissue: Tissue, depth_mm: Sequence[float], relative: Sequence[float]
) -> DepthDemand:
    """Demand by a table against the depth below the surface.

    Parameters
    ----------
    tissue : Tissue
    depth_mm : (k,) ascending, from 0 on
    relative : (k,) at least 0
        Demand there, in any unit.

    Raises
    ------
    TissueError
        When the table is impossible, or asks for nothing anywhere in the tissue.
    """
    depth, level = np.array(depth_mm, dtype=np.float64), np.array(relative, dtype=np.float64)
    if len(depth) != len(level) or len(depth) == 0:
        raise TissueError(
            f"demand has {len(depth)} depths and {len(level)} relative values; give as many"
        )
    if not np.isfinite(depth).all() or depth[0] < 0 or any(b <= a for a, b in pairwise(depth)):
        raise TissueError(f"demand: depths {depth.tolist()} mm don't ascend from 0 or more")
    check_values(level, "demand table")
    if not level.max() > 0:
        raise TissueError("demand is 0 at every depth; give some relative values above 0")
    table = DepthDemand(tissue.grid, depth, level / level.max())
    return DepthDemand(table.grid, table.depth_mm, table.level, _mean(table, tissue))


def image_demand(tissue: Tissue, image: VolumeImage) -> ImageDemand:
    """Demand by a volume image in the tissue's frame.

    Raises
    ------
    TissueError
        When values are negative or NaN, the image leaves tissue uncovered, or asks for nothing
        in it.
    """
    to_index: FloatArray = np.linalg.inv(image.affine).astype(np.float64)
    values = np.asarray(image.values, dtype=np.float64)
    check_values(values, "demand image")
    inside = _probes(tissue)
    index = inside @ to_index[:3, :3].T + to_index[:3, 3]
    covered = ((index >= -0.5) & (index <= np.array(values.shape) - 0.5)).all(axis=1).mean()
    if covered < MIN_COVERED:
        raise TissueError(
            f"demand image covers {100 * covered:.0f} % of the tissue, below "
            f"{100 * MIN_COVERED:.0f} %; give one in the tissue's frame (the same affine as the "
            "label image) that covers it"
        )
    greatest = float(values.max())
    if not greatest > 0:
        raise TissueError("demand image is 0 everywhere; give some values above 0")
    demand = ImageDemand(values / greatest, to_index)
    return ImageDemand(demand.values, to_index, _mean(demand, tissue))


def function_demand(
    tissue: Tissue,
    function: Callable[[FloatArray], FloatArray],
    greatest: float | None = None,
) -> FunctionDemand:
    """Demand by a function of points (n, 3), mm.

    Parameters
    ----------
    greatest : float, optional
        A bound that no value exceeds; by default a tenth more than the greatest found at some
        200,000 places in the bounding box. A bound too high costs time, not exactness.

    Raises
    ------
    TissueError
        When values are negative or NaN, or 0 throughout the tissue.
    """
    if greatest is None:
        greatest = MAX_HEADROOM * float(checked_values(function, _probes(tissue)).max(initial=0.0))
    if not (np.isfinite(greatest) and greatest > 0):
        raise TissueError(
            f"demand's greatest value is {greatest:g}; it must ask for something in the tissue"
        )
    demand = FunctionDemand(function, greatest)
    return FunctionDemand(function, greatest, _mean(demand, tissue))


def _probes(tissue: Tissue) -> FloatArray:
    """Places spread evenly over the tissue, (n, 3): an additive recurrence, always the same."""
    low, high = tissue.bounds
    step = R3_SEQUENCE_BASE ** -np.arange(1.0, 4.0)
    points = low + ((0.5 + np.arange(DEMAND_PROBES)[:, None] * step) % 1.0) * (high - low)
    return np.ascontiguousarray(points[tissue.contains(points)])


def _mean(demand: Demand, tissue: Tissue) -> float:
    """Mean weight over the tissue."""
    probes = _probes(tissue)
    mean = float(demand.weight(probes).mean()) if len(probes) else 0.0
    if not mean > 0:
        raise TissueError("demand is 0 throughout the tissue; check its frame and unit")
    return mean
