"""Assemble the 3D Navier–Stokes equations; solve them by damped Newton steps from Stokes flow.

Velocities of degree k and pressures of degree k - 1, continuous, on curved tetrahedra (Taylor &
Hood 1973, doi 10.1016/0045-7930(73)90027-3). The weak form of Stokes flow is

    ∫ μ ∇u:∇v + κ ∫ u·v - ∫ p ∇·v + ∫ q ∇·u + Σ p_k ∫_k v·n = 0

with the wall's and a profile's velocities given; κ is 0, or ϱ over a time.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.three_d.engine import CURVED, WALL_NAME, fits_general, port_name
from kernels.arrays import BoolArray, FloatArray

Array = NDArray[Any]
Apply = Callable[[Array], Array]


class _Limits(NamedTuple):
    """Limits of Newton's and of Krylov's steps."""

    slack: float = 1e-7  # compressibility times μ, for pivots; Krylov steps undo its effect
    tolerance: float = 1e-8  # residual of steady flow over that of no flow
    newton_steps: int = 25
    loads: int = 4  # of convection where the whole at once fails; ten found nothing more
    least_damping: float = 1.0 / 32.0  # shortest part of a Newton step
    forcing: float = 1e-3  # least relative residual that a linear solve leaves
    stale: float = 0.2  # part of the residual above which a new derivative is made
    krylov_steps: int = 150
    steady_krylov: int = 60  # by the symmetric factor, before the whole derivative's is made
    pulsatile_krylov: int = 8  # the same in time, where one factor serves all steps
    basis_growth: int = 24  # vectors added to Krylov's basis at a time


_LIMITS: Final = _Limits()


@dataclass(frozen=True)
class Spaces:
    """Finite-element spaces of velocity and pressure on one mesh."""

    ng: Any  # NGSolve's module
    mesh: Any
    both: Any  # velocity and pressure
    velocity: Any  # alone: the first of the unknowns
    order: int
    free: BoolArray  # (n,), unknowns that aren't given
    outward: FloatArray  # (p, n): times the unknowns, the flow out of each port, µL/s

    @property
    def count(self) -> int:
        """Return the number of unknowns, given ones included."""
        return len(self.free)


def spaces(ng: Any, mesh: Any, ports: int, order: int, inflow: int | None) -> Spaces:
    """Make spaces of this order; port ``inflow`` has its velocity given, as the wall has."""
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
        form += -_LIMITS.slack / viscosity * p * q * ng.dx(bonus_intorder=CURVED)
        self._form = form.Assemble()
        self._factor = form.mat.Inverse(both.FreeDofs(), inverse="sparsecholesky")
        source, target = form.mat.CreateColVector(), form.mat.CreateColVector()
        self._with_slack = matrix_operator(form.mat, source, target)
        self._slack = matrix_operator(*_pressure_mass(both, _LIMITS.slack / viscosity, ng))
        self.solve = matrix_operator(self._factor, source, target)

    def times(self, values: Array) -> Array:
        """Apply the operator without slack, which is cheaper to take out than a second matrix."""
        product, first = self._with_slack(values), self.spaces.velocity.ndof
        product[first:] += self._slack(values[first:])
        return product

    def factor_with(self, convection: Convection, share: float, values: FloatArray) -> Apply:
        """Invert the whole derivative here, in four times a symmetric factor's memory."""
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


def matrix_operator(matrix: Any, source: Any, target: Any) -> Apply:
    """Return an NGSolve matrix as a function of arrays, by these two of its vectors."""
    read, write = source.FV().NumPy(), target.FV().NumPy()

    def applied(values: Array) -> Array:
        read[:] = values
        matrix.Mult(source, target)
        return write.copy()

    return applied


def _pressure_mass(both: Any, factor: float, ng: Any) -> tuple[Any, Any, Any]:
    p, q = both.components[1].TnT()
    form = ng.BilinearForm(both.components[1], symmetric=True)
    form += factor * p * q * ng.dx(bonus_intorder=CURVED)
    form.Assemble()
    return form.mat, form.mat.CreateColVector(), form.mat.CreateColVector()


