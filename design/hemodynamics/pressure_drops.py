"""Pressure drop, wall shear and losses at bifurcations and stenoses of vessels in steady flow."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import numpy as np

from design.errors import FlowInputError
from design.hemodynamics.fluids import Fluid
from design.hemodynamics.probes import Probes
from design.hemodynamics.vessel_coefficients import refuse_absurd_resistance
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray

_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


class Drop(NamedTuple):
    """Pressure drops and their derivatives at given flows, (v,) each.

    Attributes
    ----------
    resistance : float64, Pa·s/µL
        What viscosity takes over the flow.
    loss : float64, Pa
        What inertia takes, signed like the flow.
    slope : float64, Pa·s/µL
        Derivative of the whole by the flow.
    """

    resistance: FloatArray
    loss: FloatArray
    slope: FloatArray

    def whole(self, flow: FloatArray) -> FloatArray:
        """The pressure drop, (v,), Pa."""
        return self.resistance * flow + self.loss


class LossTerms(NamedTuple):
    """Coefficients of a network's losses, all (v,).

    Attributes
    ----------
    viscous : float64, mm⁻³
        To be added to the resistance for viscosity 1.
    forth, back : float64, Pa·s²/µL²
        b of Δp = b Q|Q|, for flow along the vessel and against it.
    """

    viscous: FloatArray
    forth: FloatArray
    back: FloatArray


@dataclass(frozen=True)
class Pipes:
    """Vessels as pipes; arrays are (v,).

    Attributes
    ----------
    network : VesselNetwork
        Whose they are.
    radius : float64, mm
        Mean over the length.
    per_viscosity : float64, mm⁻³
        Resistance for viscosity 1, (8/π) ∫ ds/r⁴ (`vessel_resistance`).
    """

    network: VesselNetwork
    radius: FloatArray
    per_viscosity: FloatArray

    def resistance(self, viscosity: FloatArray | float) -> FloatArray:
        """Return the resistance of each vessel, (v,), Pa·s/µL; ``viscosity`` (v,) or one, Pa·s.

        Raises `FlowError` for a vessel of zero length, or a resistance beyond the range of numbers.
        """
        return self.conductance(viscosity)[0]

    def conductance(self, viscosity: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        """Resistance and its inverse, (v,) each; as `resistance`."""
        resistance, inverse = np.empty((2, len(self.radius)))
        each = np.broadcast_to(np.asarray(viscosity, dtype=np.float64), resistance.shape)
        if not _resist(each, self.per_viscosity, resistance, inverse):
            refuse_absurd_resistance(self.network, resistance)
        return resistance, inverse


@dataclass(frozen=True)
class Drops:
    """A network's vessels in some fluid.

    Attributes
    ----------
    fluid : Fluid
    pipes : Pipes
    losses : LossTerms or None
    vessel : (n,) int64
        Of each straight piece.
    weight : (n, 4) float64, mm⁻³
        (8/π) ∫ ds/r⁴ of each piece, divided among Gauss's places.
    cubed : (n, 4) float64, mm⁻³
        t at Gauss's places.
    """

    fluid: Fluid
    pipes: Pipes
    losses: LossTerms | None
    vessel: IntArray
    weight: FloatArray
    cubed: FloatArray

    def at(self, flow: FloatArray) -> Drop:
        """Drops at flows (v,), µL/s."""
        size = np.abs(flow)
        rate = (4.0 / np.pi) * size[self.vessel][:, None] * self.cubed
        viscosity, index = self.fluid.apparent(rate, np.cbrt(1.0 / self.cubed))
        resistance = self._summed(viscosity)
        slope = self._summed(viscosity * index)
        if self.losses is None:
            return Drop(resistance, np.zeros_like(flow), slope)
        terms = self.losses
        added = terms.viscous * self.viscosity(flow)
        b = np.where(flow >= 0.0, terms.forth, terms.back)
        return Drop(resistance + added, b * flow * size, slope + added + 2.0 * b * size)

    def viscosity(self, flow: FloatArray) -> FloatArray:
        """Apparent, at the mean radius, (v,), Pa·s."""
        r = self.pipes.radius
        return self.fluid.apparent(4.0 * np.abs(flow) / (np.pi * r**3), r)[0]

    def _summed(self, values: FloatArray) -> FloatArray:
        each = (self.weight * values).sum(axis=1)
        count = len(self.pipes.radius)
        return np.asarray(np.bincount(self.vessel, each, count), dtype=np.float64)


def drops_of(network: VesselNetwork, pipes: Pipes, fluid: Fluid, losses: LossTerms | None) -> Drops:
    """Prepare a network's pieces."""
    start, end, a, b, vessel = network.pieces()
    length = np.linalg.norm(end - start, axis=1)
    weight = 8.0 / (3.0 * np.pi) * length * (a * a + a * b + b * b) / (a * b) ** 3
    middle, half = -1.5 * np.log(a * b), 1.5 * np.log(b / a)
    cubed = np.exp(middle[:, None] + half[:, None] * _PLACES)
    share = cubed * _WEIGHTS
    share *= (weight / share.sum(axis=1))[:, None]
    return Drops(fluid, pipes, losses, vessel, share, cubed)


