"""Mean radius and resistance per viscosity of each vessel; velocity and wall shear from flow."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.network import VesselNetwork
from kernels import jit
from kernels.arrays import FloatArray, IntArray


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
        """Of each vessel, (v,), Pa·s/µL; ``viscosity`` in Pa·s, (v,) or one for all.

        Raises
        ------
        FlowError
            For a vessel of zero length, or one whose resistance leaves the range of numbers.
        """
        return self.conductance(viscosity)[0]

    def conductance(self, viscosity: FloatArray | float) -> tuple[FloatArray, FloatArray]:
        """Resistance and its inverse, (v,) each; as `resistance`."""
        resistance, inverse = np.empty((2, len(self.radius)))
        each = np.broadcast_to(np.asarray(viscosity, dtype=np.float64), resistance.shape)
        if not _resist(each, self.per_viscosity, resistance, inverse):
            _refuse(self, resistance)
        return resistance, inverse


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


def _refuse(pipes: Pipes, resistance: FloatArray) -> None:
    length = pipes.network.lengths()
    flat = np.flatnonzero(~(length > 0.0))
    if len(flat):
        raise FlowError(
            f"vessel {int(flat[0])} has zero length ({len(flat)} such vessels), and so no "
            "resistance; remove it or move its ends apart"
        )
    vessel = int(np.flatnonzero(~(np.isfinite(resistance) & (resistance > 0.0)))[0])
    raise FlowError(
        f"vessel {vessel}: resistance {resistance[vessel]:g} Pa·s/µL from length "
        f"{length[vessel]:g} mm and radius {pipes.radius[vessel]:g} mm; check the "
        "network's unit"
    )


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
