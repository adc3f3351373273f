"""Notes on flow that runs backwards at inlets or outlets, steady or in a cycle."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from design.hemodynamics import FlowConditions, FlowSolution
from design.hemodynamics.zero_d.boundary import boundary_nodes
from design.hemodynamics.zero_d.steady import node_inflow
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

_LITTLE: Final = 1e-6
"""Of what enters, below which flow at an end counts as none."""
_SHOWN: Final = 5


def steady_notes(
    network: VesselNetwork, solution: FlowSolution, conditions: FlowConditions
) -> list[str]:
    """What is said of inlets that flow leaves by, and outlets that it enters by."""
    inlets, outlets = boundary_nodes(network, conditions)
    into = node_inflow(network, solution.flow)
    little = _LITTLE * float(np.maximum(into, 0.0).sum())
    leaving, entering = inlets[into[inlets] < -little], outlets[into[outlets] > little]
    if len(inlets) == len(leaving):
        return [
            "the flow goes backwards, in at outlets and out at the inlets: pressure at the outlets "
            "is above that at the inlets; raise --inlet-pressure-mmhg (inlet_pressure_mmhg), or "
            "lower the outlets'"
        ]
    return [
        f"flow {does} {len(nodes)} of {len(ends)} {what} ({_named(nodes)}): the pressure there is "
        f"{than} that in the network; see whether that is meant"
        for does, nodes, ends, what, than in (
            ("leaves by", leaving, inlets, "inlets", "below"),
            ("enters by", entering, outlets, "outlets", "above"),
        )
        if len(nodes)
    ]


def pulse_notes(waves: Mapping[str, FloatArray]) -> list[str]:
    """What is said of a cycle in whose course the inlets' flow turns round; see `end_waves`."""
    flow = waves["inlet_flow_ml_min"]
    back = flow < -_LITTLE * float(np.abs(flow).max())
    if not back.any() or back.all():
        return []
    return [
        f"the flow goes back out of the inlets for {back.mean():.0%} of the cycle, by up to "
        f"{-flow.min():.3g} mL/min; a higher mean or a smaller amplitude keeps it forward"
    ]


def _named(nodes: IntArray) -> str:
    shown = ", ".join(map(str, nodes[:_SHOWN].tolist()))
    return f"node {shown}" + (f" and {len(nodes) - _SHOWN} more" if len(nodes) > _SHOWN else "")