def resistance_at(network: VesselNetwork, fluid: Fluid, flow: FloatArray) -> FloatArray:
    """Return the viscous resistance of each vessel at a flow, (v,) each, Pa·s/µL.

    Raises
    ------
    FlowError
        As `Pipes.resistance`.
    """
    pipes = measure_pipes(network)
    pipes.resistance(1.0)
    return drops_of(network, pipes, fluid, None).at(flow).resistance


@dataclass(frozen=True)
class Stenosis:
    """A short narrow place in a vessel.

    Young & Tsai 1973 (doi 10.1016/0021-9290(73)90099-7), with the length of Seeley & Young 1976
    (doi 10.1016/0021-9290(76)90086-5), L_a = 0.83 L_s + 1.64 D_s:

        Δp = 128 μ L_a Q/(π D_s⁴) + K_t ϱ (A₀/A_s - 1)² Q|Q|/(2 A₀²),  K_t = 1.52.

    The first takes the place of what Poiseuille's law gives for the same length unnarrowed. Found
    on rigid, blunt, axisymmetric plugs of 56 to 89 % of the area at Reynolds numbers of some 100 to
    5,000; steady flow only.

    Attributes
    ----------
    vessel : int
    diameter_share : float
        D_s/D₀, of the vessel's mean diameter; 0.1 to 1.
    length_mm : float
        L_s.
    """

    EXPANSION: ClassVar[float] = 1.52
    """K_t, the loss where a jet widens, over that of Borda and Carnot."""

    vessel: int
    diameter_share: float
    length_mm: float

    def __post_init__(self) -> None:
        if not 0.1 <= self.diameter_share <= 1.0:
            raise FlowInputError(
                f"the stenosis in vessel {self.vessel} leaves {self.diameter_share:g} of its "
                "diameter; give 0.1 to 1"
            )
        if not (np.isfinite(self.length_mm) and self.length_mm > 0.0):
            raise FlowInputError(
                f"the stenosis in vessel {self.vessel} is {self.length_mm:g} mm long; give a "
                "length above 0"
            )


@dataclass(frozen=True)
class Losses:
    """Inertial pressure losses to include.

    Attributes
    ----------
    junction : float
        K of Δp = K ϱ u²/2 at each vessel's begin, as the flow goes, where three vessels or more
        meet; u is the mean speed in the vessel. 0 for none. For smooth symmetric bifurcations of
        30° to 90° K is of the order of 0.5 to 1, sharper turns cost more (Idelchik, Handbook of
        Hydraulic Resistance, chapter 7). A constant K holds in inertial flow, at Reynolds numbers
        of some 100 and more; in creeping flow the loss is small beside viscosity's, whatever K.
        Pressure regained where flow slows down isn't counted, so that no loss is negative.
    stenoses : tuple of Stenosis
    """

    junction: float = 0.0
    stenoses: tuple[Stenosis, ...] = ()

    def __post_init__(self) -> None:
        if not 0.0 <= self.junction <= 100.0:
            raise FlowInputError(f"the junctions' K is {self.junction:g}; give 0 to 100")

    @property
    def any(self) -> bool:
        """Whether there are some."""
        return self.junction > 0.0 or bool(self.stenoses)

    def in_part(self, number: Mapping[int, int]) -> Losses:
        """The losses in a part of the network, whose vessels have the numbers of ``number``."""
        kept = (each for each in self.stenoses if each.vessel in number)
        return replace(
            self, stenoses=tuple(replace(each, vessel=number[each.vessel]) for each in kept)
        )


def loss_terms(
    network: VesselNetwork, radius: FloatArray, losses: Losses, density: float
) -> LossTerms:
    """Return losses of a network whose mean radii (v,) are known; ``density`` in Pa·s²/mm².

    Raises `FlowInputError` for a stenosis in no vessel, or stenoses longer than their vessel.
    """
    _check(network, losses.stenoses)
    head = 0.5 * density / (np.pi * radius**2) ** 2
    meets = network.degree() >= 3
    first, last = network.vessel_nodes.T
    forth = losses.junction * np.where(meets[first], head, 0.0)
    back = losses.junction * np.where(meets[last], head, 0.0)
    viscous = np.zeros(network.vessel_count)
    for each in losses.stenoses:
        v, share = each.vessel, each.diameter_share
        whole, narrow = 2.0 * radius[v], 2.0 * radius[v] * share
        apparent = 0.83 * each.length_mm + 1.64 * narrow
        viscous[v] += 128.0 / np.pi * (apparent / narrow**4 - each.length_mm / whole**4)
        for b in (forth, back):
            b[v] += Stenosis.EXPANSION * (share**-2.0 - 1.0) ** 2 * head[v]
    return LossTerms(viscous, forth, back)


