"""Evaluate 0D solutions at probes along vessels: pressure and flow, to compare with 1D, 3D.

Along a vessel the pressure falls as the resistance before the probe does, exactly for tapers and
bends of the polyline. In rigid walls the flow is the same along a vessel at every moment, and both
are exact for the model: the ideal that 1D and 3D are held against. With an elastic wall the lumped
model knows the flow at a vessel's ends only; between, what flows in is stored as the compliance
lies along the vessel, and the pressure follows the flow amid the vessel, of second order in its
length as the model is.
"""

from __future__ import annotations

import numpy as np

from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.pressure_drops import drops_of, heads_of, measure_pipes
from design.hemodynamics.probes import Probes, ProbeWaves
from design.hemodynamics.vessel_coefficients import PARABOLIC, POWERS, integrals, plug_inertance
from design.hemodynamics.zero_d.flow import FlowSolution
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.hemodynamics.zero_d.pulsatile.solution import ComplexArray, PulsatileSolution
from design.network import VesselNetwork
from kernels.arrays import FloatArray


def steady_at_probes(
    network: VesselNetwork, solution: FlowSolution, conditions: FlowConditions, probes: Probes
) -> ProbeWaves:
    """Pressure and flow at probes in steady flow, one time.

    Losses count where the flow enters the vessel.

    Raises
    ------
    FlowError
        For a probe outside the network.
    """
    probes.check(network)
    flow, first = solution.flow[probes.vessel], network.vessel_nodes[probes.vessel, 0]
    heads = heads_of(network, probes)
    before = drops_of(heads, measure_pipes(heads), conditions.whole_fluid, None).at(flow).resistance
    pressure = solution.pressure[first] - before * flow
    if solution.loss is not None:
        pressure -= np.maximum(solution.loss[probes.vessel], 0.0)
    return ProbeWaves(np.zeros(1), pressure[:, None], flow[:, None])


def pulsatile_at_probes(
    network: VesselNetwork,
    solution: PulsatileSolution,
    conditions: PulsatileConditions,
    probes: Probes,
    count: int = 100,
) -> ProbeWaves:
    """Waves of pressure and flow at probes, at ``count`` times of a cycle.

    Raises
    ------
    FlowError
        For a probe outside the network.
    """
    probes.check(network)
    heads, first = heads_of(network, probes), network.vessel_nodes[probes.vessel]
    stored = _share(conditions.wall.compliance(network), conditions.wall.compliance(heads), probes)
    enters, leaves = solution.flow_in[:, probes.vessel], solution.flow_out[:, probes.vessel]
    begin, end = (solution.pressure[:, nodes] for nodes in first.T)
    flow = enters + stored * (leaves - enters)
    pressure = begin + _impedance_share(network, heads, conditions, solution, probes) * (
        end - begin
    )
    times = solution.times(count)
    return ProbeWaves(times, solution.at(pressure, times).T, solution.at(flow, times).T)


def _impedance_share(
    network: VesselNetwork,
    heads: VesselNetwork,
    conditions: PulsatileConditions,
    solution: PulsatileSolution,
    probes: Probes,
) -> ComplexArray:
    """Part of each vessel's impedance that lies before its probe, (k, p).

    Womersley's is lumped at the mean radius: its part is that of the resistance.
    """
    whole, part = (
        conditions.viscosity_pa_s * 8.0 / np.pi * integrals(each)[POWERS[-4]]
        for each in (network, heads)
    )
    turn = np.zeros((len(solution.harmonic), 1), dtype=np.complex128)
    if conditions.profile == "poiseuille":
        turn += 1j * solution.omega[:, None]
    inert = PARABOLIC * plug_inertance(network, conditions.density)[probes.vessel]
    before = PARABOLIC * plug_inertance(heads, conditions.density)
    return np.asarray((part + turn * before) / (whole[probes.vessel] + turn * inert))


def _share(whole: FloatArray, part: FloatArray, probes: Probes) -> FloatArray:
    each = whole[probes.vessel]
    return np.divide(part, each, out=probes.fraction.copy(), where=each > 0.0)
