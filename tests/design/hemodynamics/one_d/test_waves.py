"""Single waves of 1D flow: shocks, reflections, friction, rest, mass, convergence order."""

from dataclasses import replace

import numpy as np
import pytest

from design.hemodynamics import (
    GelWall,
    OneDOptions,
    PressureOutlet,
    PulsatileConditions,
    ThinWall,
    WindkesselOutlet,
)
from design.hemodynamics.one_d.kernels import State
from design.hemodynamics.waveforms import Constant
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.one_d.linear import Tube
from tests.design.hemodynamics.one_d.riemann import Riemann, Side
from tests.design.hemodynamics.one_d.tubes import march, posed, pressures, with_scale

LENGTH, RADIUS, YOUNG, THICK = 1000.0, 5.0, 4e5, 0.5
STIFF = YOUNG * THICK / 0.75 / RADIUS
AREA = np.pi * RADIUS**2
SPEED = float(np.sqrt(STIFF / 2.0 / 1.06e-3))
STILL = 1e-12
"""A viscosity so small that friction is gone."""


def tube(cells: int, viscosity: float = STILL, outlet: float = 0.0, alpha: float | None = 1.0):  # type: ignore[no-untyped-def]
    """One straight vessel, its outlet swallowing waves or sending ``outlet`` of them back."""
    network = network_of([[0, 0, 0], [LENGTH, 0, 0]], [(0, 1)], RADIUS)
    conditions = PulsatileConditions(
        viscosity, Constant(0.0), wall=ThinWall(YOUNG, THICK), outlet=PressureOutlet(Constant(0.0))
    )
    options = OneDOptions(cell_mm=LENGTH / cells, alpha=alpha, reflection={1: outlet})
    return posed(network, conditions, options)


