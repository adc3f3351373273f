"""Solve 1D pulse-wave flow in a network, cycle by cycle until it repeats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from design.errors import FlowError
from design.hemodynamics.conditions import PulsatileConditions
from design.hemodynamics.one_d.grid import (
    KIND,
    Grid,
    Nodes,
    OneDOptions,
    check_compliant,
    make_grid,
    place_nodes,
)
from design.hemodynamics.one_d.kernels import MarchScratch, State, make_work
from design.hemodynamics.one_d.march import (
    LumpedForecast,
    advance,
    all_pressures,
    first_state,
    lumped_extremes,
    lumped_state,
    settle_ends,
    with_small_changes,
)
from design.hemodynamics.one_d.solution import OneDSolution
from design.hemodynamics.probes import Probes, ProbeWaves, midpoints
from design.hemodynamics.vessel_coefficients import plug_inertance, wave_speed
from design.hemodynamics.waveforms import Waveform, common_period
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

Progress = Callable[[int, float], None]
"""Called with each cycle's number and how much it changed."""


@dataclass(frozen=True)
class OneDProblem:
    """A network under conditions, cut into cells.

    Attributes
    ----------
    grid : Grid
    nodes : Nodes
    slot : (m,) int64
        Of `nodes`, for each of the network's.
    waves : tuple of Waveform
        What drives it.
    period_s : float, s
        1 where nothing changes.
    state : State
        To begin with; the march changes it.
    rate : float, 1/s
        Cells that the fastest wave runs.
    """

    grid: Grid
    nodes: Nodes
    slot: IntArray
    waves: tuple[Waveform, ...]
    period_s: float
    state: State
    rate: float

    def drives(self, times: FloatArray) -> FloatArray:
        """Waves at times, (t, w)."""
        return np.ascontiguousarray(np.array([w.at(times) for w in self.waves]).T)


def solve_one_d(
    network: VesselNetwork,
    conditions: PulsatileConditions,
    options: OneDOptions | None = None,
    progress: Progress | None = None,
) -> OneDSolution:
    """Find the periodic state of 1D flow.

    A_t + Q_x = 0, Q_t + (α Q²/A)_x + (A/ϱ) p_x = -2 (ζ + 2) π μ Q/(ϱ A), p = P + K (√(A/A₀) - 1)
    with P outside, in vessels whose radii are those of rest; mass and total pressure at
    junctions. ``profile`` of the conditions is the lumped model's: here the profile is that of
    the options.

    Raises
    ------
    FlowError
        A rigid wall, conditions that `solve_pulsatile` refuses, a vessel that collapses or in
        which flow outruns its waves, no periodic state after `most_cycles`.
    """
    options = options or OneDOptions()
    places = midpoints(network)
    if options.probes is not None:
        options.probes.check(network)
        places = Probes(
            np.concatenate([places.vessel, options.probes.vessel]),
            np.concatenate([places.fraction, options.probes.fraction]),
        )
    problem = set_up_problem(network, conditions, options)
    changes: list[float] = []
    rate, faster = problem.rate, Acceleration(problem.grid)
    for cycle in range(options.most_cycles):
        begun = State(*(x.copy() for x in problem.state))
        lines, steps, rate = _cycle(problem, options, places, begun, rate)
        balance = _balance(problem, begun, lines)
        changes.append(balance[0])
        if progress is not None:
            progress(cycle + 1, balance[0])
        if balance[0] < options.tolerance:
            return _solution(network, problem, options, lines, np.array(changes), steps, balance[1])
        faster.improve(begun, problem.state, *lines.ranges())
    raise FlowError(
        f"no periodic state after {len(changes)} cycles: the last still changed by "
        f"{changes[-1]:.2g} of the swing, above {options.tolerance:g}; allow more cycles "
        "(most_cycles; cycles of openBF's files), or a larger tolerance"
    )


def set_up_problem(
    network: VesselNetwork, conditions: PulsatileConditions, options: OneDOptions
) -> OneDProblem:
    """Cut the network into cells and find where to begin; raises as `solve_one_d`."""
    compliance = check_compliant(network, conditions.wall)
    nodes, slot, waves = place_nodes(network, conditions, options.reflection)
    period = common_period(waves) or 1.0
    speed = wave_speed(plug_inertance(network, conditions.density), compliance, network.lengths())
    grid = make_grid(network, conditions, options, period, speed)
    lumped = lumped_state(network, conditions, grid, options.reflection, options.samples)
    forecast = lumped_extremes(network, lumped)
    grid = with_small_changes(grid, forecast)
    state = first_state(network, grid, nodes, slot, lumped)
    return OneDProblem(grid, nodes, slot, waves, period, state, foreseen_rate(grid, forecast))


