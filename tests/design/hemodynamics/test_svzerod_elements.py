"""Elements of svZeroDSolver's input against closed forms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from design.hemodynamics.zero_d.svzerod import case_of, result_table, run_svzerod
from tests.design.hemodynamics.svzerod_cases import case, fork, steady, wave

OMEGA = 2.0 * np.pi


def _solved(data: dict[str, Any]) -> dict[str, np.ndarray]:
    found = case_of(data)
    table = result_table(found, run_svzerod(found))
    return {"time": table.time, **table.columns}


def _windkessel(omega: float, proximal: float, storage: float, distal: float) -> complex:
    return proximal + distal / (1.0 + 1j * omega * storage * distal)


@pytest.mark.parametrize("kind", ["BloodVessel", "BloodVesselCRL"])
def test_a_vessel_before_a_windkessel_has_its_impedance(kind: str) -> None:
    r, c, i = 50.0, 1e-3, 2.0
    load = _windkessel(OMEGA, 30.0, 2e-3, 200.0)
    data = case(
        {
            "IN": ("FLOW", wave("Q", 4.0, 2.0)),
            "OUT": ("RCR", {"Rp": 30.0, "C": 2e-3, "Rd": 200.0, "Pd": 8.0}),
        },
        {"v": ({"R_poiseuille": r, "C": c, "L": i}, "IN", "OUT")},
        points=401, cycles=12, kind=kind, output_variable_based=False,
    )  # fmt: skip
    found = _solved(data)
    # What follows the compliance, in parallel with it.
    behind = load + 1j * OMEGA * i + (0.0 if kind == "BloodVessel" else r)
    beside = behind / (1.0 + 1j * OMEGA * c * behind)
    impedance = beside + (r if kind == "BloodVessel" else 0.0)
    turn = np.exp(1j * OMEGA * found["time"])
    mean = 4.0 * (r + 230.0) + 8.0
    expected = mean + (-2j * impedance * turn).real
    assert np.abs(found["pressure_in"][:, 0] - expected).max() <= 1e-3 * np.ptp(expected)
    through = 4.0 + (-2j * beside / behind * turn).real
    assert np.abs(found["flow_out"][:, 0] - through).max() <= 1e-3 * np.ptp(through)


def test_its_error_falls_with_the_square_of_the_step() -> None:
    errors = []
    for points in (101, 201):
        data = case(
            {
                "IN": ("FLOW", wave("Q", 4.0, 2.0, 3201)),
                "OUT": ("RCR", {"Rp": 30.0, "C": 2e-3, "Rd": 200.0}),
            },
            {"v": ({"R_poiseuille": 50.0}, "IN", "OUT")},
            points=points, cycles=10,
        )  # fmt: skip
        found = _solved(data)
        impedance = 50.0 + _windkessel(OMEGA, 30.0, 2e-3, 200.0)
        expected = 4.0 * 280.0 + (-2j * impedance * np.exp(1j * OMEGA * found["time"])).real
        errors.append(np.abs(found["pressure_in"][:, 0] - expected).max())
    assert 3.5 <= errors[0] / errors[1] <= 4.5


_CORONARY = {"Ra1": 100.0, "Ca": 1e-4, "Cc": 1e-3, "P_v": 5.0, "Rv1": 80.0}


def _coronary(kind: str, **values: float) -> dict[str, Any]:
    return case(
        {
            "IN": ("PRESSURE", wave("P", 100.0, 20.0)),
            "OUT": (kind, {**_CORONARY, **wave("Pim", 40.0, 30.0), **values}),
        },
        {"v": ({"R_poiseuille": 10.0}, "IN", "OUT")},
        points=401, cycles=6,
    )  # fmt: skip


def test_a_coronary_answers_its_inlet_and_its_muscle() -> None:
    found = _solved(_coronary("CORONARY", Ra2=150.0))
    turn = np.exp(1j * OMEGA * found["time"])
    ca, cc = (1j * OMEGA * _CORONARY[key] for key in ("Ca", "Cc"))
    # Pressures before and behind Ra2, from the balances of flow there.
    admit = np.array(
        [[1 / 110.0 + 1 / 150.0 + ca, -1 / 150.0], [-1 / 150.0, 1 / 150.0 + 1 / 80.0 + cc]]
    )
    before = np.linalg.solve(admit, [-20j / 110.0, -30j * cc])[0]
    mean = (100.0 - 5.0) / (10.0 + 100.0 + 150.0 + 80.0)
    expected = mean + ((-20j - before) / 110.0 * turn).real
    assert np.abs(found["flow_in"][:, 0] - expected).max() <= 2e-3 * np.ptp(expected)


def test_a_coronary_whose_resistance_may_change_and_does_not_is_the_plain_one() -> None:
    plain = _solved(_coronary("CORONARY", Ra2=150.0))
    changing = _coronary("CORONARY_VAR_RES", Ra2_min=150.0, Ra2_max=150.0, T_vc=0.3, T_vr=0.2)
    assert _solved(changing)["flow_in"] == pytest.approx(plain["flow_in"], rel=1e-9)


def test_a_contracting_muscle_lets_less_through() -> None:
    """Without capacitances: flow = (P - P_v)/(ΣR), √R along a half cosine up and one down."""
    tiny = {"Ca": 1e-9, "Cc": 1e-9}
    data = _coronary("CORONARY_VAR_RES", Ra2_min=100.0, Ra2_max=400.0, T_vc=0.4, T_vr=0.2, **tiny)
    data["simulation_parameters"] |= {"rho_infty": 0.0, "absolute_tolerance": 1e-12}
    data["boundary_conditions"][0]["bc_values"] = steady("P", 100.0)
    found = _solved(data)
    t = found["time"][1:-1]
    share = np.where(t <= 0.4, (1 - np.cos(np.pi * t / 0.4)) / 2, 0.0)
    share += np.where((t > 0.4) & (t <= 0.6), (1 + np.cos(np.pi * (t - 0.4) / 0.2)) / 2, 0.0)
    resistance = (10.0 + 10.0 * share) ** 2
    expected = 95.0 / (10.0 + 100.0 + resistance + 80.0)
    assert found["flow_in"][1:-1, 0] == pytest.approx(expected, rel=1e-5)


def test_a_stenosis_takes_the_square_of_the_flow() -> None:
    data = case(
        {"IN": ("FLOW", wave("Q", 1.0, 3.0)), "OUT": ("PRESSURE", steady("P", 20.0))},
        {"v": ({"R_poiseuille": 5.0, "C": 1e-3, "stenosis_coefficient": 7.0}, "IN", "OUT")},
        cycles=2, rho_infty=0.0,
    )  # fmt: skip
    found = _solved(data)
    flow = 1.0 + 3.0 * np.sin(OMEGA * found["time"])
    assert found["flow_in"][1:, 0] == pytest.approx(flow[1:], abs=1e-9)
    expected = 20.0 + 5.0 * flow + 7.0 * np.abs(flow) * flow
    assert found["pressure_in"][1:, 0] == pytest.approx(expected[1:], abs=1e-6)
    # The compliance stands behind the loss, at the outlet's steady pressure.
    assert found["flow_out"][1:, 0] == pytest.approx(flow[1:], abs=0.01 * np.ptp(flow))


def test_resistances_of_a_junction_divide_the_flow() -> None:
    found = _solved(fork("resistive_junction", {"R": [1.0, 2.0, 8.0]}))
    left, right = 2.0 + 20.0 + 3.0, 8.0 + 20.0 + 4.0
    centre = (5.0 + 7.0 / left + 2.0 / right) / (1.0 / left + 1.0 / right)
    assert found["flow_out"][-1] == pytest.approx(
        [5.0, (centre - 7.0) / left, (centre - 2.0) / right], rel=1e-8
    )
    assert found["pressure_in"][-1, 0] == pytest.approx(centre + 5.0 * 11.0, rel=1e-8)


def test_losses_of_a_vessel_junction_divide_the_flow() -> None:
    values = {"R_poiseuille": [2.0, 8.0], "L": [0.1, 0.0], "stenosis_coefficient": [3.0, 0.0]}
    found = _solved(fork("BloodVesselJunction", values))
    _, left, right = found["flow_out"][-1]
    centre = found["pressure_out"][-1, 0]
    assert left + right == pytest.approx(5.0, rel=1e-9)
    assert centre - 7.0 == pytest.approx((2.0 + 23.0) * left + 3.0 * left**2, rel=1e-7)
    assert centre - 2.0 == pytest.approx((8.0 + 24.0) * right, rel=1e-7)


@pytest.mark.parametrize("shift", [0.0, 0.1])
def test_tables_are_lines_between_samples(shift: float) -> None:
    time, flow = np.array([0.0, 0.13, 0.5, 0.71, 1.0]), np.array([1.0, 4.0, 2.0, 3.0, 1.0])
    table = {"Q": flow.tolist(), "t": (time + shift).tolist()}
    data = case(
        {"IN": ("FLOW", table), "OUT": ("RESISTANCE", {"R": 2.0, "Pd": 0.0})},
        {"v": ({"R_poiseuille": 1.0}, "IN", "OUT")},
        points=98, rho_infty=0.0,
    )  # fmt: skip
    found = _solved(data)
    at = found["time"][1:-1]
    expected = np.interp(at, time + shift, flow)
    # Before the first sample the first line goes on, as in svZeroDSolver.
    early = at < shift
    expected[early] = 1.0 + 3.0 * (at[early] - shift) / 0.13
    assert found["flow_in"][1:-1, 0] == pytest.approx(expected, rel=1e-12)


def test_an_initial_pressure_empties_through_its_resistances() -> None:
    data = case(
        {"IN": ("FLOW", steady("Q", 0.0)), "OUT": ("RCR", {"Rp": 1.0, "C": 0.5, "Rd": 1.0})},
        {"v": ({"R_poiseuille": 1.0}, "IN", "OUT")},
        points=201, steady_initial=False, output_variable_based=True, rho_infty=1.0,
    )  # fmt: skip
    data["initial_condition"] = {"pressure_all": 3.0, "pressure_c:OUT": 6.0}
    data["initial_condition_d"] = {"pressure_c:OUT": -12.0}
    found = case_of(data)
    run = run_svzerod(found)
    inside = run.value[:, run.names.index("pressure_c:OUT")]
    assert run.value[0, run.names.index("pressure:v:OUT")] == 3.0
    assert inside == pytest.approx(6.0 * np.exp(-run.time / 0.5), rel=1e-4)
