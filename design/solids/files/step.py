"""Write a STEP file of a network's lumens: exact cylinders, cones and balls, united.

Needs the extra ``step`` (netgen-mesher, LGPL-2.1, which brings Open CASCADE). Open CASCADE's union
loses a part now and then where faces touch, so its volume is compared with `lumen_solid`'s.

15 vessels take 0.5 s, 100 take 14 s, 250 take 78 s; above `MAX_PIECES` it is refused.
"""

from __future__ import annotations

from collections import defaultdict
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from design.errors import SolidError
from design.files import atomic_replacement
from design.network import VesselNetwork
from design.solids.lumen import lumen_solid
from design.solids.smooth.sewing import LIMITS
from design.solids.tube import Chain, Facets, split_runs
from kernels.arrays import FloatArray, IntArray

MAX_PIECES: Final = 500
"""Frusta and balls; some 300 straight vessels, a MB for every 40 pieces."""
VOLUME_TOLERANCE: Final = 2e-3
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
        Of the triangles it was compared with.
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
    if len(pieces) > MAX_PIECES:
        raise SolidError(
            f"{path}: {len(pieces)} cylinders, cones and balls are more than the {MAX_PIECES} "
            "that STEP is sensible for (minutes to unite, files that few programs open); write "
            "STL, 3MF or PLY, or a part of the network"
        )
    try:
        shape = occ.Fuse([_shape(occ, piece) for piece in pieces])
    except occ.OCCException as exc:
        raise SolidError(f"{path}: Open CASCADE can't unite the vessels: {exc}") from exc
    meant, volume = lumen_solid(network).volume_mm3, float(shape.mass)
    if not abs(volume - meant) <= VOLUME_TOLERANCE * meant:
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


MAX_OFF_AXIS = 0.02
"""Of the radius: how far a curved vessel's axis and radius may be from its straight pieces'."""


@dataclass(frozen=True)
class Piece:
    """A cylinder or cone between two points, or a ball where they are one.

    Attributes
    ----------
    start, end : (3,) float64, mm
    radius0, radius1 : float, mm
    """

    start: FloatArray
    end: FloatArray
    radius0: float
    radius1: float

    @property
    def is_ball(self) -> bool:
        """Whether it has no length."""
        return bool(np.array_equal(self.start, self.end))


def step_pieces(network: VesselNetwork) -> list[Piece]:
    """Return frusta of all vessels, and balls at junctions, bends and free ends.

    Each touches one before it: in other orders Open CASCADE's union loses most of some networks.
    """
    runs, _ = split_runs(network, Facets())
    runs = [simpler(run) for run in runs]
    at: dict[bytes, list[tuple[int, int]]] = defaultdict(list)
    for index, run in enumerate(runs):
        for end in (0, -1):
            at[_key(run.points[end])].append((index, end))
    widest = {key: max(float(runs[i].radius[e]) for i, e in ends) for key, ends in at.items()}
    pieces: list[Piece] = []
    filled: set[bytes] = set()
    for index, first in _walk(runs, at):
        run = runs[index] if first == 0 else runs[index].reversed()
        for k, (point, radius) in enumerate(zip(run.points, run.radius.tolist(), strict=True)):
            inner = 0 < k < len(run.points) - 1
            key = _key(point)
            if k:
                before = float(run.radius[k - 1])
                pieces.append(Piece(run.points[k - 1], point, before, radius))
            if inner or key not in filled:
                ball = LIMITS.clear_of_tubes * (radius if inner else widest[key])
                pieces.append(Piece(point, point, ball, ball))
                filled.add(key)
    return pieces


def _key(point: FloatArray) -> bytes:
    return (point + 0.0).tobytes()


def _walk(runs: list[Chain], at: dict[bytes, list[tuple[int, int]]]) -> list[tuple[int, int]]:
    """Every run and the end from which it is met, each at a run before it where there is one."""
    order: list[tuple[int, int]] = []
    seen: set[int] = set()
    for start in range(len(runs)):
        stack = [(start, 0)]
        while stack:
            index, end = stack.pop()
            if index in seen:
                continue
            seen.add(index)
            order.append((index, end))
            stack += reversed(
                at[_key(runs[index].points[-1 - end])] + at[_key(runs[index].points[end])]
            )
    return order


def simpler(run: Chain) -> Chain:
    """A polyline's points that are needed to stay near it, in place and in radius.

    Ramer, Douglas and Peucker: the farthest point is kept while it is too far.
    """
    kept = np.zeros(len(run.points), dtype=bool)
    kept[[0, -1]] = True
    stack = [(0, len(run.points) - 1)]
    while stack:
        first, last = stack.pop()
        inner = np.arange(first + 1, last)
        if len(inner) == 0:
            continue
        off = _off(run, first, last, inner)
        worst = int(np.argmax(off))
        if off[worst] > MAX_OFF_AXIS:
            kept[inner[worst]] = True
            stack += [(first, int(inner[worst])), (int(inner[worst]), last)]
    return Chain(run.points[kept], run.radius[kept], run.node[kept])


def _off(run: Chain, first: int, last: int, inner: IntArray) -> FloatArray:
    """How far inner points are from the cone between two others, over their radii."""
    step = run.points[last] - run.points[first]
    square = float(step @ step)
    away = run.points[inner] - run.points[first]
    share = np.clip(away @ step / square, 0.0, 1.0) if square > 0.0 else np.zeros(len(inner))
    gap = np.linalg.norm(away - share[:, None] * step, axis=1)
    radius = run.radius[first] + share * (run.radius[last] - run.radius[first])
    off: FloatArray = np.maximum(gap, np.abs(run.radius[inner] - radius)) / run.radius[inner]
    return off
