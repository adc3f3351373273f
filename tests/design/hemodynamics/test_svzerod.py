"""svZeroDSolver's files, solved by its own package."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    GelWall,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
    solve_pulsatile,
)
from design.hemodynamics.other_solvers.svzerod import svzerod_input, write_svzerod
from design.hemodynamics.waveforms import Sine
from tests.design.hemodynamics.networks import VISCOSITY, network_of

FORK = network_of([[0, 0, 0], [4, 0, 0], [8, 2, 0], [8, -2, 0]], [(0, 1), (1, 2), (1, 3)], 0.4)
CONDITIONS = PulsatileConditions(VISCOSITY, Sine(4.0, 2.0, 1.0), outlet=ResistanceOutlet(3.0))


def solved(case: dict[str, Any]) -> dict[str, np.ndarray]:
    """Columns of its table by name, (times, vessels); the vessels stand one after the other."""
    svzerod = pytest.importorskip("svzerod", reason="the solver's package isn't installed")
    table = svzerod.simulate(case)
    count = table["name"].nunique()
    return {name: table[name].to_numpy().reshape(count, -1).T for name in table.columns}


def test_chains_of_r_c_l_come_close_to_the_networks_own_answer() -> None:
    wall = GelWall(5e3)
    elastic = PulsatileConditions(
        VISCOSITY, Sine(4.0, 2.0, 1.0), outlet=WindkesselOutlet(1.0, 0.02, 9.0), wall=wall
    )
    found = solved(svzerod_input(FORK, elastic, steps=400, cycles=8))
    ours = solve_pulsatile(FORK, elastic, 400)
    expected = ours.at(ours.pressure[:, FORK.vessel_nodes[:, 0]], found["time"][:, 0]) * 10.0
    assert np.abs(found["pressure_in"] - expected).max() <= 1e-2 * np.ptp(expected)


def test_a_network_written_and_run_has_its_flow(tmp_path: Path) -> None:
    write_svzerod(tmp_path / "case.json", FORK, CONDITIONS, steps=50)
    found = solved(json.loads((tmp_path / "case.json").read_text()))
    ours = solve_pulsatile(FORK, CONDITIONS, 50)
    expected = ours.at(ours.flow_in, found["time"][:, 0]) / 1000.0
    assert found["flow_in"] == pytest.approx(expected, rel=2e-3)


def test_what_the_format_cant_say_isnt_written() -> None:
    twin = network_of([[0, 0, 0], [1, 1, 0], [0, 2, 0], [2, 1, 0]], [(0, 1), (2, 1), (1, 3)], 0.3)
    with pytest.raises(FlowError, match="2 inlets share one flow"):
        svzerod_input(twin, CONDITIONS)
    double = network_of([[0, 0, 0], [2, 0, 0]], [(0, 1)] * 2, 0.3)
    with pytest.raises(FlowError, match="2 vessels meet at end 0"):
        svzerod_input(double, CONDITIONS)