def _check(network: VesselNetwork, stenoses: tuple[Stenosis, ...]) -> None:
    whole = network.lengths()
    narrow: dict[int, float] = {}
    for each in stenoses:
        if not 0 <= each.vessel < network.vessel_count:
            raise FlowInputError(
                f"a stenosis is in vessel {each.vessel}, and the network has 0 to "
                f"{network.vessel_count - 1}"
            )
        narrow[each.vessel] = narrow.get(each.vessel, 0.0) + each.length_mm
    for vessel, length in narrow.items():
        if length > whole[vessel]:
            raise FlowInputError(
                f"the stenosis in vessel {vessel} is {length:g} mm long (several count together), "
                f"and the vessel {whole[vessel]:g} mm"
            )


def measure_pipes(network: VesselNetwork) -> Pipes:
    """Measure each vessel; radii go linearly from point to point."""
    pipes = Pipes(network, *np.empty((2, network.vessel_count)))
    points, radius = np.ascontiguousarray(network.points), np.ascontiguousarray(network.radius)
    _measure(points, radius, network.offset, pipes.radius, pipes.per_viscosity)
    return pipes


def speed_and_shear(
    pipes: Pipes, flow: FloatArray, viscosity: FloatArray | float
) -> tuple[FloatArray, FloatArray]:
    """Mean velocity Q/(π r²), mm/s, and wall shear 4 μ Q/(π r³), Pa, at the mean radius, (v,)."""
    speed, shear = np.empty((2, len(flow)))
    each = np.broadcast_to(np.asarray(viscosity, dtype=np.float64), flow.shape)
    _speed(pipes.radius, flow, each, speed, shear)
    return speed, shear


@jit
def _measure(
    points: FloatArray,
    radius: FloatArray,
    offset: IntArray,
    mean: FloatArray,
    per_viscosity: FloatArray,
) -> None:
    for vessel in range(len(mean)):
        whole, area, resists = 0.0, 0.0, 0.0
        for k in range(offset[vessel], offset[vessel + 1] - 1):
            a, b = radius[k], radius[k + 1]
            x, y = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
            z = points[k + 1, 2] - points[k, 2]
            step, ab = np.sqrt(x * x + y * y + z * z), a * b
            whole += step
            area += step * (a + b)
            resists += step * (a * a + ab + b * b) / (ab * ab * ab)
        mean[vessel] = 0.5 * area / whole
        per_viscosity[vessel] = 8.0 / (3.0 * np.pi) * resists


@jit
def _resist(
    viscosity: FloatArray, per_viscosity: FloatArray, resistance: FloatArray, inverse: FloatArray
) -> bool:
    """Whether all came out as numbers above 0."""
    sound = True
    for v in range(len(resistance)):
        r = viscosity[v] * per_viscosity[v]
        resistance[v], inverse[v] = r, 1.0 / r
        sound = sound and 0.0 < r < np.inf
    return sound


@jit
def _speed(
    radius: FloatArray,
    flow: FloatArray,
    viscosity: FloatArray,
    speed: FloatArray,
    shear: FloatArray,
) -> None:
    for v in range(len(flow)):
        speed[v] = flow[v] / (np.pi * radius[v] * radius[v])
        shear[v] = 4.0 * viscosity[v] * speed[v] / radius[v]


def heads_of(network: VesselNetwork, probes: Probes) -> VesselNetwork:
    """Upstream part of each probe's vessel, as a network of p unjoined vessels.

    A head of no length is left where a probe stands on a vessel's first node.
    """
    parts = [
        _head(*network.polyline(int(vessel)), float(fraction))
        for vessel, fraction in zip(probes.vessel, probes.fraction, strict=True)
    ]
    counts = np.array([len(radius) for _, radius in parts])
    ends = np.arange(2 * len(parts)).reshape(-1, 2)
    return VesselNetwork(
        nodes=np.concatenate([points[[0, -1]] for points, _ in parts]),
        vessel_nodes=ends,
        kind=network.kind[probes.vessel],
        tree=network.tree[probes.vessel],
        offset=np.concatenate([[0], np.cumsum(counts)]),
        points=np.concatenate([points for points, _ in parts]),
        radius=np.concatenate([radius for _, radius in parts]),
    )


def _head(points: FloatArray, radius: FloatArray, fraction: float) -> tuple[FloatArray, FloatArray]:
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    along = np.concatenate([[0.0], np.cumsum(steps)])
    where = fraction * along[-1]
    # The piece that the probe stands in: all before it are whole.
    piece = min(max(int(np.searchsorted(along, where)) - 1, 0), len(steps) - 1)
    share = (where - along[piece]) / steps[piece] if steps[piece] > 0.0 else 0.0
    last = points[piece] + share * (points[piece + 1] - points[piece])
    end_radius = radius[piece] + share * (radius[piece + 1] - radius[piece])
    return np.vstack([points[: piece + 1], last]), np.append(radius[: piece + 1], end_radius)
