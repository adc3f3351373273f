"""Compute mean port pressures and the power balance of a 3D flow solution."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.hemodynamics.three_d.engine_mesh import port_name
from design.hemodynamics.three_d.port_plan import PortPlan
from design.hemodynamics.three_d.sample import state_of
from design.hemodynamics.three_d.solution import Energy
from design.hemodynamics.three_d.stokes import Spaces
from kernels.arrays import FloatArray


def port_pressures(room: Spaces, unknowns: FloatArray) -> FloatArray:
    """Mean pressure over each port, (p,), Pa."""
    _, pressure = state_of(room, unknowns).components
    return np.array(
        [
            integrate_over_port(room, k, pressure)
            / integrate_over_port(room, k, room.ng.CoefficientFunction(1.0))
            for k in range(len(room.outward))
        ]
    )


def integrate_over_port(room: Spaces, port: int, function: Any) -> float:
    """Integral over a port."""
    region = room.mesh.Boundaries(port_name(port))
    return float(room.ng.Integrate(function, room.mesh, definedon=region, order=3 * room.order))


def energy_of(room: Spaces, plan: PortPlan, unknowns: FloatArray) -> Energy:
    """Power at the ends against what viscosity takes.

    From u times the momentum equation, ∫ μ ∇u:∇u = -Σ ∫ (p + ½ ϱ u·u) u·n + Σ ∫ μ ∂u/∂n·u. For
    Stokes flow the kinetic part isn't in it, and is as much in as out in a pipe.
    """
    ng = room.ng
    velocity, pressure = state_of(room, unknowns).components
    normal, slope = ng.specialcf.normal(3), ng.Grad(velocity)
    head = pressure + 0.5 * plan.density * velocity * velocity
    traction = plan.viscosity_pa_s * (ng.BoundaryFromVolumeCF(slope) * normal)
    leaving = head * (velocity * normal) - traction * velocity
    ends = -sum(integrate_over_port(room, k, leaving) for k in range(len(room.outward)))
    taken = ng.Integrate(ng.InnerProduct(slope, slope), room.mesh, order=2 * room.order)
    return Energy(float(ends), plan.viscosity_pa_s * float(taken))