def _cycle(
    problem: OneDProblem, options: OneDOptions, places: Probes, begun: State, rate: float
) -> tuple[Lines, int, float]:
    """March a cycle; again with shorter steps where waves turn out too fast."""
    grid, state = problem.grid, problem.state
    work = make_work(grid, problem.nodes)
    for _ in range(LIMITS.attempts):
        steps = steps_for(grid, problem.nodes, problem.period_s, options.samples, options.courant,
                          rate, begun.area)  # fmt: skip
        lines = Lines(grid, places, options.samples)
        needed = _march(problem, lines, steps, options.samples, work)
        if needed * problem.period_s / steps <= LIMITS.stable:
            return lines, steps, needed
        for now, then in zip(state, begun, strict=True):
            now[:] = then
        rate = 1.1 * needed
    raise FlowError("waves get faster with every attempt at a cycle; check the wall and the flow")


def _march(
    problem: OneDProblem, lines: Lines, steps: int, samples: int, work: MarchScratch
) -> float:
    """Steps from sample to sample; the greatest rate of waves on the way, cells a second."""
    step, each, rate = problem.period_s / steps, steps // samples, 0.0
    for sample in range(samples):
        halves = step * (sample * each + np.arange(2 * each + 1, dtype=np.float64) / 2.0)
        drives = problem.drives(halves)
        bad = settle_ends(problem.grid, problem.nodes, problem.state, drives[0], work)
        if bad < 0:
            lines.take(sample, problem.state, work)
            velocity = problem.state.flow / problem.state.area
            rate = max(rate, wave_rate(problem.grid, work.pressure, velocity))
            if rate * step > LIMITS.stable:
                return rate
            bad = advance(problem.grid, problem.nodes, problem.state, drives, step, work)
        if bad >= 0:
            raise FlowError(
                f"vessel {bad} collapses, or its flow outruns its own pulse wave, at "
                f"{halves[0]:.3g} s of a cycle: the wall is too soft for this flow, or the flow "
                "too large for the network's unit"
            )
    return rate


def _balance(problem: OneDProblem, begun: State, lines: Lines) -> tuple[float, float]:
    """How much a cycle changed, and its mass, both relative."""
    grid, state = problem.grid, problem.state
    swing, greatest = lines.ranges()
    before, after = (grid.stiffness * (np.sqrt(s.area) * grid.root - 1.0) for s in (begun, state))
    changes = [
        np.abs(after - before).max() / max(swing, 1e-300),
        np.abs(state.stored - begun.stored).max() / max(swing, 1e-300),
        np.abs(state.flow - begun.flow).max() / max(greatest, 1e-300),
    ]
    passed = state.passed - begun.passed
    sizes = grid.cell[grid.vessel_of_cell]
    gained = float(sizes @ state.area - sizes @ begun.area)
    through = max(greatest * problem.period_s, 1e-300)
    return float(max(changes)), abs(gained + float(passed.sum())) / through


def _solution(
    network: VesselNetwork,
    problem: OneDProblem,
    options: OneDOptions,
    lines: Lines,
    change: FloatArray,
    steps: int,
    imbalance: float,
) -> OneDSolution:
    count = network.vessel_count
    time = problem.period_s * np.arange(options.samples) / options.samples
    least, most = lines.extremes()
    probes, probe_area = None, None
    if options.probes is not None:
        probe_area = lines.waves[2, count:]
        probes = ProbeWaves(time, lines.waves[0, count:], lines.waves[1, count:])
    grid = problem.grid
    middle = grid.offset[:-1] + np.diff(grid.offset) // 2
    return OneDSolution(
        period_s=problem.period_s,
        time_s=time,
        pressure_in=lines.ends[0, 0],
        pressure_out=lines.ends[0, 1],
        flow_in=lines.ends[1, 0],
        flow_out=lines.ends[1, 1],
        pressure=lines.waves[0, :count],
        flow=lines.waves[1, :count],
        area=lines.waves[2, :count],
        pressure_low=least[0],
        pressure_high=most[0],
        rest_area=grid.area[middle],
        probes=probes,
        change=change,
        mass_imbalance=imbalance,
        steps=steps,
        cells=len(grid.area),
        friction_exponent=options.exponents(count),
        probe_area=probe_area,
    )


