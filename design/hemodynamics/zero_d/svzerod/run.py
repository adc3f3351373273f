"""Time-step an svZeroDSolver case through its cycles; keep the requested variables."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod.case import SvZeroDCase
from design.hemodynamics.zero_d.svzerod.elements import CONDITIONS
from design.hemodynamics.zero_d.svzerod.generalised_alpha import Pace, State
from design.hemodynamics.zero_d.svzerod.march import Stepper
from design.hemodynamics.zero_d.svzerod.size import MOST_CYCLES, check_size, windkessel_cycles
from design.hemodynamics.zero_d.svzerod.system import (
    Variables,
    start_of,
    system_of,
    unused_initial,
    variables_of,
)
from kernels.arrays import FloatArray, IntArray

PERIODIC = 1e-6
"""Largest change over a cycle, relative to the largest value, of a periodic state."""
_STEADY_STEPS = 31
_STEADY_PARTS = 10.0


@dataclass(frozen=True)
class SvZeroDRun:
    """Stepped case, at the times that the file asks for.

    Attributes
    ----------
    names : tuple of str
        Of the variables kept: all, or flow in, flow out, pressure in and pressure out of each
        vessel, one kind after the other.
    time : (t,) float64
    value, rate : (t, k) float64
        Of the variables kept; ``rate`` is (t, 0) where it isn't asked for.
    cycles : int
        Gone through.
    change : float
        From begin to end of the last cycle, relative to the largest value of its kind.
    unused : tuple of str
        Initial values that the file gives for no variable of its model.
    """

    names: tuple[str, ...]
    time: FloatArray
    value: FloatArray
    rate: FloatArray
    cycles: int
    change: float
    unused: tuple[str, ...] = ()

    @property
    def periodic(self) -> bool:
        """Whether the last cycle ended as it began."""
        return self.change <= PERIODIC


def run_svzerod(case: SvZeroDCase) -> SvZeroDRun:
    """Step through the case's cycles.

    Raises
    ------
    FlowError
        As `Stepper.advance`, for steps or results without end, and when numbers overflow.
    """
    with np.errstate(over="ignore", invalid="ignore"):  # told at the end
        return _run(case)


def _run(case: SvZeroDCase) -> SvZeroDRun:
    variables, sampler = variables_of(case), case.tables.sampler()
    state = State(*start_of(case, variables.names))
    sampled = sampler.at(np.zeros(1))[0]
    if case.options.steady_initial:
        sampled = sampler.mean()
        state = _steady(case, variables, sampled, state)
    system = system_of(variables, sampled, state.value, state.rate, steady=False)
    check_size(case, len(wanted_variables(case, len(variables.names))))
    step = case.period / (case.options.points - 1)
    stepper = Stepper(system, sampler, case.period, _pace(case, step))
    return _Recorder(case, variables, stepper, step).run(state)


def _steady(case: SvZeroDCase, variables: Variables, sampled: FloatArray, state: State) -> State:
    """Return the state after svZeroDSolver's 31 steps of a tenth of the period.

    Tables are their mean there, and outlets store nothing.
    """
    system = system_of(variables, sampled, state.value, state.rate, steady=True)
    pace = _pace(case, case.period / _STEADY_PARTS)
    *_, last = Stepper(system, sampled, case.period, pace).march(state, 0, _STEADY_STEPS)
    return last


def _pace(case: SvZeroDCase, step: float) -> Pace:
    how = case.options
    return Pace(step, how.rho_infty, how.absolute_tolerance, how.maximum_nonlinear_iterations)


class _Recorder:
    """Steps of a run, and the states among them that the file asks for."""

    def __init__(
        self, case: SvZeroDCase, variables: Variables, stepper: Stepper, step: float
    ) -> None:
        self.case, self.names, self.stepper, self.step = case, variables.names, stepper, step
        self.steps = case.options.points - 1
        self.ends, self.wanted = _ends(case), wanted_variables(case, len(variables.names))
        self.kept: list[tuple[int, FloatArray, FloatArray]] = []

    def run(self, state: State) -> SvZeroDRun:
        how = self.case.options
        cycles = windkessel_cycles(self.case)
        asked = how.cycle_error if cycles is None else None
        cycles = how.cycles if cycles is None else cycles
        means: list[FloatArray] = []
        done = 0
        while True:
            begin = State(state.value.copy(), state.rate.copy())
            if not how.output_all_cycles:
                self.kept.clear()
            state, mean = self._cycle(state, done)
            means.append(mean)
            done += 1
            if done >= cycles and (asked is None or _same(means, asked)):
                break
            if done >= MOST_CYCLES and asked is not None:
                raise FlowError(
                    f"means still change after {done:,} cycles (sim_cycle_to_cycle_percent_error); "
                    "allow more, or leave use_cycle_to_cycle_error out"
                )
        return self._result(done, begin, state)

    def _cycle(self, state: State, done: int) -> tuple[State, FloatArray]:
        """Step through one cycle; also return the mean of flow and pressure at the ends."""
        every, start = self.case.options.output_interval, done * self.steps
        if not self.kept:
            self._keep(start, state)
        total = state.value[self.ends].copy()
        marched = self.stepper.march(state, start, self.steps)
        for number, state in enumerate(marched, start + 1):
            total += state.value[self.ends]
            if (number - self.kept[0][0]) % every == 0:
                self._keep(number, state)
        return state, total / (self.steps + 1)

    def _keep(self, number: int, state: State) -> None:
        rated = self.wanted if self.case.options.output_derivative else self.wanted[:0]
        self.kept.append((number, state.value[self.wanted], state.rate[rated]))

    def _result(self, cycles: int, begin: State, end: State) -> SvZeroDRun:
        number, value, rate = (np.array(part) for part in zip(*self.kept, strict=True))
        if not (np.isfinite(value).all() and np.isfinite(rate).all()):
            raise FlowError("the solution isn't finite; check values for their size and sign")
        names = tuple(self.names[k] for k in self.wanted.tolist())
        change = _change(self.names, begin.value, end.value)
        time, unused = self.step * (number - number[0]), unused_initial(self.case, self.names)
        return SvZeroDRun(names, time, value, rate, cycles, change, unused)


def wanted_variables(case: SvZeroDCase, count: int) -> IntArray:
    """Return the variables to keep, as `SvZeroDRun` orders them."""
    if case.options.output_variable_based:
        return np.arange(count)
    vessels = case.written
    into = 2 * np.array([vessel.inlets[0] for vessel in vessels], dtype=np.int64)
    out = 2 * np.array([vessel.outlets[0] for vessel in vessels], dtype=np.int64)
    return np.concatenate([into, out, into + 1, out + 1])


def _same(means: list[FloatArray], error: float) -> bool:
    """Whether the last two cycles' means differ by no more than the error asks."""
    before, after = means[-2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return not (np.abs((after - before) / before) > error).any()


def _ends(case: SvZeroDCase) -> IntArray:
    """Return the variables at the network's ends: at an outlet, else at an inlet."""
    conditions = {b.name for b in case.blocks if b.kind in CONDITIONS}
    variables = []
    for vessel in case.blocks[: case.vessels]:
        for connection, side in ((vessel.outlets[0], 1), (vessel.inlets[0], 0)):
            if case.connections[connection].split(":")[side] in conditions:
                variables += [2 * connection, 2 * connection + 1]
                break
    return np.array(variables, dtype=np.int64)


def _change(names: tuple[str, ...], begin: FloatArray, end: FloatArray) -> float:
    worst = 0.0
    for kind in ("flow:", "pressure:"):
        of_kind = np.array([name.startswith(kind) for name in names])
        size = float(np.abs(end[of_kind]).max(initial=0.0))
        if size > 0.0:
            worst = max(worst, float(np.abs(end - begin)[of_kind].max()) / size)
    return worst
