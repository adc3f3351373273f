"""Divide vessels into finite-volume cells with rest areas and wall stiffness, for 1D flow."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from design.errors import FlowError
from design.hemodynamics.one_d.options import OneDOptions
from design.hemodynamics.vessel_coefficients import (
    GelWall,
    ThinWall,
    VesselWalls,
    Wall,
    integral_of_power,
)
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


# Compute wall stiffness K of vessels for the 1D tube law p = K (√(A/A₀) - 1).
#
# Both walls give a widening in proportion to the pressure, so both have this law, and it has the
# compliance dA/dp = 2 A₀/K at rest that the lumped model has:
#
# - thin wall: hoop stress p r/h = E ε/(1 - ν²) with ε = r/r₀ - 1, its lever taken at rest, gives
#   K = E h/((1 - ν²) r₀); with ν = ½ this is β(√A - √A₀)/A₀, β = (4/3)√π E h (Formaggia, Lamponi &
#   Quarteroni 2003, doi 10.1023/B:ENGI.0000007980.01347.29);
# - lumen in thick gel: Lamé's displacement u = p r₀ (1 + ν)/E gives K = E/(1 + ν), whatever the
#   radius. It is for small strains: an incompressible neo-Hookean gel, p = G (ln λ + ½ (1 - λ⁻²))
#   with λ = r/r₀ and G = E/3, has the same slope 2G = E/(1 + ν) at rest and is softer by the share
#   λ - 1 when it is wider by that share.
#
# The pulse wave velocity is c = √(A/ϱ dp/dA) = √((K + p)/(2ϱ)).
#
# A Kelvin-Voigt wall adds φ dε/dt to its stress E ε (of the gel: to its shear stress), which makes
# K ε into K (ε + τ dε/dt) with τ = φ/E: a pressure γ ∂A/∂t with γ = K τ/(2√(A A₀)); for the thin
# wall (2/3)√π φ h/(A₀ √A), as in Alastruey et al. 2011, doi 10.1016/j.jbiomech.2011.05.041. Where a
# wall's Γ is given instead, γ = Γ/(A₀ √A).


def check_compliant(network: VesselNetwork, wall: Wall) -> FloatArray:
    """Compliance of each vessel, (v,), µL/Pa.

    Raises
    ------
    FlowError
        For a wall that gives way nowhere, or not in some vessel.
    """
    compliance = wall.compliance(network)
    rigid = np.flatnonzero(~(compliance > 0.0))
    if len(rigid):
        raise FlowError(
            f"vessel {int(rigid[0])} has a rigid wall ({len(rigid)} of {network.vessel_count}), "
            "in which a wave has no finite speed; give the wall's modulus (wall_young_kpa), or "
            "solve it in 0D"
        )
    return compliance


def stiffness(
    network: VesselNetwork, wall: Wall, vessel: np.ndarray, square: FloatArray, cube: FloatArray
) -> FloatArray:
    """K of pieces of vessels, (n,), Pa.

    Parameters
    ----------
    network : VesselNetwork
    wall : Wall
        One that isn't known here has one stiffness a vessel, by its compliance.
    vessel : (n,) int64
        That each piece belongs to.
    square, cube : (n,) float64, mm², mm³
        Mean of the radius' powers over the piece (at a point, its powers).
    """
    if isinstance(wall, GelWall):
        return np.full(len(square), wall.young_pa / (1.0 + wall.poisson))
    if isinstance(wall, VesselWalls):
        return wall.stiffness(vessel, cube / square)
    if isinstance(wall, ThinWall):
        plate = wall.young_pa * wall.thickness_mm / (1.0 - wall.poisson**2)
        return plate * square / cube
    whole = 2.0 * np.pi * integral_of_power(network, 2) / check_compliant(network, wall)
    return np.asarray(whole[vessel])


def external_pressure(wall: Wall, vessels: int) -> FloatArray:
    """Pressure outside each vessel, (v,), Pa; 0 of walls that know none."""
    if isinstance(wall, VesselWalls):
        return np.array(wall.external_pa)
    return np.zeros(vessels)


def relaxation_time(wall: Wall, wall_viscosity_pa_s: float) -> float:
    """τ = φ/E of a Kelvin-Voigt wall, s.

    Raises
    ------
    FlowError
        For a viscous wall whose modulus isn't known.
    """
    if wall_viscosity_pa_s == 0.0:
        return 0.0
    if isinstance(wall, GelWall | ThinWall):
        return wall_viscosity_pa_s / wall.young_pa
    raise FlowError("wall_viscosity_pa_s needs a thin wall or a gel, whose modulus is known")


def wall_drag(
    wall: Wall, wall_viscosity_pa_s: float, vessel: IntArray, stiff: FloatArray, area: FloatArray
) -> FloatArray:
    """Return γ √A of pieces of vessels, (n,), Pa·s/mm: K τ/(2 √A₀), or Γ/A₀.

    Parameters
    ----------
    wall : Wall
    wall_viscosity_pa_s : float, Pa·s
        φ of a thin wall or a gel.
    vessel : (n,) int64
    stiff, area : (n,) float64
        K, Pa, and A₀, mm².

    Raises
    ------
    FlowError
        As `relaxation_time`.
    """
    drag = stiff * relaxation_time(wall, wall_viscosity_pa_s) / (2.0 * np.sqrt(area))
    if isinstance(wall, VesselWalls):
        drag += wall.damping(vessel, np.sqrt(area / np.pi)) / area
    return np.asarray(drag)