class StepLimits(NamedTuple):
    """Limits of time steps and of Anderson's acceleration."""

    stable: float = 1.3
    """Cells a wave may run in a step at most; with κ = 1/3 and this Runge-Kutta method 1.5 still
    holds for one wave in a uniform tube."""
    friction: float = 1.0
    """Share of its flow that friction may take in a step; 2.5 is the method's limit."""
    max_steps: int = 50_000_000
    attempts: int = 10
    """At a cycle, each with shorter steps."""
    free_cycles: int = 2
    """Left to themselves before the acceleration: waves of the start die out."""
    memory: int = 3
    """Cycles before the last that are mixed."""


LIMITS: Final = StepLimits()


def foreseen_rate(grid: Grid, forecast: LumpedForecast) -> float:
    """Return how many cells a second the fastest wave will run, as the lumped model expects."""
    vessel = grid.vessel_of_cell
    outside = grid.external[vessel]
    low = np.maximum(1.0 + (forecast.low[vessel] - outside) / grid.stiffness, 0.1)
    velocity = forecast.flow[vessel] / (grid.area * low**2)
    return wave_rate(grid, np.maximum(forecast.high[vessel] - outside, 0.0), velocity)


def wave_rate(grid: Grid, pressure: FloatArray, velocity: FloatArray) -> float:
    """Return how many cells a second the fastest wave runs.

    ``pressure`` above the one outside and ``velocity`` are of cells, (n,), Pa, mm/s.
    """
    vessel = grid.vessel_of_cell
    alpha = grid.alpha[vessel]
    speed = np.sqrt((grid.stiffness + pressure) / (2.0 * grid.density))
    carried = np.sqrt(speed**2 + alpha * (alpha - 1.0) * velocity**2)
    fastest = alpha * np.abs(velocity) + carried
    return float((fastest / grid.cell[vessel]).max())


def steps_for(
    grid: Grid,
    nodes: Nodes,
    period_s: float,
    samples: int,
    courant: float,
    rate: float,
    area: FloatArray,
) -> int:
    """Return the steps of a cycle, a multiple of ``samples``.

    Limited by waves (``rate``, cells a second), by friction in thin vessels and by Windkessels
    whose time is short; raises `FlowError` above `StepLimits.max_steps`.
    """
    rubbing = grid.friction / area
    windkessel = (nodes.kind == KIND.resistance) & (nodes.capacitance > 0.0)
    conductance = 1.0 / nodes.proximal[windkessel] + 1.0 / nodes.distal[windkessel]
    emptying = conductance / nodes.capacitance[windkessel]
    wanted = {
        "waves": rate / courant,
        "friction": float(rubbing.max()) / LIMITS.friction,
        "a Windkessel's time": float(emptying.max(initial=0.0)),
    }
    cause = max(wanted, key=lambda name: wanted[name])
    steps = samples * int(np.ceil(max(1.0, period_s * wanted[cause] / samples)))
    if steps > LIMITS.max_steps:
        where = ""
        if cause != "a Windkessel's time":
            cells = rubbing if cause == "friction" else 1.0 / grid.cell[grid.vessel_of_cell]
            where = f" in vessel {int(grid.vessel_of_cell[np.argmax(cells)])}"
        raise FlowError(
            f"a cycle of {period_s:g} s would take {steps:.3g} steps, above "
            f"{LIMITS.max_steps:.3g}, because of {cause}{where}; give longer cells (cell_mm), or "
            "solve it lumped: waves don't matter where friction is so strong"
        )
    return steps


