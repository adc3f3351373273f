"""Solve the steady 3D Navier–Stokes equations by damped Newton steps from Stokes flow."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from design.errors import FlowError
from design.hemodynamics.three_d.options import fits_general
from design.hemodynamics.three_d.stokes import Convection, Spaces, Stokes
from kernels.arrays import FloatArray

_STEPS: Final = 25
_LEAST_DAMPING: Final = 1.0 / 32.0
_FORCING: Final = 1e-3
_PATIENCE: Final = 60
_PATIENCE_IN_TIME: Final = 8
"""A factor that serves all time steps is worth its making much sooner."""
_FALLS: Final = 0.2
_LOADS: Final = ((1.0,), (0.25, 0.5, 0.75, 1.0), tuple(np.linspace(0.1, 1.0, 10)))
"""Shares of convection gone through, tried in turn."""


# Solve finite-element linear systems together with a few unknown port pressures, by GMRES.
#
# A x + B λ = r,    Bᵀ x - D λ = s
#
# where B's columns are the flows out of ports and D what an outlet lets through for its pressure.
# Krylov steps (GMRES) on the whole, preconditioned by a factor of A's symmetric part, or of A at an
# earlier state, bordered exactly: one solve a column, once.

Array = NDArray[Any]


@dataclass(frozen=True)
class BorderBlocks:
    """B (n, m), D (m,), and the factor's answer to B's columns."""

    columns: Array
    slope: Array
    answered: Array
    schur: Array

    @staticmethod
    def around(solve: Apply, columns: Array, slope: Array, free: NDArray[np.bool_]) -> BorderBlocks:
        """Prepare for a factor."""
        columns = columns * free[:, None]
        answered = np.stack([solve(c) for c in columns.T], axis=1) if columns.size else columns
        return BorderBlocks(columns, slope, answered, np.diag(slope) + columns.T @ answered)


@dataclass(frozen=True)
class FlowProblem:
    """A steady system: what is given, and what unknown pressures hang on.

    Attributes
    ----------
    spaces : Spaces
    stokes : Stokes
    convection : Convection or None
    border : BorderBlocks
    start : (n,) float64
        Given velocities, 0 elsewhere.
    load : (n,) float64
        Force of the given pressures.
    given : (m,) float64
        Right side of the border's rows.
    """

    spaces: Spaces
    stokes: Stokes
    convection: Convection | None
    border: BorderBlocks
    start: FloatArray
    load: FloatArray
    given: FloatArray

    def residual(self, whole: FloatArray, share: float) -> FloatArray:
        """What is left of the equations at x and λ."""
        x, multiplier = np.split(whole, [self.spaces.count])
        force = self.stokes.times(x) + self.border.columns @ multiplier - self.load
        if self.convection is not None and share > 0.0:
            force += share * self.convection.force(x)
        rows = self.border.columns.T @ x - self.border.slope * multiplier
        return np.concatenate([self.spaces.free * force, rows - self.given])


@dataclass(frozen=True)
class NewtonSolution:
    """A solution and the way to it.

    Attributes
    ----------
    unknowns : (n + m,) float64
    residual : (k,) float64
        After each of Newton's steps, of that of no flow.
    krylov : int
        Linear steps, all together.
    """

    unknowns: FloatArray
    residual: FloatArray
    krylov: int


def solve_newton(problem: FlowProblem, tolerance: float, reynolds: float) -> NewtonSolution:
    """Solve Stokes flow, then Navier–Stokes from it.

    Raises
    ------
    FlowError
        When it doesn't converge, with the numbers.
    """
    whole = np.concatenate([problem.start, np.zeros(len(problem.given))])
    scale = float(np.linalg.norm(problem.residual(whole, 0.0)))
    if scale == 0.0:
        return NewtonSolution(whole, np.zeros(1), 0)
    first = newton(problem, whole, 0.0, tolerance * scale, scale)
    if problem.convection is None:
        return first
    for loads in _LOADS:
        try:
            return _led(problem, first, loads, tolerance * scale, scale)
        except FlowError as error:
            why = error
    raise FlowError(
        f"no steady flow found{_at(reynolds)}: {why}; lower the flow, refine "
        "the mesh, or solve the pulsatile problem, since the flow may not be steady"
    )


def _at(reynolds: float) -> str:
    return "" if np.isnan(reynolds) else f" at Reynolds number {reynolds:.0f}"


def _led(
    problem: FlowProblem,
    solution: NewtonSolution,
    loads: tuple[float, ...],
    limit: float,
    scale: float,
) -> NewtonSolution:
    steps = solution.krylov
    for share in loads:
        solution = newton(problem, solution.unknowns, share, limit, scale)
        steps += solution.krylov
    return NewtonSolution(solution.unknowns, solution.residual, steps)


def newton(
    problem: FlowProblem,
    whole: FloatArray,
    share: float,
    limit: float,
    scale: float,
    guide: Guide | None = None,
) -> NewtonSolution:
    """Newton's steps from ``whole`` with a share of convection, until the residual is ``limit``.

    Raises
    ------
    FlowError
        When they don't get there.
    """
    residual, guide = problem.residual(whole, share), guide or Guide(problem)
    norms, before = [float(np.linalg.norm(residual))], guide.krylov
    for _ in range(_STEPS):
        if norms[-1] <= limit:
            return NewtonSolution(whole, np.array(norms) / scale, guide.krylov - before)
        # No more digits of the linear system than the next residual can use.
        rtol = max(0.5 * limit / norms[-1], 1e-12 if share == 0.0 else _FORCING)
        was_old = guide.old
        change = guide.change(whole, residual, share, rtol)
        try:
            whole, residual = _damped(problem, whole, change, share, norms[-1])
        except FlowError:
            if not was_old:
                raise
        norms.append(float(np.linalg.norm(residual)))
        if norms[-1] > _FALLS * norms[-2]:
            guide.forget()
    raise FlowError(f"{_STEPS} of Newton's steps leave {norms[-1] / scale:.2g} of the residual")


class Guide:
    """What linear steps go by: a derivative, and a factor that preconditions it.

    The symmetric factor takes some 12 Krylov steps a Newton step at Reynolds numbers near 10, 30
    near 50 and above 100 from there on; then one of the whole derivative is made, which costs four
    times the memory, and kept until it is too old. A lazy guide keeps its derivative, too, from
    time step to time step, while the residual falls by it.
    """

    def __init__(self, problem: FlowProblem, *, lazy: bool = False) -> None:
        self.problem, self.border, self.lazy, self.krylov = problem, problem.border, lazy, 0
        self.solve = problem.stokes.solve
        self.patience = _PATIENCE_IN_TIME if lazy else _PATIENCE
        self._times: Apply | None = None

    @property
    def old(self) -> bool:
        """Whether the derivative is of an earlier state."""
        return self.lazy and self._times is not None

    def forget(self) -> None:
        """Make a new derivative for the next step."""
        self._times = None

    def change(
        self, whole: FloatArray, residual: FloatArray, share: float, rtol: float
    ) -> FloatArray:
        """Newton's step."""
        problem, x = self.problem, whole[: self.problem.spaces.count]
        if problem.convection is None or share == 0.0:
            return self._solved(problem.stokes.times, residual, rtol, STEPS)
        if not self.old:
            self._times = self._derivative(problem.convection, x, share)
        times = self._times or problem.stokes.times
        try:
            return self._solved(times, residual, rtol, self.patience)
        except FlowError:
            if not fits_general(problem.spaces.count):
                return self._solved(times, residual, rtol, STEPS)
            self.solve = problem.stokes.factor_with(problem.convection, share, x)
            columns, slope = problem.border.columns, problem.border.slope
            self.border = BorderBlocks.around(self.solve, columns, slope, problem.spaces.free)
            return self._solved(times, residual, rtol, STEPS)

    def _derivative(self, convection: Convection, x: FloatArray, share: float) -> Apply:
        derivative, stokes = convection.derivative(x), self.problem.stokes

        def times(change: FloatArray) -> FloatArray:
            return stokes.times(change) + share * derivative(change)

        return times

    def _solved(self, times: Apply, residual: FloatArray, rtol: float, limit: int) -> FloatArray:
        free = self.problem.spaces.free
        solved, steps = solve_bordered(times, self.solve, self.border, -residual, free, rtol, limit)
        self.krylov += steps
        return solved


