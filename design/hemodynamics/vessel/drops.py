"""Compute each vessel's pressure drop and its derivative at a given flow, for any fluid.

Along a piece of length ℓ whose radius goes linearly from a to b, with t = r⁻³ the measure ds/r⁴
is uniform in t, and so is Γ = 4Q t/π:

    ∫ μ_app ds/r⁴ = ℓ (a² + ab + b²)/(3a³b³) × the mean of μ_app(4Q t/π) over t from b⁻³ to a⁻³,

which Gauss's rule takes in ln t, its weights normed: exact for a Newtonian fluid on any taper, and
for any fluid on none; a power law fluid on a taper to half the radius is right to 1e-5.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.hemodynamics.fluids.fluid import Fluid
from design.hemodynamics.vessel.losses import LossTerms
from design.hemodynamics.vessel.pipes import Pipes, measure_pipes
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

_PLACES, _WEIGHTS = np.polynomial.legendre.leggauss(4)


@dataclass(frozen=True)
class Drop:
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
    """What viscosity takes of each vessel's flow (v,), over it, (v,), Pa·s/µL; without losses.

    Raises
    ------
    FlowError
        As `Pipes.resistance`.
    """
    pipes = measure_pipes(network)
    pipes.resistance(1.0)
    return drops_of(network, pipes, fluid, None).at(flow).resistance
