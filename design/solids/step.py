"""Write STEP files of lumens, or a body without them: exact cylinders, cones and balls.

Needs the extra ``step`` (netgen-mesher, LGPL-2.1, which brings Open CASCADE). Its union of round
bodies is a thousand times slower than one of triangles, and loses a part now and then where faces
touch. So pieces are united in an order in which neighbours meet, each union's volume is bounded by
its parts', the whole is held against the surface of `lumen_solid`, and the file is read back.

15 vessels take 0.4 s, 100 take 8 s, 250 take 22 s; above `MOST_PIECES` it is refused.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

import numpy as np

from design.errors import SolidError
from design.files import atomic_replacement
from design.network import VesselNetwork
from design.solids.bodies import cylinder_solid
from design.solids.construct import Vector, block_solid, construct_solid
from design.solids.lumen import lumen_solid
from design.solids.solid import Solid
from design.solids.step_pieces import Piece, step_pieces
from kernels.arrays import IntArray

Dimple = tuple[Vector, float]
"""A ball's centre and its diameter, mm."""

MOST_PIECES: Final = 500
"""Frusta and balls; some 300 straight vessels, a MB for every 40 pieces."""

VOLUME_WITHIN: Final = 2e-3
"""Between the exact bodies and the triangles, as a share of the lumens' volume."""

_ROUNDING: Final = 1e-6
"""Of a union's volume over the bounds that its parts set."""


@dataclass(frozen=True)
class StepBody:
    """What lumens are cut out of.

    Attributes
    ----------
    shape : "block" or "cylinder"
        A cylinder stands on its lowest z, around the middle of the box, as wide as its x.
    low, high : (3,) floats, mm
        Opposite corners of the box around it.
    """

    shape: Literal["block", "cylinder"]
    low: tuple[float, float, float]
    high: tuple[float, float, float]


@dataclass(frozen=True)
class StepCheck:
    """A STEP file as it was read back.

    Attributes
    ----------
    file : str
    solids, faces : int
    volume : float, mm³
        Of the file's bodies.
    mesh_volume : float, mm³
        Of the triangles it was held against.
    """

    file: str
    solids: int
    faces: int
    volume: float
    mesh_volume: float


def write_step(
    path: Path,
    network: VesselNetwork,
    *,
    body: StepBody | None = None,
    dimples: Sequence[Dimple] = (),
    extend_ends_mm: float = 0.0,
    extend_nodes: IntArray | None = None,
) -> StepCheck:
    """Write a network's lumens, or ``body`` without them, as STEP, and read the file back.

    Straight pieces are cylinders or cones; junctions, bends and free ends are filled by balls a
    thousandth smaller than the vessel (as large ones would touch it along a circle), unless a free
    end is drawn out and cut flat. A curved vessel is parted into straight pieces no farther than a
    fiftieth of its radius from its axis. Seams are sharp. The same network gives the same
    geometry; the file holds the date.

    Parameters
    ----------
    path : Path
    network : VesselNetwork
    body : StepBody, optional
    dimples : sequence of (centre (3,) mm, diameter mm)
        Balls that are cut out of ``body`` too.
    extend_ends_mm, extend_nodes
        As `lumen_solid` has them.

    Raises
    ------
    SolidError
        Extra not installed, too many pieces, or a union that Open CASCADE doesn't get right.
    OSError
        When the file can't be written.
    """
    occ = load_occ()
    pieces = step_pieces(network, extend_ends_mm, extend_nodes)
    if len(pieces) > MOST_PIECES:
        raise SolidError(
            f"{path}: {len(pieces)} cylinders, cones and balls are more than the {MOST_PIECES} "
            "that STEP is sensible for (minutes to unite, files that few programs open); write "
            "STL, 3MF or PLY, or a part of the network"
        )
    lumen = lumen_solid(network, extend_ends_mm=extend_ends_mm, extend_nodes=extend_nodes)
    mesh = lumen if body is None else construct_solid(_body_mesh(body), lumen, dimples)
    allowed = VOLUME_WITHIN * lumen.volume_mm3
    marks = [Piece(np.asarray(at), np.asarray(at), wide / 2, wide / 2) for at, wide in dimples]
    shape = _made(occ, pieces, (body, marks), mesh.volume_mm3, allowed, path)
    with atomic_replacement(path) as draft:
        shape.WriteStep(str(draft))
        check = _read_back(occ, draft, path.name, mesh.volume_mm3)
        _require_same(check, allowed)
    return check


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


def _body_mesh(body: StepBody) -> Solid:
    """The body as triangles."""
    low, high = np.array(body.low), np.array(body.high)
    if body.shape == "block":
        return block_solid(high - low, low)
    foot = np.array([*(0.5 * (low + high))[:2], low[2]])
    return cylinder_solid(float(high[0] - low[0]), float(high[2] - low[2])).moved(foot)


def _made(
    occ: Any,
    pieces: list[Piece],
    around: tuple[StepBody | None, list[Piece]],
    volume: float,
    allowed: float,
    path: Path,
) -> Any:
    """The shape, by halves or else piece after piece; one order may do where another fails."""
    (body, marks), volumes = around, []
    for in_halves in (True, False):
        try:
            parts = [_shape(occ, piece) for piece in pieces]
            shape = _in_halves(parts) if in_halves else occ.Fuse(parts)
            if body is not None:
                shape = _body(occ, body) - shape
                for mark in marks:
                    shape = shape - _shape(occ, mark)
        except occ.OCCException as exc:
            raise SolidError(f"{path}: Open CASCADE can't unite the vessels: {exc}") from exc
        volumes.append(float(shape.mass))
        if abs(volumes[-1] - volume) <= allowed:
            return shape
    raise SolidError(
        f"{path}: Open CASCADE's union has {volumes[0]:.6g} and {volumes[1]:.6g} mm³ by two "
        f"orders of work, but the triangles have {volume:.6g}: it lost a part; write STL or 3MF"
    )


def _in_halves(parts: list[Any]) -> Any:
    """Union by halves of the list, whose neighbours meet; much faster than one by one."""
    if len(parts) == 1:
        return parts[0]
    one, two = _in_halves(parts[: len(parts) // 2]), _in_halves(parts[len(parts) // 2 :])
    least, most = max(one.mass, two.mass), one.mass + two.mass
    both = one + two
    if not least * (1 - _ROUNDING) <= both.mass <= most * (1 + _ROUNDING):
        both = two + one
    return both


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


def _body(occ: Any, body: StepBody) -> Any:
    if body.shape == "block":
        return occ.Box(occ.Pnt(*body.low), occ.Pnt(*body.high))
    x, y = (0.5 * (body.low[axis] + body.high[axis]) for axis in (0, 1))
    foot, radius = occ.Pnt(x, y, body.low[2]), 0.5 * (body.high[0] - body.low[0])
    return occ.Cylinder(foot, occ.Z, r=radius, h=body.high[2] - body.low[2])


def _read_back(occ: Any, path: Path, name: str, mesh_volume: float) -> StepCheck:
    shape = occ.OCCGeometry(str(path)).shape
    solids = shape.solids
    volume = float(sum(solid.mass for solid in solids))
    return StepCheck(name, len(solids), len(shape.faces), volume, mesh_volume)


def _require_same(check: StepCheck, allowed: float) -> None:
    if check.solids < 1 or abs(check.volume - check.mesh_volume) > allowed:
        raise SolidError(
            f"{check.file}: read back, it holds {check.solids} bodies of {check.volume:.6g} mm³, "
            f"but {check.mesh_volume:.6g} were meant; write STL or 3MF"
        )
