"""Options, cells and nodes of the 1D flow solver."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import (
    Outlet,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
    outlets_by_node,
)
from design.hemodynamics.probes import Probes
from design.hemodynamics.vessel_coefficients import (
    GelWall,
    ThinWall,
    VesselWalls,
    Wall,
    integral_of_power,
)
from design.hemodynamics.waveforms import Waveform
from design.hemodynamics.zero_d.boundary import (
    checked_ends,
    number_unknowns,
    refuse_supplies,
)
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray


@dataclass(frozen=True)
class OneDOptions:
    """Resolution, profile, wall viscosity and when to stop.

    The velocity profile is u(r) = U (ζ + 2)/ζ (1 - (r/R)^ζ), which fixes the momentum's
    correction α = (ζ + 2)/(ζ + 1) and the friction -2 (ζ + 2) π μ Q/(ϱ A) together: a parabola
    has ζ = 2, α = 4/3 and 8πμ; Boileau et al. 2015 (doi 10.1002/cnm.2732) take ζ = 9, α = 1.1
    and 22πμ for large arteries.

    Attributes
    ----------
    cell_mm : float or (v,) float64, optional
        Length of a cell, or of each vessel's; without it, what a wave runs in
        1/`cells_per_period` of a period.
    cells_per_period : int
        How finely a wave is resolved where ``cell_mm`` isn't given.
    least_cells : int
        In every vessel, however short; 2 or more.
    profile_exponent : float or (v,) float64
        ζ, 2 (Poiseuille's parabola) or more; one, or each vessel's.
    alpha : float, optional
        The momentum's correction, where it isn't to be the profile's.
    wall_viscosity_pa_s : float, Pa·s
        φ of a Kelvin-Voigt wall, stress E ε + φ dε/dt; 0 is an elastic wall.
    reflection : mapping of node to float
        Outlets that send this part of each pressure wave back, -1 (open) to 1 (closed), about
        the pressure that their `PressureOutlet` gives; 0 swallows what comes.
    courant : float
        Steps a wave may run in cells, up to 1.2.
    samples : int
        Of a cycle, in the results.
    tolerance : float
        A state is periodic when a cycle ends as it began, to this part of the swing.
    most_cycles : int
        After which it is given up.
    probes : Probes, optional
    """

    cell_mm: float | FloatArray | None = None
    cells_per_period: int = 800
    least_cells: int = 2
    profile_exponent: float | FloatArray = 2.0
    alpha: float | None = None
    wall_viscosity_pa_s: float = 0.0
    reflection: Mapping[int, float] = field(default_factory=dict)
    courant: float = 0.9
    samples: int = 100
    tolerance: float = 1e-4
    most_cycles: int = 60
    probes: Probes | None = None

    def __post_init__(self) -> None:
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            for one in () if value is None else np.atleast_1d(value).tolist():
                if not low <= one <= high:
                    raise FlowError(f"{name} is {one:g}; give {low:g} to {high:g}")
        for node, part in self.reflection.items():
            if not -1.0 <= part <= 1.0:
                raise FlowError(f"outlet {node} reflects {part:g} of a wave; give -1 to 1")

    def exponents(self, vessels: int) -> FloatArray:
        """ζ of each vessel, (v,)."""
        return np.array(np.broadcast_to(self.profile_exponent, vessels), dtype=np.float64)

    def momentum_alpha(self, vessels: int) -> FloatArray:
        """∫u² dA A/Q² of each vessel's profile, (v,)."""
        zeta = self.exponents(vessels)
        return (zeta + 2.0) / (zeta + 1.0) if self.alpha is None else np.full(vessels, self.alpha)

    def friction(self, vessels: int, viscosity_pa_s: float, density: float) -> FloatArray:
        """2 (ζ + 2) π μ/ϱ of each vessel, (v,), mm²/s: the momentum's loss is this times Q/A."""
        return 2.0 * (self.exponents(vessels) + 2.0) * np.pi * viscosity_pa_s / density


_LIMITS = (
    ("cell_mm", 1e-6, 1e6),
    ("cells_per_period", 10, 1e6),
    ("least_cells", 2, 1e6),
    ("profile_exponent", 2.0, 100.0),
    ("alpha", 1.0, 2.0),
    ("wall_viscosity_pa_s", 0.0, 1e9),
    ("courant", 0.01, 1.2),
    ("samples", 8, 100_000),
    ("tolerance", 1e-12, 0.1),
    ("most_cycles", 1, 1_000_000),
)


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
    """Cut vessels into cells; ``speed`` (v,) is the pulse wave velocity at rest, mm/s."""
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


def check_compliant(network: VesselNetwork, wall: Wall) -> FloatArray:
    """Return the compliance of each vessel, (v,), µL/Pa; raise `FlowError` where it is 0."""
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
    """Return K of pieces of vessels, (n,), Pa.

    ``vessel`` (n,) has each piece; ``square`` and ``cube`` (n,) are means of the radius' powers
    over it, mm², mm³. A wall that isn't known here has one K a vessel, by its compliance.

    Both walls give a widening in proportion to the pressure, so both have this law, and it has the
    compliance dA/dp = 2 A₀/K at rest that the lumped model has:

    - thin wall: hoop stress p r/h = E ε/(1 - ν²) with ε = r/r₀ - 1, its lever taken at rest, gives
      K = E h/((1 - ν²) r₀); with ν = ½ this is β(√A - √A₀)/A₀, β = (4/3)√π E h (Formaggia, Lamponi
      & Quarteroni 2003, doi 10.1023/B:ENGI.0000007980.01347.29);
    - lumen in thick gel: Lamé's displacement u = p r₀ (1 + ν)/E gives K = E/(1 + ν), whatever the
      radius. It is for small strains: an incompressible neo-Hookean gel, p = G (ln λ + ½ (1 - λ⁻²))
      with λ = r/r₀ and G = E/3, has the same slope 2G = E/(1 + ν) at rest and is softer by the
      share λ - 1 when it is wider by that share.

    The pulse wave velocity is c = √(A/ϱ dp/dA) = √((K + p)/(2ϱ)).

    A Kelvin-Voigt wall adds φ dε/dt to its stress E ε (of the gel: to its shear stress), which
    makes K ε into K (ε + τ dε/dt) with τ = φ/E: a pressure γ ∂A/∂t with γ = K τ/(2√(A A₀)); for the
    thin wall (2/3)√π φ h/(A₀ √A), as in Alastruey et al. 2011, doi 10.1016/j.jbiomech.2011.05.041.
    Where a wall's Γ is given instead, γ = Γ/(A₀ √A).
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
    """Return τ = φ/E of a Kelvin-Voigt wall, s; raise `FlowError` where E isn't known."""
    if wall_viscosity_pa_s == 0.0:
        return 0.0
    if isinstance(wall, GelWall | ThinWall):
        return wall_viscosity_pa_s / wall.young_pa
    raise FlowError("wall_viscosity_pa_s needs a thin wall or a gel, whose modulus is known")


def wall_drag(
    wall: Wall, wall_viscosity_pa_s: float, vessel: IntArray, stiff: FloatArray, area: FloatArray
) -> FloatArray:
    """Return γ √A of pieces of vessels, (n,), Pa·s/mm: K τ/(2 √A₀), or Γ/A₀.

    ``stiff`` and ``area`` (n,) are K, Pa, and A₀, mm²; raises as `relaxation_time`.
    """
    drag = stiff * relaxation_time(wall, wall_viscosity_pa_s) / (2.0 * np.sqrt(area))
    if isinstance(wall, VesselWalls):
        drag += wall.damping(vessel, np.sqrt(area / np.pi)) / area
    return np.asarray(drag)


class NodeKinds(NamedTuple):
    """What a node asks of the vessel ends that meet there."""

    junction: int = 0
    """One total pressure, and flows that add up to a flow from outside (where it has a wave)."""
    pressure: int = 1
    resistance: int = 2
    """Of a Windkessel the first, or all there is."""
    reflection: int = 3


KIND: Final = NodeKinds()


class Nodes(NamedTuple):
    """Nodes by the vessel ends that meet there.

    End ``2 k`` is vessel k's first, ``2 k + 1`` its last.

    Attributes
    ----------
    start : (m + 1,) int64
        Ends of node ``j`` are ``end[start[j]:start[j + 1]]``.
    end : (2 v,) int64
    kind : (m,) int64
        Of `NodeKinds`.
    wave : (m,) int64
        Row of what drives it, -1 for none.
    proximal, distal, capacitance, back : (m,) float64, Pa·s/µL, Pa·s/µL, µL/Pa, Pa
        Of outlets; without a capacitance the pressure behind `proximal` stays at `back`.
    reflection : (m,) float64
    """

    start: IntArray
    end: IntArray
    kind: IntArray
    wave: IntArray
    proximal: FloatArray
    distal: FloatArray
    capacitance: FloatArray
    back: FloatArray
    reflection: FloatArray


def place_nodes(
    network: VesselNetwork, conditions: PulsatileConditions, reflection: Mapping[int, float]
) -> tuple[Nodes, IntArray, tuple[Waveform, ...]]:
    """Return nodes, which of them each of the network's is (inlets on one flow share one), waves.

    Raises `FlowError` for no inlet, no outlet, an isolated part, an outlet without a condition, a
    reflection where it can't be.
    """
    refuse_supplies(conditions.supplies, "1D flow")
    inlets, outlets = checked_ends(network, conditions)
    slot = np.arange(len(network.nodes))
    if conditions.inlet_is == "flow":
        slot[inlets] = inlets[0]
    (slot,) = number_unknowns(slot)
    nodes = _junctions(slot[network.vessel_nodes].ravel(), int(slot.max()) + 1)
    nodes.wave[slot[inlets]] = 0
    if conditions.inlet_is == "pressure":
        nodes.kind[slot[inlets]] = KIND.pressure
    waves: list[Waveform] = [conditions.inlet]
    strangers = sorted(set(reflection) - set(outlets.tolist()))
    if strangers:
        raise FlowError(f"node {strangers[0]} has a reflection and isn't one of the outlets")
    for node, outlet in outlets_by_node(conditions.outlet, outlets).items():
        place = int(slot[node])
        _attach(nodes, place, outlet, waves)
        if node in reflection:
            _reflect(nodes, node, place, reflection[node])
    return nodes, slot, tuple(waves)


def _junctions(at: IntArray, count: int) -> Nodes:
    """``count`` junctions, at which vessel ends ``at`` (2 v,) meet."""
    start = np.concatenate([[0], np.cumsum(np.bincount(at, minlength=count))])
    kind, wave = np.full(count, KIND.junction), np.full(count, -1)
    return Nodes(start, np.argsort(at, kind="stable"), kind, wave, *np.zeros((5, count)))


def _attach(nodes: Nodes, place: int, outlet: Outlet, waves: list[Waveform]) -> None:
    if isinstance(outlet, PressureOutlet):
        nodes.kind[place] = KIND.pressure
        if outlet.waveform not in waves[1:]:
            waves.append(outlet.waveform)
        nodes.wave[place] = 1 + waves[1:].index(outlet.waveform)
        return
    nodes.kind[place], nodes.back[place] = KIND.resistance, outlet.distal_pa
    if isinstance(outlet, ResistanceOutlet):
        nodes.proximal[place] = outlet.resistance
    elif isinstance(outlet, WindkesselOutlet):
        nodes.proximal[place], nodes.distal[place] = outlet.proximal, outlet.distal
        nodes.capacitance[place] = outlet.compliance


def _reflect(nodes: Nodes, node: int, place: int, part: float) -> None:
    if nodes.kind[place] != KIND.pressure:
        raise FlowError(
            f"outlet {node} has a reflection, and a resistance of its own; give it a pressure, "
            "about which waves are sent back"
        )
    if nodes.start[place + 1] - nodes.start[place] != 1:
        raise FlowError(f"several vessels meet at outlet {node}; a reflection is for one")
    nodes.kind[place], nodes.reflection[place] = KIND.reflection, part


def end_impedance(grid: Grid) -> FloatArray:
    """ϱ c/A at rest of each vessel's ends, (2 v,), Pa·s/µL."""
    faces = (
        np.column_stack([grid.offset[:-1], grid.offset[1:]]) + np.arange(len(grid.cell))[:, None]
    )
    speed = np.sqrt(grid.face_stiffness / (2.0 * grid.density))
    return np.asarray((grid.density * speed / grid.face_area)[faces].ravel())
