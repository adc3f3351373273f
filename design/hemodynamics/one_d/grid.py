"""Divide vessels into finite-volume cells with rest areas and wall stiffness, for 1D flow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from design.hemodynamics.one_d.options import OneDOptions
from design.hemodynamics.one_d.tube_law import external_pressure, stiffness, wall_drag
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray


class Grid(NamedTuple):
    """What stays: cells of equal length in each vessel, their rest state and their wall.

    Attributes
    ----------
    offset : (v + 1,) int64
        Cells of vessel ``k`` are ``offset[k]:offset[k + 1]``, its faces
        ``offset[k] + k:offset[k + 1] + k + 1``.
    cell : (v,) float64, mm
    area : (n,) float64, mm²
        At rest, the mean over the cell.
    root : (n,) float64, 1/mm
        1/√area.
    stiffness : (n,) float64, Pa
    friction : (n,) float64, mm²/s
        Momentum's loss over Q/A; holds the taper within the cell, so that a vessel's resistance
        at rest is the lumped one.
    face_area, face_stiffness : (n + v,) float64
    small_pressure, small_flow : (v,) float64
        Squares of what changes from cell to cell without being limited.
    alpha : (v,) float64
        The momentum's correction.
    external : (v,) float64, Pa
        Pressure outside each vessel.
    drag, face_drag : (n,), (n + v,) float64, Pa·s/mm
        γ √A: √A times a viscous wall's pressure over the area's rate.
    density : float, Pa·s²/mm²
    viscous : bool
        Whether a wall is.
    """

    offset: IntArray
    cell: FloatArray
    area: FloatArray
    root: FloatArray
    stiffness: FloatArray
    friction: FloatArray
    face_area: FloatArray
    face_stiffness: FloatArray
    small_pressure: FloatArray
    small_flow: FloatArray
    alpha: FloatArray
    external: FloatArray
    drag: FloatArray
    face_drag: FloatArray
    density: float
    viscous: bool

    @property
    def vessel_of_cell(self) -> IntArray:
        """Vessel of each cell, (n,)."""
        return np.repeat(np.arange(len(self.cell)), np.diff(self.offset))

    def middles(self) -> FloatArray:
        """Middle of each cell as a share of its vessel's length, (n,)."""
        counts = np.diff(self.offset)
        within = np.arange(self.offset[-1]) - np.repeat(self.offset[:-1], counts)
        return np.asarray((within + 0.5) / np.repeat(counts, counts))


def make_grid(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    options: OneDOptions,
    period_s: float,
    speed: FloatArray,
) -> Grid:
    """Cut vessels into cells.

    Parameters
    ----------
    network, conditions, options
    period_s : float, s
    speed : (v,) float64, mm/s
        Pulse wave velocity at rest.
    """
    lengths = network.lengths()
    wanted = options.cell_mm
    if wanted is None:
        wanted = speed * period_s / options.cells_per_period
    counts = np.maximum(options.least_cells, np.ceil(lengths / wanted - 1e-9)).astype(np.int64)
    offset = np.concatenate([[0], np.cumsum(counts)])
    cells, faces = np.empty((3, offset[-1])), np.empty(offset[-1] + len(counts))
    _measure(np.ascontiguousarray(network.points), np.asarray(network.radius), network.offset,
             offset, cells, faces)  # fmt: skip
    square, cube, steep = cells
    vessel = np.repeat(np.arange(len(counts)), counts)
    at_face = np.repeat(np.arange(len(counts)), counts + 1)
    area = np.pi * square
    rubbing = options.friction(len(counts), conditions.viscosity_pa_s, conditions.density)
    nothing = np.zeros(len(counts))
    wall, phi = conditions.wall, options.wall_viscosity_pa_s
    face_area = np.pi * faces**2
    stiff = stiffness(network, wall, vessel, square, cube)
    face_stiff = stiffness(network, wall, at_face, faces**2, faces**3)
    drag = wall_drag(wall, phi, vessel, stiff, area)
    return Grid(
        offset=offset,
        cell=lengths / counts,
        area=area,
        root=1.0 / np.sqrt(area),
        stiffness=stiff,
        friction=rubbing[vessel] * steep * square**2,
        face_area=face_area,
        face_stiffness=face_stiff,
        small_pressure=nothing,
        small_flow=nothing,
        alpha=options.momentum_alpha(len(counts)),
        external=external_pressure(wall, len(counts)),
        drag=drag,
        face_drag=wall_drag(wall, phi, at_face, face_stiff, face_area),
        density=conditions.density,
        viscous=bool(drag.any()),
    )


@jit
def _measure(
    points: FloatArray,
    radius: FloatArray,
    offset: IntArray,
    cell_offset: IntArray,
    cells: FloatArray,
    faces: FloatArray,
) -> None:
    """Means of r², r³ and r⁻⁴ over each cell (3, n), exact for linear tapers; radius at faces."""
    for vessel in range(len(offset) - 1):
        first, last = offset[vessel], offset[vessel + 1] - 1
        whole = 0.0
        for k in range(first, last):
            whole += _length(points, k)
        count = cell_offset[vessel + 1] - cell_offset[vessel]
        size = whole / count
        k, begun, piece = first, 0.0, _length(points, first)
        for cell in range(cell_offset[vessel], cell_offset[vessel + 1]):
            i = cell - cell_offset[vessel]
            at, end = i * size, (i + 1) * size
            faces[cell + vessel] = _radius_at(radius, k, piece, at - begun)
            s2, s3, s4 = 0.0, 0.0, 0.0
            while True:
                stop = min(end, begun + piece)
                if k == last - 1:
                    stop = end
                span = stop - at
                if span > 0.0:
                    a = _radius_at(radius, k, piece, at - begun)
                    b = _radius_at(radius, k, piece, stop - begun)
                    second, ab = (a * a + a * b + b * b) / 3.0, a * b
                    s2 += span * second
                    s3 += span * (a + b) * (a * a + b * b) / 4.0
                    s4 += span * second / (ab * ab * ab)
                at = stop
                if stop >= end:
                    break
                begun += piece
                k += 1
                piece = _length(points, k)
            cells[0, cell], cells[1, cell], cells[2, cell] = s2 / size, s3 / size, s4 / size
        faces[cell_offset[vessel + 1] + vessel] = radius[last]


@jit
def _length(points: FloatArray, k: int) -> float:
    square = 0.0
    for axis in range(3):
        square += (points[k + 1, axis] - points[k, axis]) ** 2
    return np.sqrt(square)


@jit
def _radius_at(radius: FloatArray, k: int, piece: float, along: float) -> float:
    share = min(max(along / piece, 0.0), 1.0) if piece > 0.0 else 0.0
    return radius[k] + share * (radius[k + 1] - radius[k])
