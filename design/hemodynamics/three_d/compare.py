"""Estimate the discretisation error of 3D flow by solving again with another element order."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from design.hemodynamics.conditions import FlowConditions
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.options import FlowOptions
from design.hemodynamics.three_d.solution import ThreeDSolution
from design.hemodynamics.three_d.steady import solve_steady
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions


@dataclass(frozen=True)
class ErrorEstimate:
    """Differences between order 3 and order 2, which bound the error of order 3.

    Attributes
    ----------
    pressure : float
        Largest of the ports, of the largest difference between two ports.
    flow : float
        Largest of the ports, of what comes in.
    wall_shear : float
        Of its mean over the wall's nodes.
    """

    pressure: float
    flow: float
    wall_shear: float


def estimate_error(
    mesh: LumenMesh,
    conditions: FlowConditions | PulsatileConditions,
    solution: ThreeDSolution,
    options: FlowOptions | None = None,
) -> ErrorEstimate:
    """Solve again with the other order, and compare.

    Order 2 takes a third of order 3's unknowns; its own error is much the larger of the two, so
    that the difference is an error of order 2, and a bound for order 3. Neither sees that the
    lumen's shape is approximated: for that, compare two meshes.

    Raises
    ------
    FlowError
        As `solve_steady`.
    """
    other = 5 - solution.field.order
    again = solve_steady(mesh, conditions, replace(options or FlowOptions(), order=other))
    drop = float(np.ptp(solution.port_pressure)) or 1.0
    into = -float(solution.port_flow[solution.port_flow < 0.0].sum()) or 1.0
    mean, other_mean = (float(s.wall_shear.magnitude.mean()) for s in (solution, again))
    return ErrorEstimate(
        float(np.abs(solution.port_pressure - again.port_pressure).max()) / drop,
        float(np.abs(solution.port_flow - again.port_flow).max()) / into,
        abs(other_mean / mean - 1.0) if mean else 0.0,
    )
