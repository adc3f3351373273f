"""Chambers, valves and closed loops of svZeroDSolver's input against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics.zero_d.svzerod import SvZeroDRun, case_of, run_svzerod
from design.hemodynamics.zero_d.svzerod.activation import activation_of
from tests.design.hemodynamics.svzerod_cases import case, steady, wave

OMEGA = 2.0 * np.pi
REST = {"type": "half_cosine", "t_active": 2.0, "t_twitch": 0.1}
"""Never within a period of 1."""


def _between(block: str, source: dict[str, Any], **parameters: Any) -> dict[str, Any]:
    """Return a pressure behind 20, a block, and 30 more to 0."""
    data = case(
        {"IN": ("PRESSURE", source), "OUT": ("RESISTANCE", {"R": 10.0, "Pd": 0.0})},
        {"a": ({"R_poiseuille": 20.0}, "IN", None), "b": ({"R_poiseuille": 20.0}, None, "OUT")},
        output_variable_based=True, **parameters,
    )  # fmt: skip
    sides = (("J0", ["a"], [block]), ("J1", [block], ["b"]))
    data["junctions"] = [
        {"junction_name": n, "junction_type": "NORMAL_JUNCTION", "inlet_blocks": i,
         "outlet_blocks": o} for n, i, o in sides
    ]  # fmt: skip
    return data


def _run(data: dict[str, Any]) -> tuple[SvZeroDRun, dict[str, np.ndarray]]:
    run = run_svzerod(case_of(data))
    return run, dict(zip(run.names, run.value.T, strict=True))


@pytest.mark.parametrize(
    ("kind", "values"),
    [
        ("LinearElastanceChamber", {"Emax": 9.0, "Epass": 50.0, "Vrest": 0.3}),
        ("ChamberElastanceInductor",
         {"Emax": 99.0, "Emin": 50.0, "Vrd": 0.3, "Vrs": 0.1, "Impedance": 0.0}),
        ("ChamberElastanceInductorExponential",
         {"Emax": 9.0, "Impedance": 0.0, "Kxp": 5e5, "Kxv": 1e-4, "Vaso": 0.3}),
    ],
)  # fmt: skip
def test_a_chamber_at_rest_is_a_capacitor(kind: str, values: dict[str, float]) -> None:
    data = _between("LV", wave("P", 100.0, 40.0), points=401, cycles=4, cardiac_period=1.0)
    data["chambers"] = [{"name": "LV", "type": kind, "values": values, "activation_function": REST}]
    run, found = _run(data)
    admittance = 1 / 20.0 + 1 / 30.0 + 1j * OMEGA / 50.0
    swing = -40j / 20.0 / admittance * np.exp(1j * OMEGA * run.time)
    expected = 60.0 + swing.real
    assert found["pressure:J0:LV"] == pytest.approx(expected, abs=2e-3 * np.ptp(expected))
    assert found["Vc:LV"] == pytest.approx(0.3 + expected / 50.0, abs=2e-3 * np.ptp(expected))


def test_a_passive_sphere_swells_until_its_wall_carries_the_pressure() -> None:
    thickness, radius, w1, w2 = 0.1, 1.0, 1000.0, 40.0
    data = _between("LV", steady("P", 300.0), points=401, cycles=12, steady_initial=False)
    data["chambers"] = [
        {"name": "LV", "type": "ChamberSphere", "values": {
            "rho": 1.0, "thick0": thickness, "radius0": radius, "W1": w1, "W2": w2, "eta": 50.0,
            "sigma_max": 0.0, "alpha_max": 30.0, "alpha_min": -30.0, "tsys": 0.2, "tdias": 0.5,
            "steepness": 0.005}}
    ]  # fmt: skip
    _, found = _run(data)
    s = 1.0 + found["radius:LV"][-1] / radius
    stress = 4.0 * (1.0 - s**-6.0) * (w1 + w2 * s**2)
    assert found["stress:LV"][-1] == pytest.approx(stress, rel=1e-3)
    assert found["pressure:LV:J1"][-1] == pytest.approx(stress * thickness / radius / s, rel=1e-3)
    assert found["volume:LV"][-1] == pytest.approx(4 / 3 * np.pi * radius**3 * (s**3 - 1), rel=1e-2)
    assert found["pressure:LV:J1"][-1] == pytest.approx(180.0, rel=1e-2)


@pytest.mark.parametrize("kind", ["ValveTanh", "PiecewiseValve"])
@pytest.mark.parametrize(("source", "resistance"), [(100.0, 2.0), (-100.0, 1e4)])
def test_a_valve_lets_through_what_goes_forward(
    kind: str, source: float, resistance: float
) -> None:
    data = _between("AV", steady("P", source), cycles=2)
    data["junctions"] = []
    steep = {"Steepness": 10.0} if kind == "ValveTanh" else {}
    sides = {"upstream_block": "a", "downstream_block": "b"}
    data["valves"] = [
        {"name": "AV", "type": kind, "params": {"Rmax": 1e4, "Rmin": 2.0, **steep, **sides}}
    ]
    _, found = _run(data)
    assert found["flow:AV:b"][-1] == pytest.approx(source / (50.0 + resistance), rel=1e-9)


def test_activations_have_their_shapes() -> None:
    half = activation_of({"type": "half_cosine", "t_active": 0.2, "t_twitch": 0.3}, "LV", 1.0)
    assert [half(t) for t in (0.1, 0.275, 0.35, 0.6, 1.35)] == pytest.approx([0, 0.5, 1, 0, 1])
    parts = {"contract_start": 0.1, "relax_start": 0.3}
    parts |= {"contract_duration": 0.2, "relax_duration": 0.4}
    two = activation_of({"type": "piecewise_cosine", **parts}, "LV", 1.0)
    assert [two(t) for t in (0.05, 0.2, 0.3, 0.5, 0.8)] == pytest.approx([0, 0.5, 1, 0.5, 0])
    wrapped = activation_of({"type": "wrapping_cosine", "Tsa": 0.4, "tpwave": 10.0}, "RA", 1.0)
    assert [wrapped(t) for t in (0.1, 0.5, 0.8, 0.9)] == pytest.approx([0, 0, 0.5, 1])
    hill = {"t_shift": 0.2, "tau_1": 0.2, "tau_2": 0.3, "m1": 1.3, "m2": 20.0}
    shapes = [activation_of({"type": "two_hill", **hill}, "LV", 1.0)]
    shapes += [activation_of({"type": "fourier"}, "LV", 1.0)]
    for shape in shapes:
        samples = np.array([shape(t) for t in np.arange(2000) / 1000.0])
        assert samples.min() >= -1e-12
        assert samples.max() == pytest.approx(1.0, abs=1e-4)
        assert samples[1000:] == pytest.approx(samples[:1000], abs=1e-9)
    with pytest.raises(FlowError, match=r"LV: activation_function: tau_1 is 0; write a number"):
        activation_of({"type": "two_hill", **hill, "tau_1": 0.0}, "LV", 1.0)
    with pytest.raises(FlowError, match=r"needs a cycle's length; give .* cardiac_period"):
        activation_of({"type": "fourier"}, "LV", None)


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


def _loop(**parameters: Any) -> dict[str, Any]:
    outlet = {"Rp": 0.134156617, "Rd": 1.356472458, "C": 0.238401833, "closed_loop_outlet": True}
    data = case(
        {"RCR": ("ClosedLoopRCR", outlet)},
        {"aorta": ({"R_poiseuille": 0.003348073, "L": 0.004}, None, "RCR")},
        points=100, steady_initial=False, **parameters,
    )  # fmt: skip
    data["closed_loop_blocks"] = [{
        "closed_loop_type": "ClosedLoopHeartAndPulmonary", "cardiac_cycle_period": 1.0169,
        "outlet_blocks": ["aorta"], "parameters": HEART,
    }]  # fmt: skip
    volumes = {"V_RA:CLH": 38.43, "V_RV:CLH": 96.07, "V_LA:CLH": 38.43, "V_LV:CLH": 96.07}
    data["initial_condition"] = volumes | {"P_pul:CLH": 8.0}
    return data


def test_a_heart_s_stored_result_is_ours_to_ten_digits() -> None:
    """`flow_in` and `pressure_in` of its result_closedLoopHeart_singleVessel.json."""
    found = run_svzerod(case_of(_loop(cycles=10)))
    stored = {0: (24.444014855, 55.7619197588), 10: (97.8096599152, 73.8793031422)}
    stored |= {30: (68.0175585339, 93.5549742102), 99: (24.4438404667, 55.7615586764)}
    assert found.value[list(stored), 0] == pytest.approx([q for q, _ in stored.values()], rel=1e-9)
    assert found.value[list(stored), 2] == pytest.approx([p for _, p in stored.values()], rel=1e-9)


def test_a_closed_loop_keeps_its_volume() -> None:
    data = _loop(cycles=2, output_variable_based=True, output_all_cycles=True)
    _, found = _run(data)
    total = sum(found[f"V_{chamber}:CLH"] for chamber in ("RA", "RV", "LA", "LV"))
    total = total + HEART["Cpa"] * found["pressure:CLH:J_heart_outlet"]
    total = total + 0.238401833 * found["P_c:RCR"]
    assert total == pytest.approx(total[0], rel=1e-8)
    assert np.ptp(found["V_LV:CLH"]) > 30.0


@pytest.mark.slow
def test_a_heart_steps_alike_reduced_and_by_sparse_factors(monkeypatch: pytest.MonkeyPatch) -> None:
    """One kernel steps small systems by their nonlinear part; SciPy solves large ones whole."""
    reduced = run_svzerod(case_of(_loop(cycles=1)))
    for limit in ("_FULL", "_WIDE"):
        monkeypatch.setattr(f"design.hemodynamics.zero_d.svzerod.march.{limit}", 0)
    whole = run_svzerod(case_of(_loop(cycles=1)))
    assert reduced.value == pytest.approx(whole.value, rel=1e-9)


def test_a_muscle_squeezes_its_coronary() -> None:
    data = _loop(cycles=2, output_variable_based=True)
    values = {"Ra": 9.3, "Ram": 15.1, "Rv": 33.3, "Cim": 0.0037, "Ca": 0.00055}
    data["boundary_conditions"].append(
        {"bc_name": "LCA", "bc_type": "ClosedLoopCoronaryLeft", "bc_values": values}
    )
    data["vessels"].append({
        "vessel_id": 1, "vessel_name": "lad", "zero_d_element_type": "BloodVessel",
        "zero_d_element_values": {"R_poiseuille": 0.1}, "boundary_conditions": {"outlet": "LCA"},
    })  # fmt: skip
    data["closed_loop_blocks"][0]["outlet_blocks"].append("lad")
    _, found = _run(data)
    behind = found["pressure:LCA:J_heart_inlet"] + 33.3 * found["flow:LCA:J_heart_inlet"]
    stored = 0.0037 * (behind - HEART["iml"] * found["P_LV:CLH"])
    assert found["volume_im:LCA"][1:] == pytest.approx(stored[1:], rel=0.1, abs=0.02)
    del data["closed_loop_blocks"]
    with pytest.raises(FlowError, match=r"condition RCR needs a heart \(closed_loop_blocks\)"):
        case_of(data)


def test_a_flow_may_stand_for_another_solver() -> None:
    data = _loop(cycles=1)
    data["vessels"] = []
    table = {"Q": [90.0, 90.0], "t": [0.0, 1.0169]}
    into = {"name": "in", "type": "FLOW", "location": "inlet", "connected_block": "RCR"}
    out = into | {"name": "out", "location": "outlet"}
    out["connected_block"] = "ClosedLoopHeartAndPulmonary"
    data["external_solver_coupling_blocks"] = [into | {"values": table}, out | {"values": table}]
    data["closed_loop_blocks"][0]["outlet_blocks"] = ["out"]
    data["simulation_parameters"]["output_variable_based"] = True
    _, found = _run(data)
    # ρ∞ = ½: what the begin got wrong halves with each step.
    assert found["flow:in:RCR"][40:] == pytest.approx(90.0)
    assert found["flow:J_heart_outlet:out"][40:] == pytest.approx(90.0)
    data["external_solver_coupling_blocks"][0]["periodic"] = False
    with pytest.raises(FlowError, match=r"coupling_blocks\[0\]: periodic is false; that needs"):
        case_of(data)


def test_initial_values_of_no_variable_are_told() -> None:
    data = _loop(cycles=1)
    data["initial_condition"]["V_LV"] = 3.0
    assert run_svzerod(case_of(data)).unused == ("V_LV",)