def gauss(height: float, at: float, width: float):  # type: ignore[no-untyped-def]
    return lambda t: height * np.exp(-(((t - at) / width) ** 2))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        (Side(1.3 * AREA, 0.0), Side(AREA, 0.0)),
        (Side(AREA, 600.0), Side(1.1 * AREA, -400.0)),
        (Side(AREA, -500.0), Side(AREA, 500.0)),
    ],
)
def test_shocks_and_fans_are_the_riemann_problems(left: Side, right: Side) -> None:
    until, errors = 0.03, []
    keep = left.area * left.velocity
    exact = Riemann(left, right, STIFF / 2.0 / 1.06e-3 / np.sqrt(AREA))
    for cells in (200, 800):
        problem = tube(cells)
        grid = with_scale(problem.grid, 0.1 * STIFF, 0.1 * AREA * SPEED)
        x = (np.arange(cells) + 0.5) * LENGTH / cells - LENGTH / 2.0
        state = problem.state
        state.area[:] = np.where(x < 0.0, left.area, right.area)
        state.flow[:] = state.area * np.where(x < 0.0, left.velocity, right.velocity)
        quiet = replace(problem, grid=grid)
        # The inlet's flow stays the left state's.
        march(quiet.grid, quiet.nodes, state, until, cells // 2, lambda t: np.full(len(t), keep))
        inner = np.abs(x) < 0.6 * LENGTH / 2.0
        found = np.array([exact.at(float(s)).area for s in x[inner] / until])
        errors.append(np.abs(state.area[inner] - found).mean() / AREA)
        middle = exact.middle()
        at = np.argmin(np.abs(x - middle.velocity * until))
        assert state.area[at] == pytest.approx(middle.area, rel=2e-3)
        velocity = state.flow[at] / state.area[at]
        assert velocity == pytest.approx(middle.velocity, abs=2e-3 * SPEED)
        # Little overshoots: what is small isn't limited.
        low, high = (f(left.area, right.area, middle.area) for f in (min, max))
        assert low - 0.01 * AREA < state.area[inner].min()
        assert state.area[inner].max() < high + 0.01 * AREA
    assert errors[1] < errors[0] / 2.5
    assert errors[1] < 1e-3


def simple_wave(cells: int, until: float) -> FloatArray:
    """Error in area of a wave to the right, against its exact characteristics."""
    problem = tube(cells)
    h = LENGTH / cells
    nodes, weights = np.polynomial.legendre.leggauss(4)
    x = (np.arange(cells) + 0.5)[:, None] * h + nodes * h / 2.0

    def speed_at(place: FloatArray) -> FloatArray:
        """c of the initial wave; u = 4 (c - c₀) leaves the left-going invariant at rest."""
        return np.asarray(SPEED * (1.0 + 0.02 * np.exp(-(((place - 350.0) / 70.0) ** 2))))

    def mean(values: FloatArray) -> FloatArray:
        return np.asarray(values @ weights / 2.0)

    c = speed_at(x)
    state = problem.state
    state.area[:] = mean(AREA * (c / SPEED) ** 4)
    state.flow[:] = mean(AREA * (c / SPEED) ** 4 * 4.0 * (c - SPEED))
    grid = with_scale(problem.grid, 0.04 * STIFF, AREA * 0.08 * SPEED)
    march(grid, problem.nodes, state, until, int(np.ceil(1.3 * until * SPEED / h)))
    # Each value of c runs at u + c = 5c - 4c₀: where it began is found by Newton's method.
    from_ = x - SPEED * until
    for _ in range(50):
        run = (5.0 * speed_at(from_) - 4.0 * SPEED) * until
        slope = 1.0 + 5.0 * until * (speed_at(from_ + 1e-3) - speed_at(from_)) / 1e-3
        from_ -= (from_ + run - x) / slope
    return np.asarray(state.area - mean(AREA * (speed_at(from_) / SPEED) ** 4))


def test_smooth_flow_converges_in_second_order() -> None:
    counts = [50, 100, 200, 400]
    errors = [np.abs(simple_wave(n, 0.04)).mean() for n in counts]
    orders = np.log2(np.array(errors[:-1]) / errors[1:])
    assert orders[-1] > 1.9
    assert orders.min() > 1.7
    # The crest isn't clipped: the greatest error falls as fast.
    greatest = [np.abs(simple_wave(n, 0.04)).max() for n in (200, 400)]
    assert np.log2(greatest[0] / greatest[1]) > 1.9


@pytest.mark.parametrize("part", [-1.0, -0.4, 0.0, 0.6, 1.0])
def test_a_terminal_sends_its_part_of_a_wave_back(part: float) -> None:
    problem = tube(400, outlet=part)
    small = 1e-4 * AREA * SPEED
    grid = with_scale(problem.grid, 1.06e-3 * SPEED / AREA * small, small)
    until = 1.2 * LENGTH / SPEED + 0.04
    march(grid, problem.nodes, problem.state, until, 800, gauss(small, 0.04, 0.012))
    # The wave has turned and is on its way back, 0.2 of the length from the outlet.
    p = pressures(grid, problem.state)
    sent = 1.06e-3 * SPEED / AREA * small
    assert p[np.argmax(np.abs(p))] == pytest.approx(part * sent, abs=5e-3 * sent)
    if part:
        x = (np.arange(400) + 0.5) * LENGTH / 400
        assert x[np.argmax(np.abs(p))] == pytest.approx(0.8 * LENGTH, abs=6.0)


@pytest.mark.parametrize("daughters", [1, 2, 3])
def test_a_junction_reflects_and_passes_by_admittances(daughters: int) -> None:
    radii = [RADIUS, 4.0, 3.0, 3.5][: daughters + 1]
    far = [[2 * LENGTH, 300.0 * k, 0.0] for k in range(daughters)]
    network = network_of(
        [[0, 0, 0], [LENGTH, 0, 0], *far],
        # The second daughter is drawn towards the junction: directions don't matter.
        [(0, 1), *(((1, 2 + k) if k != 1 else (2 + k, 1)) for k in range(daughters))],
        radii,
    )
    outlets = tuple(range(2, 2 + daughters))
    conditions = PulsatileConditions(
        STILL, Constant(0.0), wall=ThinWall(YOUNG, THICK), inlets=(0,), outlets=outlets,
        outlet=PressureOutlet(Constant(0.0)),
    )  # fmt: skip
    options = OneDOptions(cell_mm=2.5, alpha=1.0, reflection=dict.fromkeys(outlets, 0.0))
    problem = posed(network, conditions, options)
    areas = np.pi * np.array(radii) ** 2
    speeds = np.sqrt(YOUNG * THICK / 0.75 / np.array(radii) / 2.0 / 1.06e-3)
    admittance = areas / (1.06e-3 * speeds)
    small = 1e-4 * AREA * SPEED
    grid = with_scale(problem.grid, small / admittance[0], small)
    until = 1.25 * LENGTH / SPEED + 0.04
    steps = int(1.3 * until * speeds.max() / 2.5)
    march(grid, problem.nodes, problem.state, until, steps, gauss(small, 0.04, 0.012))
    p = pressures(grid, problem.state)
    sent = small / admittance[0]
    back = (admittance[0] - admittance[1:].sum()) / admittance.sum()
    parent = p[: grid.offset[1]]
    assert parent[np.argmax(np.abs(parent))] == pytest.approx(back * sent, abs=3e-3 * sent)
    for vessel in range(1, daughters + 1):
        passed = p[grid.offset[vessel] : grid.offset[vessel + 1]]
        assert passed.max() == pytest.approx((1.0 + back) * sent, rel=5e-3)


def test_friction_makes_a_pulse_die_as_linear_theory_says() -> None:
    viscosity = 0.02
    problem = tube(1000, viscosity, alpha=None)
    small, until = 1e-5 * AREA * SPEED, 0.17
    grid = with_scale(problem.grid, 1.06e-3 * SPEED / AREA * small, small)
    march(grid, problem.nodes, problem.state, until, 1500, gauss(small, 0.05, 0.012))
    here = Tube(LENGTH, AREA, STIFF, 8.0 * np.pi * viscosity / 1.06e-3, 1.06e-3)
    # The wave's spectrum, carried to each place; a long window stands for endless time.
    times = np.arange(4096) * 1e-3
    spectrum = np.fft.rfft(gauss(small, 0.05, 0.012)(times))
    omegas = 2.0 * np.pi * np.fft.rfftfreq(4096, 1e-3)
    x = (np.arange(1000) + 0.5)[300:900:50]
    gone = np.array([here.propagation(w) for w in omegas])
    ratio = np.array([here.impedance(w) if w else 0.0 for w in omegas])
    phases = np.exp(1j * omegas * until)
    waves = ratio * spectrum * phases
    exact = np.array([np.real(np.exp(-gone * place) @ waves) for place in x]) * 2.0 / 4096
    found = pressures(grid, problem.state)[300:900:50]
    crest = np.abs(exact).max()
    assert crest < 0.8 * 1.06e-3 * SPEED / AREA * small  # it has died by much
    # A flow of one sign leaves a slow tail, whose mean the window doesn't know.
    np.testing.assert_allclose(found - found[-1], exact - exact[-1], atol=0.01 * crest)


def rough(seed: int) -> VesselNetwork:
    """A loop, a fork and a dead turn of vessels whose radii jump and taper."""
    rng = np.random.default_rng(seed)
    nodes = 10.0 * rng.normal(size=(7, 3))
    ends = np.array([(0, 1), (1, 2), (1, 3), (2, 4), (3, 4), (2, 3), (4, 5), (4, 6)])
    radius = rng.uniform(0.3, 1.2, size=2 * len(ends))
    return replace(network_of(nodes, ends, 1.0), radius=radius)


@pytest.mark.parametrize("wall", [ThinWall(1e5, 0.05), GelWall(1e4)])
@pytest.mark.parametrize("viscous", [0.0, 50.0])
def test_a_network_at_rest_stays_at_rest(wall: ThinWall | GelWall, viscous: float) -> None:
    base = 800.0
    outlet = WindkesselOutlet(1.0, 1e-3, 3.0, base)
    conditions = PulsatileConditions(1e-3, Constant(0.0), wall=wall, outlet=outlet)
    options = OneDOptions(cell_mm=0.7, wall_viscosity_pa_s=viscous)
    problem = posed(rough(3), conditions, options)
    grid, state = problem.grid, problem.state
    state.area[:] = grid.area * (1.0 + base / grid.stiffness) ** 2
    march(grid, problem.nodes, state, 0.05, 2000)
    np.testing.assert_allclose(pressures(grid, state), base, rtol=1e-11)
    speed = np.sqrt(grid.stiffness.max() / 2.0 / 1.06e-3)
    assert np.abs(state.flow / state.area).max() < 1e-11 * speed


def test_mass_goes_nowhere() -> None:
    outlet = WindkesselOutlet(1.0, 1e-3, 3.0)
    conditions = PulsatileConditions(1e-3, Constant(0.0), wall=GelWall(1e4), outlet=outlet)
    problem = posed(rough(4), conditions, OneDOptions(cell_mm=0.7))
    grid, state = with_scale(problem.grid, 10.0, 5.0), problem.state
    size = grid.cell[grid.vessel_of_cell]
    before = State(*(x.copy() for x in state))
    march(grid, problem.nodes, state, 0.2, 8000, lambda t: 5.0 + 5.0 * np.sin(60.0 * t))
    gained = size @ (state.area - before.area)
    ends = np.isin(np.arange(len(state.passed)), problem.slot[[0, 5, 6]])
    assert np.abs(state.passed[~ends]).max() < 1e-13
    entered = -state.passed[problem.slot[0]]
    assert entered == pytest.approx(5.0 * 0.2 + 5.0 / 60.0 * (1.0 - np.cos(12.0)), rel=1e-6)
    assert abs(gained + state.passed.sum()) < 1e-11 * entered


def test_steady_flow_keeps_its_head_through_tapers_and_junctions() -> None:
    """Bernoulli: without friction, with α = 1, p + ½ϱu² is the same everywhere."""
    nodes, ends = [[0, 0, 0], [300, 0, 0], [600, 0, 0], [600, 300, 0]], [(0, 1), (1, 2), (1, 3)]
    network = replace(network_of(nodes, ends, 1.0), radius=np.array([6.0, 4.0, 3.0, 4.0, 2.5, 2.5]))
    conditions = PulsatileConditions(
        STILL, Constant(0.0), wall=ThinWall(YOUNG, THICK), outlet=PressureOutlet(Constant(0.0))
    )
    options = OneDOptions(cell_mm=10.0, alpha=1.0, reflection={2: 0.0, 3: 0.0})
    problem = posed(network, conditions, options)
    grid, state, inflow = problem.grid, problem.state, 3e4
    march(grid, problem.nodes, state, 4.0, 6000,
          lambda t: inflow * np.minimum(1.0, t / 0.1))  # fmt: skip
    assert state.flow[: grid.offset[1]] == pytest.approx(inflow, rel=2e-4)
    p, dynamic = pressures(grid, state), 0.5 * 1.06e-3 * (state.flow / state.area) ** 2
    head = p + dynamic
    assert np.ptp(dynamic) > 250.0
    np.testing.assert_allclose(head, head[0], atol=0.003 * np.ptp(dynamic))
