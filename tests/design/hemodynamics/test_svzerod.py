"""svZeroDSolver cases: published results, and round trips of files."""

from __future__ import annotations

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
from design.hemodynamics.waveforms import Sine
from design.hemodynamics.zero_d.pulsatile import solve_periodic
from design.hemodynamics.zero_d.svzerod import (
    read_svzerod,
    run_svzerod,
    svzerod_input,
    write_svzerod,
    write_svzerod_csv,
)
from design.hemodynamics.zero_d.svzerod.read import case_of
from tests.design.hemodynamics.networks import VISCOSITY, network_of

FORK = network_of([[0, 0, 0], [4, 0, 0], [8, 2, 0], [8, -2, 0]], [(0, 1), (1, 2), (1, 3)], 0.4)
CONDITIONS = PulsatileConditions(VISCOSITY, Sine(4.0, 2.0, 1.0), outlet=ResistanceOutlet(3.0))


def _r_rcr() -> dict[str, Any]:
    """Its test case pulsatileFlow_R_RCR: a sine by 101 samples, R = 100, then 1000, 1e-4, 1000."""
    time = np.linspace(0, 1, 101)
    flow = 2.2 + 2.5 * np.sin(2 * np.pi * time)
    flow[-1] = flow[0]
    wave = {"Q": flow.tolist(), "t": time.tolist()}
    windkessel = {"C": 1e-4, "Pd": 0.0, "Rd": 1e3, "Rp": 1e3}
    return {
        "boundary_conditions": [
            {"bc_name": "IN", "bc_type": "FLOW", "bc_values": wave},
            {"bc_name": "OUT", "bc_type": "RCR", "bc_values": windkessel},
        ],
        "simulation_parameters": {
            "number_of_cardiac_cycles": 10,
            "number_of_time_pts_per_cardiac_cycle": 201,
        },
        "vessels": [
            {
                "boundary_conditions": {"inlet": "IN", "outlet": "OUT"},
                "vessel_id": 0,
                "vessel_name": "branch0_seg0",
                "zero_d_element_type": "BloodVessel",
                "zero_d_element_values": {"R_poiseuille": 100.0},
            }
        ],
    }


def test_its_stored_result_is_ours_to_ten_digits() -> None:
    """`pressure_out` of its result_pulsatileFlow_R_RCR.json, steps into the last cycle."""
    case = case_of(_r_rcr())
    found = run_svzerod(case)
    stored = {0: 3274.0316427422, 50: 8691.8409466611, 58: 8837.021814896, 100: 5525.9683572578}
    stored |= {150: 108.1590533389, 155: -13.9181123136, 156: -26.8060750255, 200: 3274.0316427422}
    end = found.pressure[list(stored), case.circuit.last[0]]
    assert end == pytest.approx(list(stored.values()), abs=1e-9)
    assert found.periodic


def test_chains_of_r_c_l_answer_alike_in_time_and_by_frequency() -> None:
    elastic = PulsatileConditions(
        VISCOSITY, Sine(4.0, 2.0, 1.0), outlet=WindkesselOutlet(1.0, 0.02, 9.0), wall=GelWall(5e3)
    )
    case = case_of(svzerod_input(FORK, elastic, steps=400, cycles=8))
    found, exact = run_svzerod(case), solve_periodic(case.circuit, 400)
    turn = np.exp(2j * np.pi * np.outer(found.time_s, exact.harmonic))
    for ours, phasors in ((found.pressure, exact.pressure), (found.flow_first, exact.flow_first)):
        expected = (turn @ phasors).real
        assert np.abs(ours - expected).max() <= 1e-4 * np.abs(expected).max()


def test_a_network_written_and_read_has_its_flow(tmp_path: Path) -> None:
    write_svzerod(tmp_path / "case.json", FORK, CONDITIONS, steps=50)
    case = read_svzerod(tmp_path / "case.json")
    ours = solve_pulsatile(FORK, CONDITIONS, 50)
    theirs = solve_periodic(case.circuit, 50)
    keep = np.flatnonzero(np.isin(theirs.harmonic, ours.harmonic))
    # Lines between its samples are a little lower than the sine.
    drawn = (theirs.flow_first[keep, 0] / ours.flow_in[:, 0])[:, None]
    assert drawn * 1000 == pytest.approx(1.0, rel=2e-3)
    assert theirs.flow_first[keep][:, :3] == pytest.approx(ours.flow_in * drawn, rel=1e-9)
    ends = np.column_stack([case.circuit.first, case.circuit.last])[:3]
    expected = ours.pressure[:, FORK.vessel_nodes] * (1e4 * drawn[:, :, None])
    assert theirs.pressure[keep][:, ends] == pytest.approx(expected, rel=1e-9)
    write_svzerod_csv(tmp_path / "out.csv", case, run_svzerod(case))
    lines = (tmp_path / "out.csv").read_text().splitlines()
    assert lines[0] == "name,time,flow_in,flow_out,pressure_in,pressure_out"
    assert len(lines) == 1 + 3 * 51


def _changed(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    data = _r_rcr()
    place: Any = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return data


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        (("vessels", 0, "zero_d_element_values", "stenosis_coefficient"), 1e-4, "stenosis"),
        (("vessels", 0, "zero_d_element_type"), "Valve", "branch0_seg0 is a Valve"),
        (("vessels", 0, "boundary_conditions", "outlet"), "X", "outlet 'X', which isn't given"),
        (("boundary_conditions", 1, "bc_type"), "CORONARY", "OUT is a CORONARY"),
        (("boundary_conditions", 1, "bc_values", "Rd"), [1.0, 2.0], "over time"),
        (("boundary_conditions", 0, "bc_values", "t", 3), 0.0, "condition IN: .* don't rise"),
        (("chambers",), [{}], "chambers aren't modelled"),
        (("simulation_parameters",), {}, "isn't an input of svZeroDSolver: KeyError"),
    ],
)
def test_what_isnt_modelled_is_refused_by_name(
    tmp_path: Path, path: tuple[Any, ...], value: Any, words: str
) -> None:
    file = tmp_path / "case.json"
    file.write_text(json.dumps(_changed(path, value)))
    with pytest.raises(FlowError, match=words):
        read_svzerod(file)


def test_what_the_format_cant_say_isnt_written() -> None:
    twin = network_of([[0, 0, 0], [1, 1, 0], [0, 2, 0], [2, 1, 0]], [(0, 1), (2, 1), (1, 3)], 0.3)
    with pytest.raises(FlowError, match="2 inlets share one flow"):
        svzerod_input(twin, CONDITIONS)
    double = network_of([[0, 0, 0], [2, 0, 0]], [(0, 1)] * 2, 0.3)
    with pytest.raises(FlowError, match="2 vessels meet at end 0"):
        svzerod_input(double, CONDITIONS)
