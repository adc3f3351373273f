"""Compute the flow in each vessel from a 3D solution, with mass conserved at the nodes.

Amid a vessel that is shorter than the junctions at its ends a section cuts a fork, and what passes
through it isn't the vessel's flow. Ports and sections clear of junctions are exact; what flows in
between follows from them.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.probes import clear_parts, midpoints
from design.hemodynamics.three_d.lumen_mesh import MeshPort
from design.hemodynamics.three_d.sections import probe_steady
from design.hemodynamics.three_d.solution import ThreeDSolution
from design.network import FloatArray, VesselNetwork

BoolArray = NDArray[np.bool_]

_CLEAR: Final = 0.39
"""Share of a vessel's length taken by its ends up to which the rest counts as clear."""

_UNSURE: Final = 1e-3
"""Weight of a section that isn't clear."""


def vessel_flows(network: VesselNetwork, solution: ThreeDSolution) -> FloatArray:
    """Steady flow in every vessel, (v,), µL/s, from its first node to its last.

    Raises
    ------
    FlowError
        As `probe_steady`.
    """
    amid = probe_steady(network, midpoints(network), solution.field).flow
    ports = solution.field.mesh.ports
    return conserve_mass(network, amid, ports, solution.port_flow[:, None])[:, 0]


def is_clear(network: VesselNetwork) -> BoolArray:
    """Whether a vessel is longer than the junctions at its ends, (v,)."""
    parts = clear_parts(network)
    return np.asarray((parts[:, 0] < _CLEAR) & (parts[:, 1] > 1.0 - _CLEAR))


def conserve_mass(
    network: VesselNetwork, amid: FloatArray, ports: Sequence[MeshPort], port_flow: FloatArray
) -> FloatArray:
    """Flows (v, t) nearest to those ``amid`` the vessels that the nodes leave nothing of.

    Least squares, sections that aren't clear weighing a thousandth. A wall is rigid in 3D, so this
    holds at every moment.

    Parameters
    ----------
    network : VesselNetwork
    amid : (v, t) float64, µL/s
        Through the middle sections.
    ports : sequence of MeshPort
    port_flow : (p, t) float64, µL/s
        Out of the lumen.
    """
    weight = np.where(is_clear(network), 1.0, _UNSURE)
    incidence = np.zeros((len(network.nodes), network.vessel_count))
    vessel = np.arange(network.vessel_count)
    np.add.at(incidence, (network.vessel_nodes[:, 1], vessel), 1.0)
    np.subtract.at(incidence, (network.vessel_nodes[:, 0], vessel), 1.0)
    leaves = np.zeros((len(network.nodes), amid.shape[1]))
    for port, flow in zip(ports, port_flow, strict=True):
        if port.node >= 0:
            leaves[port.node] = flow
    # The correction d of least weighted size with A d = what is left over.
    scaled = incidence / np.sqrt(weight)
    step = np.linalg.lstsq(scaled, leaves - incidence @ amid, rcond=1e-10)[0]
    return np.asarray(amid + step / np.sqrt(weight)[:, None], dtype=np.float64)
