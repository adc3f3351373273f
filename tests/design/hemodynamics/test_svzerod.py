"""svZeroDSolver's files: written from networks, run by its package, refused with one message."""

import csv
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
from design.hemodynamics.other_solvers import svzerod
from design.hemodynamics.other_solvers.svzerod import run_svzerod, svzerod_input, write_svzerod
from design.hemodynamics.waveforms import Sine
from tests.design.hemodynamics.networks import VISCOSITY, network_of

FORK = network_of([[0, 0, 0], [4, 0, 0], [8, 2, 0], [8, -2, 0]], [(0, 1), (1, 2), (1, 3)], 0.4)
CONDITIONS = PulsatileConditions(VISCOSITY, Sine(4.0, 2.0, 1.0), outlet=ResistanceOutlet(3.0))
HEART = {
    "Tsa": 0.40742, "tpwave": 8.976868, "Erv_s": 2.125279, "Elv_s": 3.125202, "iml": 0.509365,
    "imr": 0.806369, "Lrv_a": 0.000186865, "Rrv_a": 0.035061704, "Lra_v": 0.000217032,
    "Rra_v": 0.007887459, "Lla_v": 0.000351787, "Rla_v": 0.005310825, "Rlv_ao": 0.034320234,
    "Llv_a": 0.000110776, "Vrv_u": 9.424629, "Vlv_u": 5.606007, "Rpd": 0.098865401,
    "Cp": 1.090989, "Cpa": 0.556854, "Kxp_ra": 9.22244, "Kxv_ra": 0.004837, "Emax_ra": 0.208858,
    "Vaso_ra": 4.848742, "Kxp_la": 9.194992, "Kxv_la": 0.008067, "Emax_la": 0.303119,
    "Vaso_la": 9.355754,
}  # fmt: skip
"""Numbers of the example in svZeroDSolver's documentation."""
OPTIONS = "simulation_parameters"


def _vessel(number: int, name: str, values: dict[str, Any], **ends: str) -> dict[str, Any]:
    return {
        "vessel_id": number, "vessel_name": name, "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": values, "boundary_conditions": ends,
    }  # fmt: skip


def _windkessel(**options: Any) -> dict[str, Any]:
    """Its test case pulsatileFlow_R_RCR: a sine by 101 samples, R = 100, then 1000, 1e-4, 1000."""
    time = np.linspace(0.0, 1.0, 101)
    flow = 2.2 + 2.5 * np.sin(2.0 * np.pi * time)
    flow[-1] = flow[0]
    inlet = {"Q": flow.tolist(), "t": time.tolist()}
    outlet = {"C": 1e-4, "Pd": 0.0, "Rd": 1e3, "Rp": 1e3}
    return {
        OPTIONS: {"number_of_cardiac_cycles": 10, "number_of_time_pts_per_cardiac_cycle": 201}
        | options,
        "boundary_conditions": [
            {"bc_name": "IN", "bc_type": "FLOW", "bc_values": inlet},
            {"bc_name": "OUT", "bc_type": "RCR", "bc_values": outlet},
        ],
        "vessels": [_vessel(0, "branch0_seg0", {"R_poiseuille": 100.0}, inlet="IN", outlet="OUT")],
    }


def _heart(**options: Any) -> dict[str, Any]:
    """Heart, lungs and one vessel in a closed loop."""
    values = {"Rp": 0.134156617, "Rd": 1.356472458, "C": 0.238401833, "closed_loop_outlet": True}
    aorta = {"R_poiseuille": 0.003348073, "L": 0.004}
    volumes = {"V_RA:CLH": 38.43, "V_RV:CLH": 96.07, "V_LA:CLH": 38.43, "V_LV:CLH": 96.07}
    loop = {
        "closed_loop_type": "ClosedLoopHeartAndPulmonary", "cardiac_cycle_period": 1.0169,
        "outlet_blocks": ["aorta"], "parameters": HEART,
    }  # fmt: skip
    return {
        OPTIONS: {"number_of_time_pts_per_cardiac_cycle": 100, "steady_initial": False} | options,
        "boundary_conditions": [
            {"bc_name": "RCR", "bc_type": "ClosedLoopRCR", "bc_values": values}
        ],
        "vessels": [_vessel(0, "aorta", aorta, outlet="RCR")],
        "closed_loop_blocks": [loop],
        "initial_condition": volumes | {"P_pul:CLH": 8.0},
    }


