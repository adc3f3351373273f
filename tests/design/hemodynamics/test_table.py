"""Flow tables and summaries for users; 0D solutions at probes between vessel ends."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    Carreau,
    FlowConditions,
    Fluid,
    GelWall,
    PowerLaw,
    Probes,
    PulsatileConditions,
    RigidWall,
    flow_summary,
    flow_table,
    pulsatile_at_probes,
    read_flow_csv,
    same_shear_conditions,
    scaled_flow,
    scaled_network,
    solve_flow,
    solve_pulsatile,
    steady_at_probes,
    write_flow_csv,
)
from design.hemodynamics.probes import probes_along
from design.hemodynamics.waveforms import Sine
from design.network import VesselNetwork
from design.vasculature import planar_four_vessel
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree
from tests.design.networks import polylines

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


# At probes between ends.


LINE = np.array([[0.0, 0, 0], [6, 0, 0], [6, 3, 0], [9, 3, 0]])
TAPER = polylines([LINE[:3], LINE[2:]], [0.6, 0.3, 0.2, 0.2, 0.25])
CUT = polylines([LINE[:2], LINE[1:3], LINE[2:]], [0.6, 0.3, 0.3, 0.2, 0.2, 0.25])
"""The same with a node more, two thirds along the first vessel (4 + 2 of 9 mm)."""


@pytest.mark.parametrize("fluid", [None, PowerLaw(0.02, 0.5), Carreau()])
def test_pressure_at_a_probe_is_that_of_a_node_there(fluid: Fluid | None) -> None:
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0, fluid=fluid)
    found = steady_at_probes(
        TAPER, solve_flow(TAPER, conditions), conditions,
        Probes(np.array([0, 0, 0, 1]), np.array([0.0, 2 / 3, 1.0, 1.0])),
    )  # fmt: skip
    nodes = solve_flow(CUT, conditions).pressure
    assert found.pressure[:, 0] == pytest.approx(nodes, rel=1e-9, abs=1e-9)
    assert found.flow[:, 0] == pytest.approx([3.0] * 4)


@pytest.mark.parametrize("profile", ["poiseuille", "womersley"])
def test_rigid_vessels_carry_the_inlets_wave_everywhere(profile: str) -> None:
    wave = Sine(3.0, 1.5, 0.7)
    conditions = PulsatileConditions(VISCOSITY, wave, wall=RigidWall(), profile=profile)  # type: ignore[arg-type]
    found = pulsatile_at_probes(
        TAPER, solve_pulsatile(TAPER, conditions), conditions, probes_along(0, 10), 40
    )
    assert found.flow == pytest.approx(np.tile(wave.at(found.time_s), (10, 1)), rel=1e-10)
    if profile == "poiseuille":
        cut = solve_pulsatile(CUT, conditions)
        at = pulsatile_at_probes(
            TAPER, solve_pulsatile(TAPER, conditions), conditions,
            Probes(np.array([0]), np.array([2 / 3])), 40,
        )  # fmt: skip
        assert at.pressure[0] == pytest.approx(cut.at(cut.pressure[:, 1], at.time_s), rel=1e-9)


def test_between_elastic_ends_the_error_falls_with_the_square_of_the_length() -> None:
    conditions = PulsatileConditions(VISCOSITY, Sine(30.0, 15.0, 0.5), wall=GelWall(2e4))
    errors = []
    for pieces in (2, 4, 8):
        coarse, fine = (_tube(n) for n in (pieces, 16 * pieces))
        probe = Probes(np.array([pieces // 2]), np.array([0.5]))
        there = Probes(np.array([16 * (pieces // 2) + 8]), np.array([0.0]))
        waves = [
            pulsatile_at_probes(each, solve_pulsatile(each, conditions), conditions, place)
            for each, place in ((coarse, probe), (fine, there))
        ]
        errors.append(np.abs(waves[0].flow - waves[1].flow).max())
    assert np.log2(errors[0] / errors[1]) > 1.7
    assert np.log2(errors[1] / errors[2]) > 1.7


def _tube(pieces: int) -> VesselNetwork:
    nodes = np.zeros((pieces + 1, 3))
    nodes[:, 0] = np.linspace(0, 60, pieces + 1)
    return network_of(nodes, [(k, k + 1) for k in range(pieces)], 0.8)


def test_probes_off_the_network_are_refused() -> None:
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0)
    solution = solve_flow(TAPER, conditions)
    probe = probes_along(0, 1)
    for wrong in (replace(probe, vessel=np.array([2])), replace(probe, fraction=np.array([1.5]))):
        with pytest.raises(FlowError, match="a probe is"):
            steady_at_probes(TAPER, solution, conditions, wrong)
