"""Assemble and factorise the 3D Stokes equations in Taylor–Hood elements; convection terms.

Velocities of degree k and pressures of degree k - 1, continuous, on curved tetrahedra (Taylor &
Hood 1973, doi 10.1016/0045-7930(73)90027-3). The weak form is

    ∫ μ ∇u:∇v + κ ∫ u·v - ∫ p ∇·v + ∫ q ∇·u + Σ p_k ∫_k v·n = 0

with the wall's and a profile's velocities given; κ is 0, or ϱ over a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.hemodynamics.three_d.engine import CURVED, WALL_NAME, port_name
from kernels.arrays import FloatArray

_SLACK: Final = 1e-7
"""Compressibility, times μ, that gives the factor a pivot for every pressure; Krylov steps take
its effect away again."""


@dataclass(frozen=True)
class Spaces:
    """Finite-element spaces of velocity and pressure on one mesh.

    Attributes
    ----------
    ng, mesh : module, engine's mesh
    both, velocity : engine's spaces
        Velocity and pressure; velocity alone, the first of its unknowns.
    order : int
    free : (n,) bool
        Unknowns that aren't given.
    outward : (p, n) float64
        Flow out of each port, µL/s, is its row times the unknowns.
    """

    ng: Any
    mesh: Any
    both: Any
    velocity: Any
    order: int
    free: NDArray[np.bool_]
    outward: FloatArray

    @property
    def count(self) -> int:
        """Number of unknowns, given ones included."""
        return len(self.free)


def spaces(ng: Any, mesh: Any, ports: int, order: int, inflow: int | None) -> Spaces:
    """Spaces of this order; port ``inflow`` has its velocity given, as the wall has."""
    given = WALL_NAME if inflow is None else f"{WALL_NAME}|{port_name(inflow)}"
    velocity = ng.VectorH1(mesh, order=order, dirichlet=given)
    both = velocity * ng.H1(mesh, order=order - 1)
    free = np.fromiter(both.FreeDofs(), dtype=bool, count=both.ndof)
    outward = np.zeros((ports, both.ndof))
    for k in range(ports):
        form = ng.LinearForm(velocity)
        form += (
            velocity.TestFunction()
            * ng.specialcf.normal(3)
            * ng.ds(port_name(k), bonus_intorder=CURVED)
        )
        form.Assemble()
        outward[k, : velocity.ndof] = form.vec.FV().NumPy()
    return Spaces(ng, mesh, both, velocity, order, free, outward)


class Stokes:
    """The symmetric operator, and its factor on the free unknowns."""

    def __init__(self, spaces: Spaces, viscosity: float, rate: float = 0.0) -> None:
        """Assemble; ``rate`` is κ, Pa·s/mm²."""
        ng, self.spaces, self.viscosity, self.rate = spaces.ng, spaces, viscosity, rate
        both = spaces.both
        (u, p), (v, q) = both.TnT()
        form = ng.BilinearForm(both, symmetric=True)
        self._add_to(form, u, p, v, q)
        form += -_SLACK / viscosity * p * q * ng.dx(bonus_intorder=CURVED)
        self._form = form.Assemble()
        self._factor = form.mat.Inverse(both.FreeDofs(), inverse="sparsecholesky")
        source, target = form.mat.CreateColVector(), form.mat.CreateColVector()
        self._with_slack = matrix_operator(form.mat, source, target)
        self._slack = matrix_operator(*_pressure_mass(both, _SLACK / viscosity, ng))
        self.solve = matrix_operator(self._factor, source, target)

    def times(self, values: NDArray[Any]) -> NDArray[Any]:
        """The operator itself, without slack: cheaper to take out than to hold a second matrix."""
        product, first = self._with_slack(values), self.spaces.velocity.ndof
        product[first:] += self._slack(values[first:])
        return product

    def factor_with(
        self, convection: Convection, share: float, values: FloatArray
    ) -> Callable[[FloatArray], FloatArray]:
        """Inverse of the whole derivative at these unknowns: four times a symmetric factor."""
        ng, both = self.spaces.ng, self.spaces.both
        (u, p), (v, q) = both.TnT()
        form = ng.BilinearForm(both)
        self._add_to(form, u, p, v, q)
        convection.add_to(form, u, v, share)
        state = ng.GridFunction(both)
        state.vec.FV().NumPy()[:] = values
        form.AssembleLinearization(state.vec)
        factor = form.mat.Inverse(both.FreeDofs(), inverse="umfpack")
        return matrix_operator(factor, state.vec, state.vec.CreateVector())

    def _add_to(self, form: Any, u: Any, p: Any, v: Any, q: Any) -> None:
        ng = self.spaces.ng
        dx = ng.dx(bonus_intorder=CURVED)
        form += self.viscosity * ng.InnerProduct(ng.Grad(u), ng.Grad(v)) * dx
        if self.rate:
            form += self.rate * u * v * dx
        form += (-ng.div(v) * p - ng.div(u) * q) * dx


def matrix_operator(
    matrix: Any, source: Any, target: Any
) -> Callable[[NDArray[Any]], NDArray[Any]]:
    """The engine's matrix as a function of arrays, by these two of its vectors."""
    read, write = source.FV().NumPy(), target.FV().NumPy()

    def applied(values: NDArray[Any]) -> NDArray[Any]:
        read[:] = values
        matrix.Mult(source, target)
        return write.copy()

    return applied


