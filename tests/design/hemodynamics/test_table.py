"""Flow table and summary for users."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.hemodynamics import (
    FlowConditions,
    flow_summary,
    flow_table,
    read_flow_csv,
    same_shear_conditions,
    scaled_flow,
    scaled_network,
    solve_flow,
    write_flow_csv,
)
from design.vasculature import planar_four_vessel
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree

CONDITIONS = FlowConditions(1e-3, inlet_flow_ul_s=0.25 * 1000 / 60)
PIPE = network_of([[0, 0, 0], [20, 0, 0]], [(0, 1)], 0.2)


def test_a_pipe_is_shown_in_both_systems_of_units() -> None:
    row = {
        name: column[0] for name, column in flow_table(PIPE, solve_flow(PIPE, CONDITIONS)).items()
    }
    assert row["kind"] == "channel"
    assert (row["length_mm"], row["diameter_mm"]) == (20.0, 0.4)
    assert row["flow_ml_min"] == pytest.approx(0.25)
    assert row["pressure_in_mmhg"] == pytest.approx(row["pressure_in_pa"] / 133.322)
    assert row["pressure_out_pa"] == 0.0
    assert row["velocity_mm_s"] == pytest.approx(33.16, rel=1e-3)
    assert row["wall_shear_dyn_cm2"] == pytest.approx(10 * row["wall_shear_pa"])
    # 1060 kg/m³ · 0.03316 m/s · 0.4 mm / 1 mPa·s
    assert row["reynolds"] == pytest.approx(14.06, rel=1e-3)
    assert row["poiseuille_holds"] == 1


def test_poiseuille_is_called_wrong_in_a_short_or_turbulent_vessel() -> None:
    short = network_of([[0, 0, 0], [0.3, 0, 0]], [(0, 1)], 0.2)
    assert flow_table(short, solve_flow(short, CONDITIONS))["poiseuille_holds"].tolist() == [0]
    fast = FlowConditions(1e-3, inlet_flow_ul_s=1e3)
    table = flow_table(PIPE, solve_flow(PIPE, fast))
    assert table["reynolds"][0] > 2000
    assert table["poiseuille_holds"].tolist() == [0]


def test_the_csv_holds_the_table_to_the_bit(tmp_path: Path) -> None:
    network = random_tree(1, 12)
    solution = solve_flow(network, FlowConditions(VISCOSITY, inlet_pressure_pa=100.0))
    path = tmp_path / "flow.csv"
    write_flow_csv(path, network, solution)
    table = {name: column.tolist() for name, column in flow_table(network, solution).items()}
    rows = [dict(zip(table, row, strict=True)) for row in zip(*table.values(), strict=True)]
    assert read_flow_csv(path) == rows
    assert path.read_text().splitlines()[0] == ",".join(table)


def test_the_summary_balances_mass_and_energy() -> None:
    network = random_tree(7, 80)
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=2.0, outlet_pressure_pa=300.0)
    summary = flow_summary(network, solve_flow(network, conditions), conditions)
    assert summary["mass_imbalance"] <= 1e-12
    assert summary["energy_imbalance"] <= 1e-9
    assert summary["inflow_ul_s"] == pytest.approx(2.0)
    assert all(np.isfinite(value) for value in summary.values())
    json.dumps(summary)


# Flow of a print scaled up or down from its design.

WATER = FlowConditions(viscosity_pa_s=1e-3, inlet_flow_ul_s=4.0, outlet_pressure_pa=200.0)


@pytest.mark.parametrize("factor", [0.3, 4.0])
def test_same_shear_and_pressure_in_the_scaled_network(factor):
    network = planar_four_vessel()
    design = solve_flow(network, WATER)
    large = scaled_network(network, factor)
    print_ = solve_flow(large, same_shear_conditions(WATER, factor))
    assert print_.wall_shear == pytest.approx(design.wall_shear, rel=1e-9)
    assert print_.pressure == pytest.approx(design.pressure, rel=1e-9)
    assert np.allclose(large.radius, factor * network.radius)


def test_both_ways_of_scaling_are_solutions_of_the_scaled_network():
    network, factor = planar_four_vessel(), 2.5
    summary = flow_summary(network, solve_flow(network, WATER), WATER)
    large = scaled_network(network, factor)
    for name, said in scaled_flow(summary, factor).items():
        if name == "design":
            continue
        driven = replace(WATER, inlet_flow_ul_s=said["inflow_ml_min"] * 1e3 / 60)
        found = flow_summary(large, solve_flow(large, driven), driven)
        assert found["pressure_drop_mmhg"] == pytest.approx(said["pressure_drop_mmhg"], rel=1e-9)
        if name == "same_reynolds":
            key = next(key for key in summary if key.startswith("reynolds"))
            assert found[key] == pytest.approx(summary[key], rel=1e-9)
