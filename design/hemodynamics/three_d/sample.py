"""Sample velocity and pressure at the mesh nodes from a finite-element solution vector."""

from __future__ import annotations

from typing import Any

import numpy as np

from design.hemodynamics.three_d import lagrange
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.solution import Field
from design.hemodynamics.three_d.stokes import Spaces
from kernels.arrays import FloatArray


def state_of(spaces: Spaces, unknowns: FloatArray) -> Any:
    """The engine's function of these unknowns."""
    state = spaces.ng.GridFunction(spaces.both)
    state.vec.FV().NumPy()[:] = unknowns
    return state


def field_of(spaces: Spaces, mesh: LumenMesh, unknowns: FloatArray) -> Field:
    """Velocity and pressure at the nodes of every element."""
    velocity, pressure = state_of(spaces, unknowns).components
    return Field(
        mesh,
        sample_function(spaces, mesh, velocity, spaces.order),
        sample_function(spaces, mesh, pressure, spaces.order - 1),
        spaces.order,
    )


def sample_function(spaces: Spaces, mesh: LumenMesh, function: Any, degree: int) -> FloatArray:
    """Values (t, n, c) at the nodes of this degree, in the mesh's own order of corners."""
    ng, at = spaces.ng, lagrange.nodes(degree)
    # The engine's coordinates belong to its corners 0, 1 and 2; corner 3 is the rest.
    rule = ng.IntegrationRule([tuple(p[:3]) for p in at], [0.0] * len(at))
    points = spaces.mesh.MapToAllElements(rule, ng.VOL)
    return np.asarray(function(points)).reshape(len(mesh.tets), len(at), -1)