def _pressure_mass(both: Any, factor: float, ng: Any) -> tuple[Any, Any, Any]:
    """∫ p q times a factor, as the engine's matrix, and two vectors for it."""
    p, q = both.components[1].TnT()
    form = ng.BilinearForm(both.components[1], symmetric=True)
    form += factor * p * q * ng.dx(bonus_intorder=CURVED)
    form.Assemble()
    return form.mat, form.mat.CreateColVector(), form.mat.CreateColVector()


class Convection:
    """Inertia of flow that turns and narrows, ϱ ∫ (u·∇)u·v.

    At outlets -½ ϱ ∫ min(u·n, 0) u·v is added, so that backflow feeds no energy in (Bazilevs et
    al. 2009, doi 10.1016/j.cma.2009.04.015, with β = 1): nothing where flow leaves.
    """

    def __init__(self, spaces: Spaces, density: float, outlets: tuple[int, ...]) -> None:
        self.spaces, ng, space = spaces, spaces.ng, spaces.velocity
        self.density, self.outlets = density, outlets
        self._form = ng.BilinearForm(space)
        u, v = space.TnT()
        self.add_to(self._form, u, v, 1.0)
        self._state = ng.GridFunction(space)
        self._in, self._out = (self._state.vec.CreateVector() for _ in range(2))

    def add_to(self, form: Any, u: Any, v: Any, share: float) -> None:
        """Add this share of its terms to a form of the engine's."""
        ng, inertia = self.spaces.ng, share * self.density
        form += inertia * (ng.Grad(u) * u) * v * ng.dx(bonus_intorder=CURVED)
        if self.outlets:
            out = u * ng.specialcf.normal(3)
            names = "|".join(port_name(k) for k in self.outlets)
            form += (
                -0.5
                * inertia
                * ng.IfPos(out, 0.0, out)
                * (u * v)
                * ng.ds(names, bonus_intorder=CURVED)
            )

    def force(self, values: FloatArray) -> FloatArray:
        """Its vector at these unknowns, (n,)."""
        self._in.FV().NumPy()[:] = values[: self.spaces.velocity.ndof]
        self._form.Apply(self._in, self._out)
        vector = np.zeros(self.spaces.count)
        vector[: self.spaces.velocity.ndof] = self._out.FV().NumPy()
        return vector

    def derivative(self, values: FloatArray) -> Callable[[FloatArray], FloatArray]:
        """Its derivative there, as a function of changes."""
        self._in.FV().NumPy()[:] = values[: self.spaces.velocity.ndof]
        self._form.AssembleLinearization(self._in)
        return self._padded(matrix_operator(self._form.mat, self._in.CreateVector(), self._out))

    def _padded(
        self, inner: Callable[[NDArray[Any]], NDArray[Any]]
    ) -> Callable[[FloatArray], FloatArray]:
        count = self.spaces.velocity.ndof

        def applied(change: FloatArray) -> FloatArray:
            padded = np.zeros_like(change)
            padded[:count] = inner(change[:count])
            return padded

        return applied
