"""svZeroDSolver's files: published results, options, refusals, round trips."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.sparse import csc_array, eye_array, random_array

from design.errors import FlowError
from design.hemodynamics import (
    GelWall,
    PulsatileConditions,
    ResistanceOutlet,
    WindkesselOutlet,
    solve_pulsatile,
)
from design.hemodynamics.waveforms import Sine
from design.hemodynamics.zero_d.svzerod import (
    SvZeroDRun,
    case_of,
    read_svzerod,
    result_table,
    run_svzerod,
    svzerod_input,
    write_svzerod,
    write_svzerod_csv,
    write_svzerod_npz,
)
from design.hemodynamics.zero_d.svzerod.factors import Factors
from tests.design.hemodynamics.networks import VISCOSITY, network_of
from tests.design.hemodynamics.svzerod_cases import case, fork, steady, wave

FORK = network_of([[0, 0, 0], [4, 0, 0], [8, 2, 0], [8, -2, 0]], [(0, 1), (1, 2), (1, 3)], 0.4)
CONDITIONS = PulsatileConditions(VISCOSITY, Sine(4.0, 2.0, 1.0), outlet=ResistanceOutlet(3.0))
WINDKESSEL = {"C": 1e-4, "Pd": 0.0, "Rd": 1e3, "Rp": 1e3}


def _r_rcr(**parameters: Any) -> dict[str, Any]:
    """Its test case pulsatileFlow_R_RCR: a sine by 101 samples, R = 100, then 1000, 1e-4, 1000."""
    return case(
        {"IN": ("FLOW", wave("Q", 2.2, 2.5, 101)), "OUT": ("RCR", dict(WINDKESSEL))},
        {"branch0_seg0": ({"R_poiseuille": 100.0}, "IN", "OUT")},
        points=201, **{"cycles": 10} | parameters,
    )  # fmt: skip


def _run(data: dict[str, Any]) -> SvZeroDRun:
    return run_svzerod(case_of(data))


def test_its_stored_result_is_ours_to_ten_digits() -> None:
    """`pressure_out` of its result_pulsatileFlow_R_RCR.json, steps into the last cycle."""
    found = _run(_r_rcr())
    stored = {0: 3274.0316427422, 50: 8691.8409466611, 58: 8837.021814896, 100: 5525.9683572578}
    stored |= {150: 108.1590533389, 155: -13.9181123136, 156: -26.8060750255, 200: 3274.0316427422}
    assert found.value[list(stored), 3] == pytest.approx(list(stored.values()), abs=1e-9)
    assert found.periodic
    assert found.cycles == 10


def test_a_large_system_steps_as_a_small_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """One pass of a kernel from 2,000 unknowns on; SuperLU and SciPy below."""
    values = {"R_poiseuille": 1.0, "C": 1e-6, "L": 1e-3}
    names = [f"branch{k}_seg0" for k in range(600)]
    ends: dict[str, Any] = {names[0]: (values, "IN", None), names[-1]: (values, None, "OUT")}
    vessels = {name: ends.get(name, (values, None, None)) for name in names}
    joints = [
        {"junction_name": f"J{k}", "junction_type": "NORMAL_JUNCTION", "inlet_vessels": [k],
         "outlet_vessels": [k + 1]} for k in range(599)
    ]  # fmt: skip
    data = case(
        {"IN": ("FLOW", wave("Q", 2.2, 2.5, 21)), "OUT": ("RCR", dict(WINDKESSEL))},
        vessels, joints, points=21, cycles=2,
    )  # fmt: skip
    large = _run(data)
    for module in ("factors", "march_linear"):
        monkeypatch.setattr(f"design.hemodynamics.zero_d.svzerod.{module}.LARGE", 10**9)
    small = _run(data)
    scale = np.abs(small.value).max(axis=0)
    assert (np.abs(large.value - small.value).max(axis=0) <= 1e-10 * scale).all()
    assert large.change == pytest.approx(small.change)


def test_output_options_choose_from_one_run() -> None:
    every = _run(_r_rcr(output_all_cycles=True))
    assert every.time == pytest.approx(np.arange(2001) * 0.005)
    last, third = _run(_r_rcr()), _run(_r_rcr(output_interval=3))
    assert last.value == pytest.approx(every.value[-201:], abs=0)
    assert third.value == pytest.approx(last.value[::3], abs=0)
    named = case_of(_r_rcr(output_variable_based=True, output_mean_only=True))
    table = result_table(named, run_svzerod(named))
    assert table.names == (
        "flow:IN:branch0_seg0", "pressure:IN:branch0_seg0", "flow:branch0_seg0:OUT",
        "pressure:branch0_seg0:OUT", "pressure_c:OUT",
    )  # fmt: skip
    assert list(table.columns) == ["y"]
    assert table.columns["y"][0, [0, 1]] == pytest.approx(last.value[:, [0, 2]].mean(axis=0))
    assert not len(table.time)


def test_rates_are_those_of_the_values() -> None:
    sloped = case_of(_r_rcr(output_derivative=True))
    table = result_table(sloped, run_svzerod(sloped))
    rate, value = table.columns["d_pressure_out"][:, 0], table.columns["pressure_out"][:, 0]
    assert rate == pytest.approx(np.gradient(value, table.time), abs=0.05 * np.ptp(rate))


def test_cycles_are_gone_through_until_means_stay() -> None:
    slow = WINDKESSEL | {"C": 2e-3}
    data = _r_rcr(use_cycle_to_cycle_error=True, cycles=2)
    data["boundary_conditions"][1]["bc_values"] = slow
    # 2 s of decay, periods of 1 s, an error of 1 %: 2 ln 100 = 9.2 cycles.
    assert _run(data).cycles == 10
    data["boundary_conditions"][1] = {
        "bc_name": "OUT", "bc_type": "CORONARY",
        "bc_values": {
            "Ra1": 10.0, "Ra2": 10.0, "Rv1": 200.0, "Ca": 1e-4, "Cc": 1e-2, "P_v": 0.0,
            **steady("Pim", 0.0),
        },
    }  # fmt: skip
    data["simulation_parameters"]["steady_initial"] = False
    assert 5 <= _run(data).cycles <= 15


@pytest.mark.parametrize("count", [30, 3000])
def test_factors_solve_few_unknowns_and_many(count: int) -> None:
    """Above 2,000 unknowns a kernel solves in place of SuperLU."""
    rng = np.random.default_rng(count)
    matrix = csc_array(
        random_array((count, count), density=3.0 / count, rng=rng) + 2.0 * eye_array(count)
    )[rng.permutation(count)]
    right = rng.normal(size=count)
    factors = Factors(matrix)
    for _ in range(2):
        assert matrix @ factors.solve(right) == pytest.approx(right, abs=1e-9)


def _changed(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    data = _r_rcr()
    place: Any = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return data


JUNCTION = {"junction_name": "J", "junction_type": "NORMAL_JUNCTION", "inlet_vessels": [0]}
PARAMETERS = ("simulation_parameters",)
IN, OUT, VESSEL = ("boundary_conditions", 0), ("boundary_conditions", 1), ("vessels", 0)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ((*VESSEL, "zero_d_element_values", "K"), 1e-4, "branch0_seg0: .*values has the key 'K'"),
        ((*VESSEL, "zero_d_element_values", "L"), "1", "branch0_seg0: L is '1'"),
        ((*VESSEL, "zero_d_element_values"), {}, "branch0_seg0: R_poiseuille is missing"),
        ((*VESSEL, "zero_d_element_type"), "Valve", "branch0_seg0: .*type is 'Valve'"),
        ((*VESSEL, "boundary_conditions", "outlet"), "X", "'X', which isn't given"),
        ((*VESSEL, "boundary_conditions"), {"inlet": "IN"}, "1 inlets and 0 outlets"),
        ((*VESSEL, "vessel_id"), None, "branch0_seg0: vessel_id"),
        ((*VESSEL, "vessel_name"), "a,b", "vessel_name is 'a,b'; a name has no comma"),
        ((*VESSEL, "zero_d_element_values", "L"), 10**400, "L is .*; write a finite number"),
        ((*VESSEL, "vessel_name"), 3, r"vessels\[0\]: vessel_name is 3"),
        ((*VESSEL, "color"), 3, r"vessels\[0\] has the key 'color'"),
        ((*OUT, "bc_type"), "Pump", "OUT: bc_type is 'Pump'"),
        ((*OUT, "bc_values", "C"), -1e-4, "OUT: C is -0.0001; it may not be below 0"),
        ((*VESSEL, "zero_d_element_values", "R_poiseuille"), -1, "seg0: R_poiseuille is -1; it"),
        ((*VESSEL, "zero_d_element_values", "L"), float("inf"), "seg0: L is inf; write a finite"),
        ((*VESSEL, "zero_d_element_values", "stenosis_coefficient"), -1, "stenosis_.* below 0"),
        ((*PARAMETERS, "number_of_cardiac_cycles"), 10**9, "steps are .*; the limit is 10,000,000"),
        ((*PARAMETERS, "number_of_time_pts_per_cardiac_cycle"), 10**8, "number_of_cardiac_cycles"),
        ((*OUT, "bc_values", "Rd"), [1.0, 2.0], "OUT: Rd changes over time"),
        ((*OUT, "bc_values", "Rx"), 1.0, "OUT: bc_values has the key 'Rx'"),
        ((*OUT, "bc_name"), "IN", "another block is named 'IN'"),
        ((*IN, "bc_values", "t", 3), 0.0, "condition IN: Q has times t that don't rise"),
        ((*IN, "bc_values", "Q"), [1.0, 2.0], "IN: Q has 101 times for 2 values"),
        ((*IN, "bc_values", "Q", 2), None, "IN: Q is"),
        (("chambers",), [{"name": "LV", "type": "Cube"}], "chamber LV: type is 'Cube'"),
        (("valves",), [{"name": "AV", "type": "Door"}], "valve AV: type is 'Door'"),
        (("closed_loop_blocks",), [{}, {}], "closed_loop_blocks has 2 hearts"),
        (("calibration_parameters",), {"a": 1}, "calibration_parameters: printctl doesn't"),
        (("heart",), 1, "the file has the key 'heart'"),
        (PARAMETERS, {}, "number_of_time_pts_per_cardiac_cycle is missing"),
        ((*PARAMETERS, "coupled_simulation"), True, "coupled_simulation needs the 3D solver"),
        ((*PARAMETERS, "steady_initial"), 1, "steady_initial is 1; write true or false"),
        ((*PARAMETERS, "output_all"), True, "simulation_parameters has the key 'output_all'"),
        ((*PARAMETERS, "rho_infty"), 2, "rho_infty is 2; it lies between 0 and 1"),
        ((*PARAMETERS, "cardiac_period"), 1.2, "IN: Q has a period of 1 .* has 1.2"),
        (("junctions",), [{"junction_name": "J", "junction_type": "T"}], "junction J: .* is 'T'"),
        (("junctions",), [{**JUNCTION, "outlet_vessels": [[0]]}], r"names '\[0\]', which isn't"),
        (("junctions",), [{**JUNCTION, "outlet_vessels": [7]}], "names 'vessel 7', which isn't"),
        ((*IN, "bc_values", "Q", 5), 1e307, "isn't finite"),
        (("boundary_conditions",), 3, "boundary_conditions is 3; write a list"),
    ],
)
def test_what_isnt_modelled_is_refused_by_key_and_place(
    tmp_path: Path, path: tuple[Any, ...], value: Any, words: str
) -> None:
    file = tmp_path / "case.json"
    file.write_text(json.dumps(_changed(path, value)))
    with pytest.raises(FlowError, match=words):
        run_svzerod(read_svzerod(file))


@pytest.mark.parametrize(
    ("said", "why"),
    [('{"vessels": [], "vessels": []}', "'vessels' stands twice"), ("[" * 100_000, "JSON")],
)
def test_a_key_given_twice_and_endless_lists_are_refused(
    tmp_path: Path, said: str, why: str
) -> None:
    file = tmp_path / "case.json"
    file.write_text(said)
    with pytest.raises(FlowError, match=why):
        read_svzerod(file)


def test_a_network_without_pressure_and_a_stenosis_without_bounds_are_errors() -> None:
    data = _r_rcr()
    data["boundary_conditions"][1] |= {"bc_type": "FLOW", "bc_values": steady("Q", 2.0)}
    with pytest.raises(FlowError, match="no single solution"):
        _run(data)
    data = _r_rcr(maximum_nonlinear_iterations=2)
    data["vessels"][0]["zero_d_element_values"]["stenosis_coefficient"] = 1e4
    with pytest.raises(FlowError, match="no solution within 2 iterations"):
        _run(data)


def test_comments_and_what_simvascular_writes_are_read() -> None:
    data = _r_rcr(density=1.06, viscosity=0.04, model_name="x", _why="text")
    data |= {"description": {"a": 1}, "_comment": [1]}
    data["vessels"][0] |= {"vessel_length": 1.0, "_note": "text"}
    assert case_of(data).names == ("branch0_seg0",)


def test_chains_of_r_c_l_come_close_to_the_networks_own_answer() -> None:
    wall = GelWall(5e3)
    elastic = PulsatileConditions(
        VISCOSITY, Sine(4.0, 2.0, 1.0), outlet=WindkesselOutlet(1.0, 0.02, 9.0), wall=wall
    )
    found = _run(svzerod_input(FORK, elastic, steps=400, cycles=8))
    ours = solve_pulsatile(FORK, elastic, 400)
    expected = ours.at(ours.pressure[:, FORK.vessel_nodes[:, 0]], found.time) * 10.0
    assert np.abs(found.value[:, 6:9] - expected).max() <= 1e-2 * np.ptp(expected)


def test_a_network_written_and_read_has_its_flow(tmp_path: Path) -> None:
    write_svzerod(tmp_path / "case.json", FORK, CONDITIONS, steps=50)
    given = read_svzerod(tmp_path / "case.json")
    run = run_svzerod(given)
    ours = solve_pulsatile(FORK, CONDITIONS, 50)
    expected = ours.at(ours.flow_in, run.time) / 1000.0
    assert run.value[:, :3] == pytest.approx(expected, rel=2e-3)
    table = result_table(given, run)
    write_svzerod_csv(tmp_path / "out.csv", table)
    write_svzerod_npz(tmp_path / "out.npz", table)
    with (tmp_path / "out.csv").open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    assert len(rows) == 3 * 51
    with np.load(tmp_path / "out.npz") as arrays:
        assert list(arrays) == ["name", "time", *table.columns]
        for name in table.columns:
            listed = np.array([float(row[name]) for row in rows]).reshape(3, 51)
            assert (listed == arrays[name].T).all()
        assert [row["name"] for row in rows[::51]] == arrays["name"].tolist()


def test_junctions_by_numbers_and_by_names_are_the_same() -> None:
    numbered = fork("NORMAL_JUNCTION", {})
    named = fork("NORMAL_JUNCTION", {})
    junction = named["junctions"][0]
    del junction["inlet_vessels"], junction["outlet_vessels"]
    junction |= {"inlet_blocks": ["trunk"], "outlet_blocks": ["left", "right"]}
    assert (_run(named).value == _run(numbered).value).all()


def test_what_the_format_cant_say_isnt_written() -> None:
    twin = network_of([[0, 0, 0], [1, 1, 0], [0, 2, 0], [2, 1, 0]], [(0, 1), (2, 1), (1, 3)], 0.3)
    with pytest.raises(FlowError, match="2 inlets share one flow"):
        svzerod_input(twin, CONDITIONS)
    double = network_of([[0, 0, 0], [2, 0, 0]], [(0, 1)] * 2, 0.3)
    with pytest.raises(FlowError, match="2 vessels meet at end 0"):
        svzerod_input(double, CONDITIONS)
