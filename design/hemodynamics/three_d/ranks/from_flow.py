"""Translate a network's steady flow conditions to port conditions of the MPI flow solver."""

from __future__ import annotations

from typing import Any

from design.errors import FlowError
from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.ranks.case import (
    PortCondition,
    PortFlow,
    PortPressure,
    PortShare,
    RankConditions,
)
from design.hemodynamics.zero_d.boundary import refuse_supplies


def rank_conditions(mesh: LumenMesh, conditions: FlowConditions, **options: Any) -> RankConditions:
    """Conditions of every port, by its node: a network's own, at its lumen.

    A given flow has a profile where there is one inlet; several hang on one supply and share its
    pressure. An outlet of given flow has a pressure of its own.

    Parameters
    ----------
    mesh : LumenMesh
    conditions : FlowConditions
    **options
        Of `RankConditions`: density (the conditions' by default), model, profile, solver,
        tolerance.

    Raises
    ------
    FlowError
        No inlet, a node that isn't at a port, pressure nowhere given.
    """
    refuse_supplies(conditions.supplies, "3D flow")
    inlets = _inlets(mesh, conditions)
    ports: list[PortCondition] = []
    supplies: list[float] = []
    if conditions.inlet_flow_ul_s is not None and len(inlets) > 1:
        supplies.append(conditions.inlet_flow_ul_s)
    for k, port in enumerate(mesh.ports):
        if k in inlets:
            ports.append(_inlet(conditions, bool(supplies)))
        elif port.node in conditions.outlet_flow_ul_s:
            ports.append(PortShare(len(supplies)))
            supplies.append(-conditions.outlet_flow_ul_s[port.node])
        else:
            ports.append(PortPressure(conditions.outlet_pressure_pa))
    options_given = {"density": conditions.density, **options}
    return RankConditions(tuple(ports), conditions.viscosity_pa_s, tuple(supplies), **options_given)


def _inlets(mesh: LumenMesh, conditions: FlowConditions) -> set[int]:
    place = {port.node: k for k, port in enumerate(mesh.ports)}
    named = {*(conditions.inlets or ()), *(conditions.outlets or ()), *conditions.outlet_flow_ul_s}
    if strangers := named - set(place):
        raise FlowError(f"node {min(strangers)} isn't at a port of the lumen's mesh")
    if conditions.inlets is not None:
        inlets = {place[node] for node in conditions.inlets}
    else:
        inlets = {k for k, port in enumerate(mesh.ports) if port.inlet}
    if not inlets:
        raise FlowError("the lumen's mesh has no inlet; open one, or name its node in inlets")
    return inlets


def _inlet(conditions: FlowConditions, shared: bool) -> PortCondition:
    if conditions.inlet_flow_ul_s is None:
        return PortPressure(conditions.inlet_pressure_pa or 0.0)
    return PortShare(0) if shared else PortFlow(conditions.inlet_flow_ul_s)