class Convection:
    """Inertia, ϱ ∫ (u·∇)u·v.

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

    def derivative(self, values: FloatArray) -> Apply:
        """Its derivative there, as a function of changes."""
        self._in.FV().NumPy()[:] = values[: self.spaces.velocity.ndof]
        self._form.AssembleLinearization(self._in)
        inner = matrix_operator(self._form.mat, self._in.CreateVector(), self._out)
        return on_velocity(inner, self.spaces.velocity.ndof)


def on_velocity(inner: Apply, count: int) -> Apply:
    """Return a function of velocities as one of all unknowns, 0 for pressures."""

    def applied(values: Array) -> Array:
        whole = np.zeros_like(values)
        whole[:count] = inner(values[:count])
        return whole

    return applied


class BorderedSolver:
    """Linear systems of the finite-element unknowns x and the unknown port pressures λ.

    A x + B λ = r,    Bᵀ x - D λ = s

    B's columns (n, m) are the flows out of ports, D (m,) what an outlet lets through for its
    pressure. Solved by GMRES on the whole, preconditioned by a factor of A's symmetric part, or of
    A at an earlier state, bordered exactly: ``answered`` is its solution for B's columns.
    """

    def __init__(self, factor: Apply, columns: Array, slope: Array, free: BoolArray) -> None:
        self.factor, self.slope, self.free = factor, slope, free
        self.columns = columns = columns * free[:, None]
        self.answered = (
            np.stack([factor(c) for c in columns.T], axis=1) if columns.size else columns
        )
        self.schur = np.diag(slope) + columns.T @ self.answered

    def with_factor(self, factor: Apply) -> BorderedSolver:
        """Return the same with another factor."""
        return BorderedSolver(factor, self.columns, self.slope, self.free)

    def precondition(self, whole: Array) -> Array:
        """Solve with the factor in the place of A."""
        count = len(self.free)
        x = self.factor(whole[:count])
        if not len(self.slope):
            return x
        multiplier = np.linalg.solve(self.schur, self.columns.T @ x - whole[count:])
        return np.concatenate([x - self.answered @ multiplier, multiplier])

    def solve(self, times: Apply, right: Array, rtol: float, steps: int) -> tuple[Array, int]:
        """Solve for x and λ, where ``times`` is A; also return the number of Krylov steps.

        Raises
        ------
        FlowError
            When they don't converge.
        """
        count = len(self.free)

        def operator(whole: Array) -> Array:
            x, multiplier = whole[:count], whole[count:]
            first = self.free * (times(x) + self.columns @ multiplier)
            return np.concatenate([first, self.columns.T @ x - self.slope * multiplier])

        return _gmres(operator, self.precondition, right, rtol, steps)


@dataclass(frozen=True)
class FlowProblem:
    """A steady system and its given values."""

    spaces: Spaces
    stokes: Stokes
    convection: Convection | None
    border: BorderedSolver
    start: FloatArray  # (n,), given velocities, 0 elsewhere
    load: FloatArray  # (n,), force of the given pressures
    given: FloatArray  # (m,), right side of the border's rows

    def residual(self, whole: FloatArray, share: float) -> FloatArray:
        """Return the equations' residual at x and λ."""
        x, multiplier = np.split(whole, [self.spaces.count])
        force = self.stokes.times(x) + self.border.columns @ multiplier - self.load
        if self.convection is not None and share > 0.0:
            force += share * self.convection.force(x)
        rows = self.border.columns.T @ x - self.border.slope * multiplier
        return np.concatenate([self.spaces.free * force, rows - self.given])


@dataclass(frozen=True)
class NewtonSolution:
    """A solution, and the steps taken."""

    unknowns: FloatArray  # (n + m,)
    residual: FloatArray  # (k,), after each of Newton's steps, over that of no flow
    krylov: int  # linear steps in all


def solve_newton(problem: FlowProblem, reynolds: float = float("nan")) -> NewtonSolution:
    """Solve Stokes flow, then Navier–Stokes from it: at once, or by ever more convection.

    Raises
    ------
    FlowError
        When it doesn't converge, with the numbers.
    """
    whole = np.concatenate([problem.start, np.zeros(len(problem.given))])
    scale = float(np.linalg.norm(problem.residual(whole, 0.0)))
    if scale == 0.0:
        return NewtonSolution(whole, np.zeros(1), 0)
    limit = _LIMITS.tolerance * scale
    first = newton(problem, whole, 0.0, limit, scale)
    if problem.convection is None:
        return first
    for shares in (1, _LIMITS.loads):
        steps, solution = first.krylov, first
        try:
            for share in np.arange(1, shares + 1) / shares:
                solution = newton(problem, solution.unknowns, share, limit, scale)
                steps += solution.krylov
            return replace(solution, krylov=steps)
        except FlowError as error:
            why = error
    where = "" if np.isnan(reynolds) else f" at Reynolds number {reynolds:.0f}"
    raise FlowError(
        f"no steady flow found{where}: {why}; lower the flow, refine "
        "the mesh, or solve the pulsatile problem, since the flow may not be steady"
    )


def newton(
    problem: FlowProblem,
    whole: FloatArray,
    share: float,
    limit: float,
    scale: float,
    guide: Guide | None = None,
) -> NewtonSolution:
    """Take Newton's steps with a share of convection until the residual is ``limit``.

    Raises
    ------
    FlowError
        When they don't get there.
    """
    residual, guide = problem.residual(whole, share), guide or Guide(problem)
    norms, before = [float(np.linalg.norm(residual))], guide.krylov
    for _ in range(_LIMITS.newton_steps):
        if norms[-1] <= limit:
            return NewtonSolution(whole, np.array(norms) / scale, guide.krylov - before)
        # No more digits of the linear system than the next residual can use.
        rtol = max(0.5 * limit / norms[-1], 1e-12 if share == 0.0 else _LIMITS.forcing)
        was_old = guide.old
        change = guide.change(whole, residual, share, rtol)
        try:
            whole, residual = _damped(problem, whole, change, share, norms[-1])
        except FlowError:
            if not was_old:
                raise
        norms.append(float(np.linalg.norm(residual)))
        if norms[-1] > _LIMITS.stale * norms[-2]:
            guide.forget()
    raise FlowError(
        f"{_LIMITS.newton_steps} of Newton's steps leave {norms[-1] / scale:.2g} of the residual"
    )


