"""Oxygen solver, against Krogh's cylinder and closed solutions of slabs and wells."""

from __future__ import annotations

import numpy as np
import pytest

from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.oxygen import (
    OxygenConditions,
    grid_of_box,
    oxygen_summary,
    solve_oxygen,
)
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.oxygen.krogh import FLOW, compare, tissue_cylinder, vessel


@pytest.mark.parametrize(
    ("radius", "cells", "limit"),
    [(0.01, 12, 0.012), (0.03, 12, 0.012), (0.05, 12, 0.01), (0.1, 12, 0.015), (0.05, 4, 0.03)],
)
def test_krogh_s_cylinder_with_its_decline_along_the_vessel(radius, cells, limit):
    """From a lumen of 0.4 cells in radius to one of 4."""
    found = compare(radius, cells)
    assert found.worst < limit
    assert found.solution.exit[0] == pytest.approx(found.leaves, rel=1e-6)
    assert found.solution.imbalance < 1e-6


def test_a_finer_grid_is_nearer_to_krogh() -> None:
    assert compare(0.05, 16).rms < compare(0.05, 4).rms / 4.0


def test_a_turned_vessel_is_the_same() -> None:
    grid = tissue_cylinder(5)
    driven = FlowConditions(1e-3, inlet_flow_ul_s=FLOW, inlets=(0,), outlets=(1,))
    one, other = (
        solve_oxygen(network, solve_flow(network, driven), grid, OxygenConditions())
        for network in (vessel(0.05), vessel(0.05, turned=True))
    )
    np.testing.assert_allclose(one.concentration, other.concentration, atol=2e-5)
    assert one.exit == pytest.approx(other.exit, rel=1e-5)


def test_a_slab_between_baths_converges_with_the_square_of_the_spacing() -> None:
    """C = c_bath - M/(2D) x (L - x), far from a vessel that brings next to nothing."""
    given = OxygenConditions(cells_per_ml=2e6, half_millimolar=1e-9, bath_millimolar=0.2)
    off = []
    for cells in (8, 16):
        h = 1.0 / cells
        grid = grid_of_box(np.array([[0.0, 0, 0], [1.0, 8.0, 8.0]]), h)
        middle = grid.inside.shape[1] // 2
        network = network_of([[0.5, 0, 0.5], [0.5, 0.5, 0.5]], [(0, 1)], 1e-3)
        flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=1e-9))
        found = solve_oxygen(network, flow, grid, given)
        x = (np.arange(cells) + 0.5) * h
        exact = 0.2 - given.uptake_millimolar_s / (2 * 2e-3) * x * (1 - x)
        off.append(np.abs(found.concentration[1:-1, middle, middle] - exact).max())
    assert off[1] < off[0] / 3.5


def test_well_stirred_tissue_is_michaelis_and_menten_s_balance() -> None:
    """Q (c_in - c) = V M c/(K + c), when all that diffuses does so at once."""
    given = OxygenConditions(
        cells_per_ml=1e7, half_millimolar=0.05, tissue_diffusivity_mm2_s=1e4,
        medium_diffusivity_mm2_s=1e4,
    )  # fmt: skip
    grid = grid_of_box(np.array([[0.0, 0, 0], [1.0, 1.0, 1.0]]), 0.1)
    network = network_of([[0, 0.5, 0.5], [1, 0.5, 0.5]], [(0, 1)], 0.02)
    flow = 2e-3
    solved = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=flow))
    found = solve_oxygen(network, solved, grid, given)
    volume = found.tissue_share.sum() * grid.cell_ul
    most = volume * given.uptake_millimolar_s / flow
    b = 0.05 + most - 0.2
    expected = (-b + np.sqrt(b * b + 4 * 0.2 * 0.05)) / 2
    assert found.concentration[5, 5, 5] == pytest.approx(expected, rel=1e-4)
    assert found.exit[0] == pytest.approx(expected, rel=1e-4)


def test_medium_at_a_quarter_millilitre_a_minute_feeds_seventeen_million_cells() -> None:
    """0.25 mL/min at 0.2 mM over 5e-17 mol/s a cell (physics.md)."""
    grid = grid_of_box(np.array([[0.0, 0, 0], [2.0, 2.0, 2.0]]), 0.25)
    network = network_of([[0, 1, 1], [2, 1, 1]], [(0, 1)], 0.2)
    solved = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.25 / 0.06))
    found = oxygen_summary(solve_oxygen(network, solved, grid, OxygenConditions()))
    assert found["cells_fed_at_most"] == pytest.approx(1.7e7, rel=0.03)