@pytest.fixture
def out(tmp_path: Path) -> Path:
    pytest.importorskip("svzerod", reason='the extra "svzerod" isn\'t installed')
    return tmp_path / "svzerod.npz"


def _solved(data: dict[str, Any], out: Path) -> dict[str, np.ndarray]:
    run_svzerod(data, out)
    with np.load(out) as arrays:
        return dict(arrays)


def _variables(data: dict[str, Any], out: Path) -> dict[str, np.ndarray]:
    data[OPTIONS]["output_variable_based"] = True
    found = _solved(data, out)
    return dict(zip(found["name"].tolist(), found["y"].T, strict=True))


def test_its_stored_result_is_found(out: Path) -> None:
    """`pressure_out` of its result_pulsatileFlow_R_RCR.json, steps into the last cycle."""
    found = _solved(_windkessel(), out)
    stored = {0: 3274.0316427422, 50: 8691.8409466611, 155: -13.9181123136, 200: 3274.0316427422}
    assert found["pressure_out"][list(stored), 0] == pytest.approx(list(stored.values()), abs=1e-9)
    run = run_svzerod(_windkessel(), out)
    assert run.periodic
    assert run.cycles == 10


def test_a_last_cycle_that_still_changes_is_reported(out: Path) -> None:
    data = _windkessel(number_of_cardiac_cycles=1, steady_initial=False)
    run = run_svzerod(data, out)
    found = _solved(data, out)
    columns = [found[f"{kind}_{end}"] for kind in ("flow", "pressure") for end in ("in", "out")]
    change = max(float(np.abs(x[-1] - x[0])[0] / np.abs(x).mean()) for x in columns)
    assert run.change == pytest.approx(change)
    assert run.periodic is False
    every = run_svzerod(_windkessel(output_all_cycles=True, output_variable_based=True), out)
    assert every.periodic
    assert run_svzerod(_windkessel(output_mean_only=True), out).periodic is None


def test_a_small_vessel_that_still_changes_is_reported(out: Path) -> None:
    """One with 1/400 of the flow, whose Windkessel fills with a time constant of 5 s."""
    data = _windkessel(number_of_cardiac_cycles=35, number_of_time_pts_per_cardiac_cycle=11,
                       steady_initial=False)  # fmt: skip
    data["boundary_conditions"] = [
        {"bc_name": "IN", "bc_type": "FLOW", "bc_values": {"Q": [5.0, 5.0], "t": [0.0, 1.0]}},
        {"bc_name": "A", "bc_type": "RESISTANCE", "bc_values": {"R": 100.0, "Pd": 0.0}},
        {"bc_name": "B", "bc_type": "RCR",
         "bc_values": {"Rp": 2e4, "Rd": 2e4, "C": 5e-4, "Pd": 0.0}},
    ]  # fmt: skip
    ends: list[dict[str, str]] = [{"inlet": "IN"}, {"outlet": "A"}, {"outlet": "B"}]
    data["vessels"] = [_vessel(k, f"v{k}", {"R_poiseuille": 1.0}, **ends[k]) for k in range(3)]
    data["junctions"] = [{"junction_name": "J", "junction_type": "NORMAL_JUNCTION",
                          "inlet_vessels": [0], "outlet_vessels": [1, 2]}]  # fmt: skip
    run = run_svzerod(data, out)
    assert run.change == pytest.approx(np.exp(-34 / 5) - np.exp(-35 / 5), rel=0.03)
    assert run.periodic is False