class Guide:
    """The derivative of Newton's steps, and a factor that preconditions it.

    By the symmetric factor a Newton step takes some 12 Krylov steps at Reynolds numbers near 10, 30
    near 50 and above 100 from there on; then a factor of the whole derivative is made, which costs
    four times the memory, and kept until it is too old. A lazy guide also keeps its derivative
    from time step to time step, while the residual falls by it.
    """

    def __init__(self, problem: FlowProblem, *, lazy: bool = False) -> None:
        self.problem, self.border, self.lazy, self.krylov = problem, problem.border, lazy, 0
        self.symmetric_steps = _LIMITS.pulsatile_krylov if lazy else _LIMITS.steady_krylov
        self._times: Apply | None = None

    @property
    def old(self) -> bool:
        """Return whether the derivative is of an earlier state."""
        return self.lazy and self._times is not None

    def forget(self) -> None:
        """Discard the derivative; the next step makes a new one."""
        self._times = None

    def change(
        self, whole: FloatArray, residual: FloatArray, share: float, rtol: float
    ) -> FloatArray:
        """Solve for Newton's step."""
        problem, x = self.problem, whole[: self.problem.spaces.count]
        if problem.convection is None or share == 0.0:
            return self._solved(problem.stokes.times, residual, rtol)
        if not self.old:
            self._times = self._derivative(problem.convection, x, share)
        times = self._times or problem.stokes.times
        try:
            return self._solved(times, residual, rtol, self.symmetric_steps)
        except FlowError:
            if not fits_general(problem.spaces.count):
                return self._solved(times, residual, rtol)
            factor = problem.stokes.factor_with(problem.convection, share, x)
            self.border = problem.border.with_factor(factor)
            return self._solved(times, residual, rtol)

    def _derivative(self, convection: Convection, x: FloatArray, share: float) -> Apply:
        derivative, stokes = convection.derivative(x), self.problem.stokes

        def times(change: FloatArray) -> FloatArray:
            return stokes.times(change) + share * derivative(change)

        return times

    def _solved(
        self, times: Apply, residual: FloatArray, rtol: float, limit: int = _LIMITS.krylov_steps
    ) -> FloatArray:
        solved, steps = self.border.solve(times, -residual, rtol, limit)
        self.krylov += steps
        return solved


def _damped(
    problem: FlowProblem, whole: FloatArray, change: FloatArray, share: float, norm: float
) -> tuple[FloatArray, FloatArray]:
    """Halve the step until the residual falls enough."""
    part = 1.0
    while part >= _LIMITS.least_damping:
        new = whole + part * change
        residual = problem.residual(new, share)
        if float(np.linalg.norm(residual)) < (1.0 - 0.1 * part) * norm:
            return new, residual
        part *= 0.5
    raise FlowError(f"Newton's step doesn't lower the residual even at {part:.2g} of its length")


def _gmres(
    operator: Apply, precondition: Apply, right: Array, rtol: float, steps: int
) -> tuple[Array, int]:
    """Right-preconditioned, so that it measures the true residual (Saad 2003, §9.3.2)."""
    norm = float(np.linalg.norm(right))
    if norm == 0.0:
        return np.zeros_like(right), 0
    basis = np.empty((min(steps, _LIMITS.basis_growth) + 1, len(right)), dtype=right.dtype)
    basis[0] = right / norm
    hessenberg = np.zeros((steps + 1, steps), dtype=right.dtype)
    for k in range(steps):
        new = operator(precondition(basis[k]))
        for _ in range(2):  # twice is enough to stay orthogonal
            part = basis[: k + 1] @ new
            hessenberg[: k + 1, k] += part
            new = new - part @ basis[: k + 1]
        hessenberg[k + 1, k] = np.linalg.norm(new)
        weight, left = _least(hessenberg[: k + 2, : k + 1], norm)
        if left <= rtol:
            return precondition(weight @ basis[: k + 1]), k + 1
        if k + 2 > len(basis):
            more = np.empty((_LIMITS.basis_growth, len(right)), dtype=right.dtype)
            basis = np.concatenate([basis, more])
        basis[k + 1] = new / hessenberg[k + 1, k]
    raise FlowError(
        f"the linear solver is left with {left:.2g} of its residual after {steps} steps "
        f"({rtol:.1g} wanted): convection is too strong for it; lower the flow, or refine the mesh"
    )


def _least(square: Array, norm: float) -> tuple[Array, float]:
    """Return the basis' weights of least residual, and the part of it that they leave."""
    target = np.zeros(len(square), dtype=square.dtype)
    target[0] = norm
    weight = np.linalg.lstsq(square, target, rcond=None)[0]
    return weight, float(np.linalg.norm(square @ weight - target)) / norm
