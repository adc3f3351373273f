"""Compute the flow in each vessel from a 3D solution, with mass conserved at the nodes.

Ports are exact, and sections clear of other vessels nearly so. What flows in vessels without a
clear section follows from them, where the nodes leave one answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from design.hemodynamics.probes import clear_parts
from design.hemodynamics.three_d.lumen_mesh import LumenMesh, MeshPort
from design.hemodynamics.three_d.sections import Section, VesselSections
from design.hemodynamics.three_d.solution import ThreeDSolution
from design.network import VesselNetwork
from kernels.arrays import BoolArray, FloatArray

_CLEAR: Final = 0.39
"""Share of a vessel's length taken by its ends up to which the rest counts as clear."""

_SECTION_OFF: Final = 0.02
"""Of its own flow, by which mass may correct a section; one that is farther off is left out."""

_RANK: Final = 1e-9
_ALIKE: Final = 1e-6
"""Relative: rounding of what is exact."""

_STILL: Final = 1e-3
"""Of the largest flow through a port: an error of a section that has less is of this."""


def clear_sections(
    network: VesselNetwork, mesh: LumenMesh, order: int
) -> tuple[Section | None, ...]:
    """Return each vessel's clearest section, None where none is clear.

    Raises
    ------
    FlowError
        As `VesselSections.at`.
    """
    sections = VesselSections(network, mesh, order)
    return tuple(sections.clearest(vessel) for vessel in range(network.vessel_count))


def vessel_flows(network: VesselNetwork, solution: ThreeDSolution) -> FloatArray:
    """Steady flow in every vessel, (v,), µL/s, from its first node to its last.

    NaN as `conserve_mass`.

    Raises
    ------
    FlowError
        As `clear_sections`.
    """
    field = solution.field
    sections = clear_sections(network, field.mesh, field.order)
    amid = np.array([[np.nan if s is None else s.flow(field)] for s in sections])
    return conserve_mass(network, amid, field.mesh.ports, solution.port_flow[:, None])[:, 0]


def is_clear(network: VesselNetwork) -> BoolArray:
    """Whether a vessel is longer than the junctions at its ends, (v,)."""
    parts = clear_parts(network)
    return np.asarray((parts[:, 0] < _CLEAR) & (parts[:, 1] > 1.0 - _CLEAR))


def conserve_mass(
    network: VesselNetwork, amid: FloatArray, ports: Sequence[MeshPort], port_flow: FloatArray
) -> FloatArray:
    """Flows (v, t) nearest to those ``amid`` the vessels that the nodes leave nothing of.

    Least squares, each section weighing by its own flow: errors are parts of it. A section that
    the others contradict by more than 2 % of its flow is left out. Where no section is, flow
    follows from the nodes, or is NaN. A wall is rigid in 3D, so this holds at every moment.

    Parameters
    ----------
    network : VesselNetwork
    amid : (v, t) float64, µL/s
        Through a clear section of each vessel; NaN where it has none.
    ports : sequence of MeshPort
    port_flow : (p, t) float64, µL/s
        Out of the lumen.
    """
    incidence = np.zeros((len(network.nodes), network.vessel_count))
    vessel = np.arange(network.vessel_count)
    np.add.at(incidence, (network.vessel_nodes[:, 1], vessel), 1.0)
    np.subtract.at(incidence, (network.vessel_nodes[:, 0], vessel), 1.0)
    leaves = np.zeros((len(network.nodes), amid.shape[1]))
    for port, flow in zip(ports, port_flow, strict=True):
        if port.node >= 0:
            leaves[port.node] = flow
    size = np.sqrt((amid**2).mean(axis=1))
    still = _STILL * float(np.sqrt((leaves**2).mean(axis=1)).max())
    known = np.isfinite(size)
    while True:
        error = np.maximum(size[known], still)
        without = incidence[:, ~known]
        back = np.linalg.pinv(without, rcond=_RANK)
        left = leaves - incidence[:, known] @ amid[known]
        # What no choice of the flows without a section can take up, as corrections of the others.
        matrix = (incidence[:, known] - without @ (back @ incidence[:, known])) * error
        inverse = np.linalg.pinv(matrix, rcond=_RANK)
        step = inverse @ (left - without @ (back @ left))
        # A correction over the share of an error that the nodes can see (Baarda 1968).
        seen = np.sqrt(np.clip(np.einsum("km,mk->k", inverse, matrix), _RANK, None))
        suspect = np.sqrt((step**2).mean(axis=1)) / seen
        worst = float(suspect.max(initial=0.0))
        if worst <= _SECTION_OFF:
            break
        # Several that are as suspect can't be told apart.
        known[np.flatnonzero(known)[suspect > (1.0 - _ALIKE) * worst]] = False
    flow = np.full_like(amid, np.nan)
    flow[known] = amid[known] + step * error[:, None]
    follows = np.einsum("km,mk->k", back, without) > 1.0 - _ALIKE
    flow[~known] = np.where(
        follows[:, None], back @ (leaves - incidence[:, known] @ flow[known]), np.nan
    )
    return flow
