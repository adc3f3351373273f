"""Solve for the developed velocity profile over a port's actual cross-section.

Steady developed flow through a section obeys -Δψ = 1 with 0 at the rim (Poiseuille's parabola in
a circle); an oscillation i ω ϱ/μ ψ - Δψ = 1 (Womersley's in a circle). Both are solved for on the
port's own faces, so that a scanned lumen's opening needn't be round.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.three_d.engine import CURVED
from design.hemodynamics.three_d.engine_mesh import WALL_NAME, port_name
from design.hemodynamics.three_d.lumen_mesh import LumenMesh
from design.hemodynamics.three_d.stokes import Spaces


def unit_profile(spaces: Spaces, mesh: LumenMesh, port: int, rate: complex = 0.0) -> NDArray[Any]:
    """Unknowns of a developed flow of 1 µL/s into the lumen by ``port``, (n,), 0 elsewhere.

    Parameters
    ----------
    spaces : Spaces
    mesh : LumenMesh
    port : int
    rate : complex, 1/mm²
        i ω ϱ/μ; the profile is complex where it isn't 0.

    Raises
    ------
    FlowError
        A port without a face or without a node inside its rim.
    """
    ng, region = spaces.ng, spaces.mesh.Boundaries(port_name(port))
    scalar = ng.H1(spaces.mesh, order=spaces.order, complex=bool(rate))
    inside = scalar.GetDofs(region) & ~scalar.GetDofs(spaces.mesh.Boundaries(WALL_NAME))
    if not inside.NumSet():
        raise FlowError(
            f"port {port} (node {mesh.ports[port].node}) has no face or no node inside its rim, "
            "so that no profile fits; mesh it finer"
        )
    psi, test = scalar.TnT()
    at = ng.ds(port_name(port), bonus_intorder=CURVED)
    form = ng.BilinearForm(scalar, symmetric=True)
    form += (ng.Grad(psi).Trace() * ng.Grad(test).Trace() + rate * psi * test) * at
    form.Assemble()
    load = ng.LinearForm(scalar)
    load += test * at
    load.Assemble()
    answer = load.vec.CreateVector()
    answer.data = form.mat.Inverse(inside, inverse="sparsecholesky") * load.vec
    shape = answer.FV().NumPy()
    unknowns = np.zeros(spaces.count, dtype=shape.dtype)
    for axis in range(3):
        unknowns[axis * scalar.ndof : (axis + 1) * scalar.ndof] = (
            -mesh.ports[port].outward[axis] * shape
        )
    return np.asarray(unknowns / -(spaces.outward[port] @ unknowns))
