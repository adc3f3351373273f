"""Data class of a steady 0D flow solution: node pressures, vessel flows, wall shear."""

from __future__ import annotations

from dataclasses import dataclass

from kernels.arrays import FloatArray


@dataclass(frozen=True)
class FlowSolution:
    """Steady 0D flow; conserved to rounding at every node.

    Attributes
    ----------
    pressure : (m,) float64, Pa
        At the network's nodes.
    flow : (v,) float64, µL/s
        In each vessel, positive from its first node to its last.
    velocity : (v,) float64, mm/s
        Mean over the cross-section at the length-weighted mean radius, signed like `flow`.
    wall_shear : (v,) float64, Pa
        4 μ Q / (π r³) at the mean radius, signed like `flow`, μ the apparent viscosity there.
    resistance : (v,) float64, Pa·s/µL
        What viscosity takes in each vessel, over its flow.
    loss : (v,) float64, Pa, or None
        What inertia takes at bifurcations and stenoses, signed like `flow`.
    """

    pressure: FloatArray
    flow: FloatArray
    velocity: FloatArray
    wall_shear: FloatArray
    resistance: FloatArray
    loss: FloatArray | None = None
