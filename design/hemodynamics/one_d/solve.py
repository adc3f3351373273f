"""Solve 1D pulse-wave flow in a network, cycle by cycle until it repeats."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from design.errors import FlowError
from design.hemodynamics.one_d.grid import Grid, make_grid
from design.hemodynamics.one_d.kernels.march import (
    MarchScratch,
    State,
    advance,
    make_work,
    settle_ends,
)
from design.hemodynamics.one_d.nodes import Nodes, place_nodes
from design.hemodynamics.one_d.options import OneDOptions
from design.hemodynamics.one_d.pace import STABLE, foreseen_rate, steps_for, wave_rate
from design.hemodynamics.one_d.periodic import Acceleration
from design.hemodynamics.one_d.record import Lines
from design.hemodynamics.one_d.solution import OneDSolution
from design.hemodynamics.one_d.start import (
    first_state,
    lumped_extremes,
    lumped_state,
    with_small_changes,
)
from design.hemodynamics.one_d.tube_law import check_compliant
from design.hemodynamics.probes import Probes, ProbeWaves, midpoints
from design.hemodynamics.vessel.inertance import plug_inertance
from design.hemodynamics.vessel.wall import wave_speed
from design.hemodynamics.waveforms import Waveform
from design.hemodynamics.waveforms.waveform import common_period
from design.hemodynamics.zero_d.pulsatile.conditions import PulsatileConditions
from design.network import VesselNetwork
from kernels.arrays import FloatArray, IntArray

Progress = Callable[[int, float], None]
"""Told each cycle's number and how much it changed."""


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

    Parameters
    ----------
    network : VesselNetwork
    conditions : PulsatileConditions
    options : OneDOptions, optional
    progress : callable, optional

    Returns
    -------
    OneDSolution

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
    """Cut the network into cells and find where to begin.

    Raises
    ------
    FlowError
        As `solve_one_d`.
    """
    compliance = check_compliant(network, conditions.wall)
    nodes, slot, waves = place_nodes(network, conditions, options.reflection)
    period = common_period(waves) or 1.0
    speed = wave_speed(plug_inertance(network, conditions.density), compliance, network.lengths())
    grid = make_grid(network, conditions, options, period, speed)
    lumped = lumped_state(network, conditions, grid, dict(options.reflection), options.samples)
    seen = lumped_extremes(network, lumped)
    grid = with_small_changes(grid, seen)
    state = first_state(network, grid, nodes, slot, lumped)
    return OneDProblem(grid, nodes, slot, waves, period, state, foreseen_rate(grid, seen))


def _cycle(
    problem: OneDProblem, options: OneDOptions, places: Probes, begun: State, rate: float
) -> tuple[Lines, int, float]:
    """March a cycle; again with shorter steps where waves turn out too fast."""
    grid, state = problem.grid, problem.state
    work = make_work(grid, problem.nodes)
    for _ in range(10):
        steps = steps_for(grid, problem.nodes, problem.period_s, options.samples, options.courant,
                          rate, begun.area)  # fmt: skip
        lines = Lines(grid, places, options.samples)
        needed = _march(problem, lines, steps, options.samples, work)
        if needed * problem.period_s / steps <= STABLE:
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
            if rate * step > STABLE:
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
