"""1D flow grid and tube law, against the lumped (0D) model."""

from __future__ import annotations

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    GelWall,
    OneDOptions,
    PulsatileConditions,
    RigidWall,
    ThinWall,
    solve_one_d,
    vessel_resistance,
)
from design.hemodynamics.one_d.grid import make_grid, relaxation_time
from design.hemodynamics.waveforms import Sine
from design.network import VesselNetwork
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.one_d.cases import StiffWall


@pytest.fixture
def bent() -> VesselNetwork:
    """A vessel whose radius changes along three pieces, and a straight one."""
    return VesselNetwork(
        nodes=np.array([[0.0, 0, 0], [6, 4, 0], [16, 4, 0]]),
        vessel_nodes=np.array([[0, 1], [1, 2]]),
        kind=np.zeros(2, dtype=np.int64),
        tree=np.zeros(2, dtype=np.int64),
        offset=np.array([0, 4, 6]),
        points=np.array([[0.0, 0, 0], [3, 0, 0], [6, 0, 0], [6, 4, 0], [6, 4, 0], [16, 4, 0]]),
        radius=np.array([0.5, 0.8, 0.3, 0.4, 0.4, 0.35]),
    )


@pytest.mark.parametrize("wall", [ThinWall(1e5, 0.1), GelWall(1e4, 0.45), StiffWall((4e3, 9e3))])
@pytest.mark.parametrize("cells", [4, 37])
def test_cells_have_the_vessels_compliance_resistance_and_volume(bent, wall, cells):
    conditions = PulsatileConditions(1e-3, Sine(1.0, 0.5, 1.0), wall=wall)
    grid = make_grid(
        bent, conditions, OneDOptions(cell_mm=10.0, least_cells=cells), 1.0, np.ones(2)
    )
    size = np.repeat(grid.cell, np.diff(grid.offset))
    vessel = grid.vessel_of_cell
    compliance = np.bincount(vessel, weights=2.0 * grid.area / grid.stiffness * size)
    np.testing.assert_allclose(compliance, wall.compliance(bent), rtol=1e-12)
    resistance = np.bincount(vessel, weights=1.06e-3 * grid.friction / grid.area**2 * size)
    np.testing.assert_allclose(resistance, vessel_resistance(bent, 1e-3), rtol=1e-12)
    faces = np.sqrt(grid.face_area / np.pi)
    assert faces[[0, cells, cells + 1, 2 * cells + 1]] == pytest.approx([0.5, 0.4, 0.4, 0.35])


def test_rigid_walls_are_refused() -> None:
    pipe = network_of([[0, 0, 0], [10, 0, 0]], [(0, 1)], 0.5)
    conditions = PulsatileConditions(1e-3, Sine(1.0, 0.5, 1.0), wall=RigidWall())
    with pytest.raises(FlowError, match=r"rigid wall.*wall_young_kpa"):
        solve_one_d(pipe, conditions)


def test_a_viscous_wall_needs_a_modulus() -> None:
    assert relaxation_time(GelWall(1e4), 100.0) == pytest.approx(0.01)
    with pytest.raises(FlowError, match="modulus is known"):
        relaxation_time(StiffWall((1e3,)), 100.0)


@pytest.mark.parametrize(
    "options", [{"courant": 2.0}, {"alpha": 0.5}, {"reflection": {1: 1.5}}, {"least_cells": 1}]
)
def test_options_out_of_bounds_are_refused(options: dict[str, float]) -> None:
    with pytest.raises(FlowError, match="give"):
        OneDOptions(**options)  # type: ignore[arg-type]