def _damped(
    problem: FlowProblem, whole: FloatArray, change: FloatArray, share: float, norm: float
) -> tuple[FloatArray, FloatArray]:
    """The longest of ever shorter steps that lowers the residual."""
    part = 1.0
    while part >= _LEAST_DAMPING:
        new = whole + part * change
        residual = problem.residual(new, share)
        if float(np.linalg.norm(residual)) < (1.0 - 0.1 * part) * norm:
            return new, residual
        part *= 0.5
    raise FlowError(f"Newton's step doesn't lower the residual even at {part:.2g} of its length")


Apply = Callable[[Array], Array]
STEPS: Final = 150
"""Krylov steps at most, unless told."""
_CHUNK: Final = 24


def solve_bordered(
    times: Apply,
    solve: Apply,
    border: BorderBlocks,
    right: Array,
    free: NDArray[np.bool_],
    rtol: float,
    steps: int = STEPS,
) -> tuple[Array, int]:
    """The unknowns x and λ, one after the other, and the Krylov steps taken.

    Raises
    ------
    FlowError
        When they don't converge.
    """
    count = len(free)

    def operator(whole: Array) -> Array:
        x, multiplier = whole[:count], whole[count:]
        first = free * (times(x) + border.columns @ multiplier)
        return np.concatenate([first, border.columns.T @ x - border.slope * multiplier])

    def precondition(whole: Array) -> Array:
        x = solve(whole[:count])
        if not len(border.slope):
            return x
        multiplier = np.linalg.solve(border.schur, border.columns.T @ x - whole[count:])
        return np.concatenate([x - border.answered @ multiplier, multiplier])

    return _gmres(operator, precondition, right, rtol, steps)


def _gmres(
    operator: Apply, precondition: Apply, right: Array, rtol: float, steps: int
) -> tuple[Array, int]:
    """Right-preconditioned, so that it measures the true residual (Saad 2003, §9.3.2)."""
    norm = float(np.linalg.norm(right))
    if norm == 0.0:
        return np.zeros_like(right), 0
    basis = np.empty((min(steps, _CHUNK) + 1, len(right)), dtype=right.dtype)
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
            basis = np.concatenate([basis, np.empty((_CHUNK, len(right)), dtype=right.dtype)])
        basis[k + 1] = new / hessenberg[k + 1, k]
    raise FlowError(
        f"the linear solver is left with {left:.2g} of its residual after {steps} steps "
        f"({rtol:.1g} asked): convection is too strong for it; lower the flow, or refine the mesh"
    )


def _least(square: Array, norm: float) -> tuple[Array, float]:
    """Weights of the basis that leave the least of the residual, and what part they leave."""
    target = np.zeros(len(square), dtype=square.dtype)
    target[0] = norm
    weight = np.linalg.lstsq(square, target, rcond=None)[0]
    return weight, float(np.linalg.norm(square @ weight - target)) / norm