def test_no_temporary_folder_can_shorten_a_table(
    out: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tempfile.tempdir", "/no/such/folder")
    assert run_svzerod(_windkessel(), out).periodic


def test_both_kinds_of_table_hold_the_same_numbers(out: Path) -> None:
    data = _windkessel(output_derivative=True)
    data["vessels"][0]["vessel_name"] = "a,b"
    arrays = _solved(data, out)
    run_svzerod(data, out.with_suffix(".csv"))
    with out.with_suffix(".csv").open(newline="") as handle:
        rows = list(csv.reader(handle))
    assert {row[0] for row in rows[1:]} == {"a,b"}
    for place, name in enumerate(rows[0][2:], 2):
        assert [float(row[place]) for row in rows[1:]] == arrays[name][:, 0].tolist()


def test_cycles_added_until_means_stay_are_whole(out: Path) -> None:
    """The package's own table restarts its times with every cycle that it adds."""
    data = _windkessel(number_of_cardiac_cycles=2, use_cycle_to_cycle_error=True)
    values = {"Ra1": 10.0, "Ra2": 10.0, "Rv1": 200.0, "Ca": 1e-4, "Cc": 1e-2, "P_v": 0.0}
    values |= {"Pim": [0.0, 0.0], "t": [0.0, 1.0]}
    data["boundary_conditions"][1] |= {"bc_type": "CORONARY", "bc_values": values}
    data[OPTIONS]["steady_initial"] = False
    run = run_svzerod(data, out)
    assert run.cycles is not None
    assert 5 <= run.cycles <= 15
    with np.load(out) as arrays:
        assert arrays["time"] == pytest.approx(np.linspace(0.0, 1.0, 201))


def test_a_closed_loop_keeps_its_volume(out: Path) -> None:
    data = _heart(number_of_cardiac_cycles=2, output_all_cycles=True)
    found = _variables(data, out)
    total = sum(found[f"V_{chamber}:CLH"] for chamber in ("RA", "RV", "LA", "LV"))
    total = total + HEART["Cpa"] * found["pressure:CLH:J_heart_outlet"]
    total = total + 0.238401833 * found["P_c:RCR"]
    assert total == pytest.approx(total[0], rel=1e-8)
    assert np.ptp(found["V_LV:CLH"]) > 30.0


def test_a_muscle_squeezes_its_coronary(out: Path) -> None:
    data = _heart(number_of_cardiac_cycles=2)
    values = {"Ra": 9.3, "Ram": 15.1, "Rv": 33.3, "Cim": 0.0037, "Ca": 0.00055}
    data["boundary_conditions"].append(
        {"bc_name": "LCA", "bc_type": "ClosedLoopCoronaryLeft", "bc_values": values}
    )
    data["vessels"].append(_vessel(1, "lad", {"R_poiseuille": 0.1}, outlet="LCA"))
    data["closed_loop_blocks"][0]["outlet_blocks"].append("lad")
    found = _variables(data, out)
    behind = found["pressure:LCA:J_heart_inlet"] + 33.3 * found["flow:LCA:J_heart_inlet"]
    stored = 0.0037 * (behind - HEART["iml"] * found["P_LV:CLH"])
    assert found["volume_im:LCA"][1:] == pytest.approx(stored[1:], rel=0.1, abs=0.02)


def test_a_valve_lets_through_what_goes_forward(out: Path) -> None:
    data = _windkessel()
    data["boundary_conditions"] = [
        {"bc_name": "IN", "bc_type": "PRESSURE", "bc_values": {"P": [99.0] * 2, "t": [0.0, 1.0]}},
        {"bc_name": "OUT", "bc_type": "RESISTANCE", "bc_values": {"R": 10.0, "Pd": 0.0}},
    ]
    data["vessels"] = [
        _vessel(0, "a", {"R_poiseuille": 20.0}, inlet="IN"),
        _vessel(1, "b", {"R_poiseuille": 20.0}, outlet="OUT"),
    ]
    sides = {"Rmax": 1e4, "Rmin": 2.0, "upstream_block": "a", "downstream_block": "b"}
    data["valves"] = [{"name": "AV", "type": "PiecewiseValve", "params": sides}]
    assert _variables(data, out)["flow:AV:b"][-1] == pytest.approx(99.0 / 52.0, rel=1e-9)


def test_initial_values_of_no_variable_are_reported(out: Path) -> None:
    data = _heart(number_of_cardiac_cycles=1)
    data["initial_condition"] |= {"V_LV": 3.0, "pressure_all": 1.0, "_why": 0.0}
    assert run_svzerod(data, out).unused == ("V_LV",)


def _changed(path: tuple[Any, ...], value: Any) -> dict[str, Any]:
    data = _windkessel()
    place: Any = data
    for key in path[:-1]:
        place = place[key]
    place[path[-1]] = value
    return data


IN, OUT, VESSEL = ("boundary_conditions", 0), ("boundary_conditions", 1), ("vessels", 0)


@pytest.mark.parametrize(
    ("path", "value", "words"),
    [
        ((*VESSEL, "zero_d_element_values", "K"), 1e-4, "parameter K .*branch0_seg0"),
        ((*VESSEL, "zero_d_element_values", "L"), 10**400, r"^.{0,400}$"),
        ((*VESSEL, "zero_d_element_type"), "Door", "block type Door"),
        ((*VESSEL, "boundary_conditions", "outlet"), "X", "No block defined with name X"),
        ((*VESSEL, "boundary_conditions"), {"inlet": "IN"}, "^svZeroDSolver"),
        ((*IN, "bc_values", "Q"), [], "'IN': Q has 0 values, t has 101; give a value for each"),
        ((*IN, "bc_values", "t", 3), 0.0, r"'IN': t goes from \S+ to 0; times must rise"),
        ((*OUT, "bc_values", "C"), -1e-4, r"'OUT': C is -0.0001; the least is 0"),
        ((*VESSEL, "zero_d_element_values", "R_poiseuille"), -1.0, "R_poiseuille is -1"),
        ((*OUT, "bc_name"), "IN", "boundary_conditions: bc_name 'IN' is given twice"),
        ((*VESSEL, "vessel_name"), "a\nb", r"vessel_name is 'a\\nb'; write a name in one line"),
        ((*VESSEL, "vessel_name"), "", "vessel_name is ''; write a name in one line"),
        ((*IN, "bc_values", "Q", 5), 1e307, "singular"),
        (
            (*VESSEL, "zero_d_element_values", "stenosis_coefficient"),
            1e9,
            "Maximum number of non-linear iterations",
        ),
        ((OPTIONS, "number_of_cardiac_cycles"), 2.5, "cycles is 2.5; write an integer of 1"),
        ((OPTIONS, "number_of_cardiac_cycles"), 10**9, "steps are .*; the limit is 10,000,000"),
        ((OPTIONS, "number_of_time_pts_per_cardiac_cycle"), 1, "is 1; write an integer of 2"),
        ((OPTIONS, "output_interval"), 0, "output_interval is 0; write an integer of 1"),
        ((OPTIONS, "coupled_simulation"), True, "coupled_simulation needs the 3D solver"),
        ((OPTIONS, "cardiac_period"), 1.2, "Inconsistent cardiac cycle period"),
        ((OPTIONS,), {}, "number_of_cardiac_cycles is missing"),
        ((OPTIONS,), 3, "simulation_parameters is 3; write an object"),
    ],
)
def test_a_faulty_case_ends_in_one_message(
    out: Path, path: tuple[Any, ...], value: Any, words: str
) -> None:
    with pytest.raises(FlowError, match=words):
        run_svzerod(_changed(path, value), out)
    assert not out.exists()


def test_a_case_without_the_package_names_the_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    script = svzerod._SCRIPT.replace("import svzerod", "import svzerod_of_nowhere")
    monkeypatch.setattr(svzerod, "_SCRIPT", script)
    with pytest.raises(FlowError, match=r"No module.*pip install 'printctl\[svzerod\]'"):
        run_svzerod(_windkessel(), tmp_path / "svzerod.csv")


def test_chains_of_r_c_l_come_close_to_the_networks_own_answer(out: Path) -> None:
    wall = GelWall(5e3)
    elastic = PulsatileConditions(
        VISCOSITY, Sine(4.0, 2.0, 1.0), outlet=WindkesselOutlet(1.0, 0.02, 9.0), wall=wall
    )
    found = _solved(svzerod_input(FORK, elastic, steps=400, cycles=8), out)
    ours = solve_pulsatile(FORK, elastic, 400)
    expected = ours.at(ours.pressure[:, FORK.vessel_nodes[:, 0]], found["time"]) * 10.0
    assert np.abs(found["pressure_in"] - expected).max() <= 1e-2 * np.ptp(expected)


def test_a_network_written_and_run_has_its_flow(out: Path) -> None:
    case, table = out.with_name("case.json"), out.with_name("out.csv")
    write_svzerod(case, FORK, CONDITIONS, steps=50)
    run_svzerod(json.loads(case.read_text()), table)
    with table.open(newline="") as handle:
        rows = list(csv.DictReader(handle))
    ours = solve_pulsatile(FORK, CONDITIONS, 50)
    time = np.array([float(row["time"]) for row in rows[:51]])
    flow = np.array([float(row["flow_in"]) for row in rows]).reshape(3, 51).T
    assert flow == pytest.approx(ours.at(ours.flow_in, time) / 1000.0, rel=2e-3)


def test_what_the_format_cant_say_isnt_written() -> None:
    twin = network_of([[0, 0, 0], [1, 1, 0], [0, 2, 0], [2, 1, 0]], [(0, 1), (2, 1), (1, 3)], 0.3)
    with pytest.raises(FlowError, match="2 inlets share one flow"):
        svzerod_input(twin, CONDITIONS)
    double = network_of([[0, 0, 0], [2, 0, 0]], [(0, 1)] * 2, 0.3)
    with pytest.raises(FlowError, match="2 vessels meet at end 0"):
        svzerod_input(double, CONDITIONS)