class Acceleration:
    """Begins of cycles and what they ended in.

    A cycle is a map x → G(x) of the state at its begin to that at its end, and the periodic state
    its fixed point. Left to itself the error falls by exp(-period/RC) a cycle. Anderson's
    acceleration (1965, doi 10.1145/321296.321305; Walker & Ni 2011, doi 10.1137/10078356X) takes,
    of the last few cycles, the mixture whose change G(x) - x is least: exact where what is left is
    a handful of slow modes. Whether a state is periodic is judged by the cycle that follows, never
    by the mixture.
    """

    def __init__(self, grid: Grid) -> None:
        self._grid = grid
        self._ends: list[FloatArray] = []
        self._changes: list[FloatArray] = []
        self._cycles = 0

    def improve(self, begun: State, state: State, swing: float, greatest: float) -> None:
        """Put a better begin of the next cycle into ``state``, a cycle's end.

        ``swing`` and ``greatest``, Pa and µL/s, are what pressures and flows are measured by.
        """
        self._cycles += 1
        if self._cycles <= LIMITS.free_cycles:
            return
        scale = np.concatenate(
            [np.full(len(state.area), swing), np.full(len(state.flow), greatest),
             np.full(len(state.stored), swing)]
        ) + 1e-300  # fmt: skip
        end = self._packed(state)
        change = (end - self._packed(begun)) / scale
        if self._changes and np.abs(change).max() > 2.0 * np.abs(self._changes[-1]).max():
            self._ends, self._changes = [], []
        self._ends = [*self._ends, end][-LIMITS.memory - 1 :]
        self._changes = [*self._changes, change][-LIMITS.memory - 1 :]
        if len(self._ends) > 1:
            self._unpack(self._mixed(), state)

    def _mixed(self) -> FloatArray:
        """The mixture of the ends kept whose changes' mixture is least."""
        last = self._changes[-1]
        differences = np.array([last - other for other in self._changes[:-1]]).T
        share = np.linalg.lstsq(differences, last, rcond=1e-6)[0]
        end = self._ends[-1]
        back = [part * (end - other) for part, other in zip(share, self._ends[:-1], strict=True)]
        return np.asarray(end - np.sum(back, axis=0))

    def _packed(self, state: State) -> FloatArray:
        """Pressure, flow and what outlets store."""
        grid = self._grid
        pressure = grid.stiffness * (np.sqrt(state.area) * grid.root - 1.0)
        return np.concatenate([pressure, state.flow, state.stored])

    def _unpack(self, packed: FloatArray, state: State) -> None:
        count = len(state.area)
        width = 1.0 + packed[:count] / self._grid.stiffness
        if width.min() <= 0.1:
            return
        state.area[:] = self._grid.area * width**2
        state.flow[:] = packed[count : 2 * count]
        state.stored[:] = packed[2 * count :]


class Lines:
    """Cells of each vessel with its two ends beside them, and places where waves are kept."""

    def __init__(self, grid: Grid, places: Probes, samples: int) -> None:
        vessels = np.arange(len(grid.cell))
        self.grid = grid
        self.begin = grid.offset[:-1] + 2 * vessels
        self.final = grid.offset[1:] + 2 * vessels + 1
        self.inner = np.arange(grid.offset[-1]) + 2 * grid.vessel_of_cell + 1
        self.low, self.high, self.weight = self._between(places)
        size = int(grid.offset[-1]) + 2 * len(vessels)
        self._values = np.empty((3, size))
        self._pressure = np.empty(int(grid.offset[-1]))
        self.ends = np.empty((2, 2, len(vessels), samples))
        self.waves = np.empty((3, len(places.vessel), samples))
        self.least = np.full((3, size), np.inf)
        self.most = np.full((3, size), -np.inf)

    def _between(self, places: Probes) -> tuple[IntArray, IntArray, FloatArray]:
        counts = np.diff(self.grid.offset)[places.vessel]
        along = places.fraction * counts
        cell = np.clip(np.floor(along + 0.5).astype(np.int64), 0, counts)
        low = self.begin[places.vessel] + cell
        # Ends are half a cell from their neighbours' middles.
        start = np.where(cell == 0, 0.0, cell - 0.5)
        stop = np.where(cell == counts, counts, cell + 0.5)
        return low, low + 1, (along - start) / (stop - start)

    def take(self, sample: int, state: State, work: MarchScratch) -> None:
        """Keep a state, after `settle_ends`."""
        all_pressures(self.grid, state, work, self._pressure)
        ends = work.ends[:3].reshape(3, -1, 2)
        inside = (self._pressure, state.flow, state.area)
        for values, cells, at in zip(self._values, inside, (2, 1, 0), strict=True):
            values[self.inner] = cells
            sign = -1.0 if at == 1 else 1.0
            values[self.begin], values[self.final] = sign * ends[at, :, 0], ends[at, :, 1]
        for k in range(2):
            self.ends[k, 0, :, sample] = self._values[k, self.begin]
            self.ends[k, 1, :, sample] = self._values[k, self.final]
        low, high = self._values[:, self.low], self._values[:, self.high]
        self.waves[:, :, sample] = low + self.weight * (high - low)
        np.minimum(self.least, self._values, out=self.least)
        np.maximum(self.most, self._values, out=self.most)

    def extremes(self) -> tuple[FloatArray, FloatArray]:
        """Least and most of pressure, flow and area in each vessel, (3, v) each."""
        return (
            np.minimum.reduceat(self.least, self.begin, axis=1),
            np.maximum.reduceat(self.most, self.begin, axis=1),
        )

    def ranges(self) -> tuple[float, float]:
        """Between least and greatest pressure, and the greatest flow, in the whole network."""
        pressure = float(self.most[0].max() - self.least[0].min())
        return pressure, float(max(self.most[1].max(), -self.least[1].min()))
