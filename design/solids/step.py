"""Write a STEP file of a network's lumens: exact cylinders, cones and balls, united.

Needs the extra ``step`` (netgen-mesher, LGPL-2.1, which brings Open CASCADE). Open CASCADE's union
loses a part now and then where faces touch, so its volume is held against `lumen_solid`'s.

15 vessels take 0.5 s, 100 take 14 s, 250 take 78 s; above `MOST_PIECES` it is refused.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.errors import SolidError
from design.files import atomic_replacement
from design.network import VesselNetwork
from design.solids.lumen import lumen_solid
from design.solids.step_pieces import Piece, step_pieces

MOST_PIECES: Final = 500
"""Frusta and balls; some 300 straight vessels, a MB for every 40 pieces."""

VOLUME_WITHIN: Final = 2e-3
"""Between the exact bodies and the triangles, as a share of the lumens' volume."""


@dataclass(frozen=True)
class StepCheck:
    """What a STEP file holds.

    Attributes
    ----------
    file : str
    solids, faces : int
    volume : float, mm³
        Of the exact bodies.
    mesh_volume : float, mm³
        Of the triangles it was held against.
    """

    file: str
    solids: int
    faces: int
    volume: float
    mesh_volume: float


def write_step(path: Path, network: VesselNetwork) -> StepCheck:
    """Write a network's lumens as STEP.

    Straight pieces are cylinders or cones; junctions, bends and free ends are filled by balls a
    thousandth smaller than the vessel (as large ones would touch it along a circle). A curved
    vessel is parted into straight pieces no farther than a fiftieth of its radius from its axis.
    Seams are sharp. The same network gives the same geometry; the file holds the date.

    Raises
    ------
    SolidError
        Extra not installed, too many pieces, or a union that Open CASCADE doesn't get right.
    OSError
        When the file can't be written.
    """
    occ = load_occ()
    pieces = step_pieces(network)
    if len(pieces) > MOST_PIECES:
        raise SolidError(
            f"{path}: {len(pieces)} cylinders, cones and balls are more than the {MOST_PIECES} "
            "that STEP is sensible for (minutes to unite, files that few programs open); write "
            "STL, 3MF or PLY, or a part of the network"
        )
    try:
        shape = occ.Fuse([_shape(occ, piece) for piece in pieces])
    except occ.OCCException as exc:
        raise SolidError(f"{path}: Open CASCADE can't unite the vessels: {exc}") from exc
    meant, volume = lumen_solid(network).volume_mm3, float(shape.mass)
    if not abs(volume - meant) <= VOLUME_WITHIN * meant:
        raise SolidError(
            f"{path}: Open CASCADE's union has {volume:.6g} mm³, but the triangles have "
            f"{meant:.6g}: it lost a part; write STL or 3MF"
        )
    with atomic_replacement(path) as draft:
        shape.WriteStep(str(draft))
    return StepCheck(path.name, len(shape.solids), len(shape.faces), volume, meant)


def load_occ() -> Any:
    """The module that speaks to Open CASCADE.

    Raises
    ------
    SolidError
        When the extra isn't installed.
    """
    try:
        # Heavy and optional, so it isn't imported with the package.
        from netgen import occ
    except ImportError as exc:
        raise SolidError(
            "STEP needs Open CASCADE, which isn't installed (netgen-mesher, 34 MB); "
            "pip install 'printctl[step]', or write STL, 3MF, PLY, OBJ or VTP"
        ) from exc
    return occ


def _shape(occ: Any, piece: Piece) -> Any:
    start = occ.Pnt(*piece.start.tolist())
    if piece.is_ball:
        return occ.Sphere(start, piece.radius0)
    step = piece.end - piece.start
    length = float(np.linalg.norm(step))
    if abs(piece.radius1 - piece.radius0) <= 1e-9 * piece.radius0:
        return occ.Cylinder(start, occ.Dir(*step.tolist()), r=piece.radius0, h=length)
    axes = occ.gp_Ax2(start, occ.gp_Dir(*step.tolist()))
    return occ.Cone(axes, piece.radius0, piece.radius1, length, 2.0 * np.pi)
