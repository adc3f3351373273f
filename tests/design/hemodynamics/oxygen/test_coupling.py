"""Oxygen exchange of vessels with grid cells: any size, position and direction."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.oxygen import OxygenConditions, grid_of_box, solve_oxygen
from design.hemodynamics.oxygen.solve import OxygenProblem
from design.hemodynamics.oxygen.transport import (
    SMOOTHING,
    cut_vessels,
    subgrid,
    sweep,
    transport_of,
)
from design.network import VesselNetwork
from kernels.arrays import FloatArray
from tests.design.hemodynamics.networks import network_of

BOX = np.array([[0.0, 0.0, 0.0], [2.0, 2.0, 2.0]])
BRIDGE = [(0, 1), (1, 2), (1, 3), (2, 3), (2, 4), (3, 4), (4, 5)]
NODES = [[0.1, 1, 1], [0.5, 1, 1], [1, 1.5, 1], [1, 0.5, 1.2], [1.5, 1, 1], [1.9, 1, 1]]


def solved_problem(network: VesselNetwork, cells_per_ml: float = 1e7) -> OxygenProblem:
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.02))
    grid = grid_of_box(BOX, 0.2)
    return OxygenProblem(network, flow, grid, OxygenConditions(cells_per_ml=cells_per_ml))


def test_the_subgrid_correction_is_the_mean_over_a_blurred_ring() -> None:
    """Against samples of ln max(1, |1 + noise|), and the limit of a line."""
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2, 400_000))
    for ratio in (0.3, 1.0, 3.0):
        blur = SMOOTHING / ratio
        away = np.hypot(1.0 + blur * noise[0], blur * noise[1])
        expected = np.log(np.maximum(1.0, away)).mean()
        assert subgrid(np.array([ratio]), 1.0)[0] == pytest.approx(expected, abs=0.003)
    assert subgrid(np.array([1e-4]), 1.0)[0] == pytest.approx(np.log(0.6606 / 1e-4), abs=1e-3)


@pytest.mark.parametrize("radius", [0.02, 0.1, 0.3])
@pytest.mark.slow
def test_what_a_vessel_gives_depends_neither_on_its_place_in_a_cell_nor_on_the_grid(radius):
    """An oblique vessel in a box whose surface is a bath without oxygen."""
    given = OxygenConditions(cells_per_ml=1.0, bath_millimolar=0.0)

    def flux(spacing: float, shift: float) -> float:
        grid = grid_of_box(BOX, spacing)
        nodes = np.array([[0.4, 0.5, 0.6], [1.6, 1.4, 1.5]]) + [shift, 0.7 * shift, -shift]
        network = network_of(nodes.tolist(), [(0, 1)], radius)
        flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=1.0))
        return float(solve_oxygen(network, flow, grid, given).wall_flux[0])

    fine = flux(0.0625, 0.0)
    for shift in (0.0, 0.03, 0.07):
        assert flux(0.2, shift) == pytest.approx(fine, rel=0.04)


def test_a_network_with_loops_mixes_by_flow_and_keeps_what_it_is_given() -> None:
    network = network_of(NODES, BRIDGE, [0.1, 0.08, 0.05, 0.04, 0.06, 0.08, 0.1])
    problem = solved_problem(network)
    around = np.random.default_rng(2).random(len(problem.conductance)) * 0.1
    flux, entry, leaves = sweep(problem.transport, problem.conductance, around, 0.2)
    assert flux.sum() == pytest.approx(0.02 * (0.2 - leaves[6]), rel=1e-12)
    size = problem.transport.flow
    into = [(vessel, leaves[vessel]) for vessel in (4, 5)]
    mixed = sum(size[v] * c for v, c in into) / sum(size[v] for v, _ in into)
    assert entry[6] == pytest.approx(mixed, rel=1e-12)


@pytest.mark.parametrize("cells_per_ml", [1e7, 3e8])
def test_starved_tissue_stays_above_nothing_and_in_balance(cells_per_ml: float) -> None:
    network = network_of(NODES, BRIDGE, 0.08)
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.02))
    given = OxygenConditions(cells_per_ml=cells_per_ml)
    found = solve_oxygen(network, flow, grid_of_box(BOX, 0.1), given)
    assert found.concentration.min() > -1e-9
    assert np.nanmax(found.exit) <= 0.2
    assert found.imbalance < 1e-6
    assert found.drained == pytest.approx(0.02 * found.exit[6], rel=1e-9)
    more = solve_oxygen(network, flow, grid_of_box(BOX, 0.1), replace(given, inlet_millimolar=0.4))
    assert more.share_below(0.01) < found.share_below(0.01)


def test_what_cannot_be_solved_is_said() -> None:
    network = network_of(NODES, BRIDGE, 0.08)
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.02))
    still = replace(flow, flow=np.zeros(7))
    with pytest.raises(FlowError, match="no vessel carries any flow"):
        solve_oxygen(network, still, grid_of_box(BOX, 0.2), OxygenConditions())
    for given, moved, words in (
        (0.2, [9.0, 0.0, 0.0], "check that network and tissue"),
        (2.0, [0.0, 0.0, 0.0], "lumens fill it"),
    ):
        wide = network_of(NODES, BRIDGE, 0.9 if given == 2.0 else 0.08).moved(np.array(moved))
        with pytest.raises(FlowError, match=words):
            solve_oxygen(wide, flow, grid_of_box(BOX, given), OxygenConditions())
    with pytest.raises(FlowError, match="raise the spacing"):
        grid_of_box(BOX, 0.002)
    with pytest.raises(FlowError, match="cells_per_ml is -1"):
        OxygenConditions(cells_per_ml=-1.0)


def _laid(size: int, x: float, y: float) -> FloatArray:
    out = np.zeros((size, size))
    spline = []
    for at in (x, y):
        away = np.abs(np.arange(size) - at)
        away = np.minimum(away, size - away)
        near, next_ = 0.75 - away**2, 0.5 * (1.5 - away) ** 2
        spline.append(np.where(away <= 0.5, near, np.where(away <= 1.5, next_, 0.0)))
    out += spline[0][:, None] * spline[1]
    return out


def test_the_lattice_answers_as_the_smoothing_says() -> None:
    """A line laid on a periodic lattice by B-splines, read where it is and far away."""
    size, far = 64, 10.0
    k = 2.0 - 2.0 * np.cos(2.0 * np.pi * np.fft.fftfreq(size))
    star = k[:, None] + k
    star[0, 0] = np.inf
    rng = np.random.default_rng(1)
    radii = []
    for x, y in size / 2 + rng.random((12, 2)):
        source = _laid(size, x, y)
        field = np.fft.ifft2(np.fft.fft2(source) / star).real
        ring = [
            (field * _laid(size, x + far * np.cos(t), y + far * np.sin(t))).sum()
            for t in np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        ]
        # The even sink that a periodic lattice needs adds r²/(4 area).
        rise = (field * source).sum() - np.mean(ring) + far**2 / (4.0 * size**2)
        radii.append(far * np.exp(-2.0 * np.pi * rise))
    expected = np.sqrt(2) * SMOOTHING * np.exp(-np.euler_gamma / 2)
    assert np.mean(radii) == pytest.approx(expected, rel=0.02)
    assert np.std(radii) / np.mean(radii) < 0.06


def test_the_change_that_newton_uses_is_that_of_the_loss() -> None:
    """Downstream action through the stream included."""
    problem = solved_problem(network_of(NODES, BRIDGE, 0.08))
    rng = np.random.default_rng(3)
    inside = problem.grid.inside.ravel()
    c, step = (np.where(inside, rng.random(inside.size), 0.0) for _ in range(2))
    eps = 1e-6
    expected = (problem.loss(c + eps * step) - problem.loss(c - eps * step)) / (2 * eps)
    found = problem.change(step, problem.slope(c))
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_a_stream_relaxes_exponentially_to_what_is_around_it() -> None:
    network = network_of([[0.5, 1, 1], [1.5, 1, 1]], [(0, 1)], 0.05)
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.02))
    elements = cut_vessels(network, grid_of_box(BOX, 0.1))
    count = len(elements.length)
    transport, around = transport_of(network, flow, elements), np.full(count, 0.1)
    flux, _, leaves = sweep(transport, np.full(count, 0.03 / count), around, 0.2)
    assert leaves[0] == pytest.approx(0.1 + 0.1 * np.exp(-1.5), rel=1e-12)
    assert flux.sum() == pytest.approx(0.02 * (0.2 - leaves[0]), rel=1e-12)
