"""Pulsatile 0D flow, a vessel's coefficients, waveforms: against transfer functions and books."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    GelWall,
    PressureOutlet,
    PulsatileConditions,
    ResistanceOutlet,
    RigidWall,
    ThinWall,
    WindkesselOutlet,
    end_waves,
    pulsatile_summary,
    pulsatile_table,
    question_pressure,
    solve_pulsatile,
    vessel_resistance,
)
from design.hemodynamics.vessel_coefficients import (
    impedance_factor,
    integral_of_power,
    shear_factor,
)
from design.hemodynamics.waveforms import SHAPES, Constant, Sine, Tabulated, read_waveform, shape
from design.network import VesselNetwork
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree
from tests.design.networks import polyline

DENSITY = 1.06e-3
TUBE = network_of([[0, 0, 0], [20, 0, 0]], [(0, 1)], 0.5)


def _ladder() -> VesselNetwork:
    """Two loops one after the other, with two inlets and two outlets."""
    nodes = [[0, 0], [1, 0], [2, 1], [2, -1], [3, 0], [4, 1], [4, -1], [0, 2]]
    ends = [(0, 1), (1, 2), (1, 3), (2, 3), (2, 4), (3, 4), (4, 5), (4, 6), (7, 2)]
    radius = [0.5, 0.4, 0.3, 0.2, 0.3, 0.35, 0.3, 0.25, 0.3]
    return network_of([(x, y, 0) for x, y in nodes], ends, radius)


def _windkessel(omega: float, outlet: WindkesselOutlet) -> complex:
    return outlet.proximal + outlet.distal / (1 + 1j * omega * outlet.distal * outlet.compliance)


def test_one_vessel_answers_as_its_transfer_function() -> None:
    """Π of R, 4/3 of a plug's inertance and a gel's compliance, before a Windkessel."""
    outlet = WindkesselOutlet(2.0, 0.05, 20.0, distal_pa=100.0)
    conditions = PulsatileConditions(
        VISCOSITY, Sine(4.0, 2.0, 0.8), outlet=outlet, wall=GelWall(10e3)
    )
    found = solve_pulsatile(TUBE, conditions)
    omega = 2 * np.pi / 0.8
    r = 8 * VISCOSITY * 20 / (np.pi * 0.5**4)
    inertance = 4 / 3 * DENSITY * 20 / (np.pi * 0.25)
    half = 1j * omega * (2 * np.pi * 0.25 * 20 * 1.5 / 10e3) / 2
    end = 1 / (half + 1 / _windkessel(omega, outlet))
    begin = 1 / (half + 1 / (r + 1j * omega * inertance + end))
    # Re(-2i exp(iωt)) = 2 sin ωt.
    assert found.harmonic.tolist() == [0, 1]
    assert found.pressure[1, 0] == pytest.approx(-2j * begin, rel=1e-12)
    passed = -2j * (1 - half * begin) * end
    assert found.pressure[1, 1] == pytest.approx(passed, rel=1e-12)
    assert found.pressure[0].real == pytest.approx([100 + 4 * (r + 22), 100 + 4 * 22], rel=1e-12)
    assert found.flow_out[1, 0] == pytest.approx(passed / _windkessel(omega, outlet), rel=1e-12)
    table = pulsatile_table(TUBE, found, conditions)
    # Least and greatest are looked for at 200 times of a cycle.
    assert table["pressure_damping"][0] == pytest.approx(abs(passed / (2 * begin)), rel=1e-3)
    assert table["flow_damping"][0] == pytest.approx(
        abs(passed / _windkessel(omega, outlet)) / 2, rel=1e-3
    )


def test_graphs_with_loops_agree_with_a_dense_solution() -> None:
    network = _ladder()
    conditions = PulsatileConditions(
        VISCOSITY, Sine(0.0, 100.0, 0.5), inlet_is="pressure", wall=GelWall(20e3)
    )
    found = solve_pulsatile(network, conditions)
    omega = 2 * np.pi / 0.5
    radius, length = network.mean_radius(), network.lengths()
    z = vessel_resistance(network, VISCOSITY) + 1j * omega * 4 / 3 * DENSITY * length / (
        np.pi * radius**2
    )
    half = 1j * omega * 3 * np.pi * radius**2 * length / 20e3 / 2
    matrix = np.zeros((8, 8), dtype=complex)
    for (a, b), along, shunt in zip(network.vessel_nodes, z, half, strict=True):
        matrix[[a, b], [a, b]] += 1 / along + shunt
        matrix[[a, b], [b, a]] -= 1 / along
    right = np.zeros(8, dtype=complex)
    for node, value in ((0, -100j), (7, -100j), (5, 0), (6, 0)):
        matrix[node], right[node] = 0, value
        matrix[node, node] = 1
    assert found.pressure[1] == pytest.approx(np.linalg.solve(matrix, right), rel=1e-11)


@pytest.mark.parametrize("profile", ["poiseuille", "womersley"])
def test_mass_and_energy_are_conserved_at_every_harmonic(profile: str) -> None:
    for network in (random_tree(3, 40, 0.7), _ladder()):
        conditions = PulsatileConditions(
            VISCOSITY,
            shape("ejection", 4.0, 1.0),
            outlet=ResistanceOutlet(5.0),
            wall=GelWall(10e3),
            profile=profile,  # type: ignore[arg-type]
        )
        found = solve_pulsatile(network, conditions)
        summary = pulsatile_summary(network, found, conditions)
        assert summary["mass_imbalance"] <= 1e-12
        assert summary["energy_imbalance"] <= 1e-9
        waves = end_waves(network, found, conditions, 100)
        time = conditions.inlet.at(waves["time_s"]) * 60e-3
        assert waves["inlet_flow_ml_min"] == pytest.approx(time, abs=0.05 * 0.24)
        assert waves["outlet_flow_ml_min"].mean() == pytest.approx(0.24, rel=1e-9)


@pytest.mark.parametrize("steps", [8, 24, 100])
def test_a_wave_that_stops_does_not_swing_below_0(steps: int) -> None:
    """The ejection's harmonics, cut off, rang to -0.7 % of its peak at 100 steps."""
    conditions = PulsatileConditions(VISCOSITY, shape("ejection", 4.0, 1.0))
    found = solve_pulsatile(TUBE, conditions, steps)
    time = np.linspace(0.0, 1.0, 2001)
    inlet = (found.flow_in[:, 0] * np.exp(2j * np.pi * np.outer(time, found.harmonic))).real.sum(1)
    assert inlet.min() >= -1e-9 * inlet.max()
    assert inlet[:-1].mean() == pytest.approx(4.0, rel=1e-3)
    # A sine that just reaches 0 is itself.
    touching = PulsatileConditions(VISCOSITY, Sine(4.0, 4.0, 1.0))
    whole = solve_pulsatile(TUBE, touching, steps).flow_in[:, 0]
    assert np.abs(whole) == pytest.approx([4.0, 4.0])


def test_slow_womersley_flow_is_poiseuilles_and_fast_flow_isnt() -> None:
    slow = PulsatileConditions(VISCOSITY, Sine(4.0, 2.0, 1000.0), profile="womersley")
    lumped = replace(slow, profile="poiseuille")
    one, other = solve_pulsatile(TUBE, slow), solve_pulsatile(TUBE, lumped)
    assert one.pressure[1] == pytest.approx(other.pressure[1], rel=1e-5)
    r = vessel_resistance(TUBE, VISCOSITY)[0]
    assert one.pressure[1, 0] == pytest.approx(-2j * r, rel=1e-3)
    assert pulsatile_table(TUBE, one, slow)["quasi_steady"][0] == 1
    fast = replace(slow, inlet=Sine(4.0, 2.0, 0.05))
    table = pulsatile_table(TUBE, solve_pulsatile(TUBE, fast), fast)
    assert table["quasi_steady"][0] == 0
    assert table["womersley"][0] == pytest.approx(0.5 * np.sqrt(40 * np.pi * DENSITY / VISCOSITY))


def test_waves_run_as_bramwell_and_hill_say() -> None:
    """c² = A/(ϱ dA/dp): in gel of ν = ½, E/(3 ϱ); in a thin tube E h/(2 ϱ r (1 - ν²))."""
    for wall, squared in (
        (GelWall(10e3), 10e3 / (3 * DENSITY)),
        (ThinWall(1e5, 0.02), 1e5 * 0.02 / (2 * DENSITY * 0.5 * 0.75)),
    ):
        conditions = PulsatileConditions(VISCOSITY, Sine(1.0, 0.5, 1.0), wall=wall)
        table = pulsatile_table(TUBE, solve_pulsatile(TUBE, conditions), conditions)
        assert table["wave_speed_mm_s"][0] == pytest.approx(np.sqrt(squared), rel=1e-12)
    rigid = PulsatileConditions(VISCOSITY, Sine(1.0, 0.5, 1.0), wall=RigidWall())
    table = pulsatile_table(TUBE, solve_pulsatile(TUBE, rigid), rigid)
    assert np.isinf(table["wave_speed_mm_s"][0])
    assert table["wave_share"][0] == 0


def test_shear_that_turns_round_is_told_from_shear_that_doesnt() -> None:
    steady, turning = (
        PulsatileConditions(VISCOSITY, Sine(mean, 1.0, 100.0)) for mean in (2.0, 0.0)
    )
    shares = [
        pulsatile_table(TUBE, solve_pulsatile(TUBE, c), c)["oscillating_shear"][0]
        for c in (steady, turning)
    ]
    assert shares == pytest.approx([0.0, 0.5], abs=1e-9)


def test_each_outlet_may_have_a_condition_of_its_own() -> None:
    network = network_of(
        [[0, 0, 0], [1, 0, 0], [2, 1, 0], [2, -1, 0]], [(0, 1), (1, 2), (1, 3)], 0.4
    )
    r = vessel_resistance(network, VISCOSITY)[1]
    conditions = PulsatileConditions(
        VISCOSITY, Constant(3.0), outlet={2: PressureOutlet(), 3: ResistanceOutlet(float(r))}
    )
    assert solve_pulsatile(network, conditions).flow_in[0].real == pytest.approx([3, 2, 1])
    with pytest.raises(FlowError, match=r"outlet 3 has no condition \(1 of 2"):
        solve_pulsatile(network, replace(conditions, outlet={2: PressureOutlet()}))
    with pytest.raises(FlowError, match="node 1 has a condition"):
        wrong = {1: PressureOutlet(), 2: PressureOutlet(), 3: PressureOutlet()}
        solve_pulsatile(network, replace(conditions, outlet=wrong))


def test_what_has_no_solution_says_why() -> None:
    wave = Sine(1.0, 0.5, 1.0)
    conditions = PulsatileConditions(VISCOSITY, wave)
    apart = network_of([[0, 0, 0], [1, 0, 0], [5, 0, 0], [6, 1, 0]], [(0, 1), (2, 3)], 0.2)
    with pytest.raises(FlowError, match="vessel 1 lies in an isolated part without inlet"):
        solve_pulsatile(apart, replace(conditions, inlets=(0,)))
    flat = network_of([[0, 0, 0], [0, 0, 0]], [(0, 1)], 0.2)
    with pytest.raises(FlowError, match="vessel 0 has zero length"):
        solve_pulsatile(flat, conditions)
    with pytest.raises(FlowError, match="periods 1 and 2 s"):
        outlet = PressureOutlet(Sine(0.0, 1.0, 2.0))
        solve_pulsatile(TUBE, replace(conditions, outlet=outlet))
    with pytest.raises(FlowError, match="young_pa is -1 Pa"):
        GelWall(-1.0)
    with pytest.raises(FlowError, match="resistance is 0 "):
        ResistanceOutlet(0.0)


# Resistance, inertance and compliance of a vessel; Womersley flow.


TAPER = polyline([[0.0, 0, 0], [2, 0, 0], [5, 0, 0]], [0.6, 0.4, 0.2])


def test_walls_give_way_as_in_the_books() -> None:
    r2, r3 = integral_of_power(TAPER, 2)[0], integral_of_power(TAPER, 3)[0]
    assert GelWall(10e3).compliance(TAPER)[0] == pytest.approx(3 * np.pi * r2 / 10e3)
    assert ThinWall(1e5, 0.1).compliance(TAPER)[0] == pytest.approx(3 * np.pi * r3 / (2 * 1e4))
    with pytest.raises(FlowError, match="Poisson's ratio lies between"):
        GelWall(1e4, poisson=0.7)


def _by_finite_volumes(alpha: float, rings: int = 1500) -> tuple[complex, complex]:
    """Pressure and wall shear per flow over Poiseuille's, from iα² u = G + ∇²u in unit radius."""
    edge = np.arange(rings + 1) / rings
    area = np.pi * np.diff(edge**2)
    across = 2 * np.pi * edge[1:-1] * rings
    wall = 2 * np.pi * 2 * rings
    diagonal = 1j * alpha**2 * area
    diagonal[:-1] += across
    diagonal[1:] += across
    diagonal[-1] += wall
    # Thomas' algorithm, G = 1.
    right = area.astype(complex)
    for k in range(1, rings):
        part = across[k - 1] / diagonal[k - 1]
        diagonal[k] -= part * across[k - 1]
        right[k] += part * right[k - 1]
    u = right
    u[-1] /= diagonal[-1]
    for k in range(rings - 2, -1, -1):
        u[k] = (right[k] + across[k] * u[k + 1]) / diagonal[k]
    flow = (u * area).sum()
    return np.pi / 8 / flow, (u[-1] * 2 * rings) / (4 * flow / np.pi)


@pytest.mark.parametrize("alpha", [0.1, 0.29, 0.31, 2.0, 12.0])
def test_oscillating_flow_solves_womersleys_equation(alpha: float) -> None:
    pressure, shear = _by_finite_volumes(alpha)
    assert impedance_factor(np.array([alpha]))[0] == pytest.approx(pressure, rel=2e-5)
    assert shear_factor(np.array([alpha]))[0] == pytest.approx(shear, rel=2e-5)


def test_a_million_millimetres_of_mercury_are_questioned() -> None:
    question_pressure(133.322 * 500)
    with pytest.raises(FlowError, match=r"1e\+06 mmHg.*another unit"):
        question_pressure(133.322e6)


@pytest.mark.parametrize("power", [2, 3, -2, -4])
def test_tapers_are_integrated(power: int) -> None:
    middle = (np.arange(50_000) + 0.5) / 50_000 * 5
    radius = np.interp(middle, [0, 2, 5], TAPER.radius)
    by_sum = (radius**power).mean() * 5
    assert integral_of_power(TAPER, power)[0] == pytest.approx(by_sum, rel=1e-7)


def test_the_series_and_the_functions_meet_and_large_numbers_dont_overflow() -> None:
    below, above = impedance_factor(np.array([0.3 - 1e-9, 0.3]))
    assert below == pytest.approx(above, rel=1e-8)
    assert np.isfinite(impedance_factor(np.array([0.0, 1e4]))).all()


# Waveforms.


NAN = float("nan")


def test_a_table_repeats_and_is_joined_by_lines_or_a_spline() -> None:
    wave = Tabulated(np.array([0.0, 1.0, 3.0]), np.array([0.0, 2.0, 0.0]))
    assert wave.period_s == 3.0
    assert wave.at(np.array([0.5, 2.0, 3.5, -1.0])) == pytest.approx([1.0, 1.0, 1.0, 1.0])
    open_end = Tabulated(np.array([0.0, 1.0]), np.array([0.0, 2.0]), period_s=2.0)
    assert open_end.at(np.array([1.5])) == pytest.approx([1.0])
    time = np.arange(24) / 12
    wave = Tabulated(time, np.sin(np.pi * time), 2.0, "spline")
    between = np.linspace(-1, 3, 97)
    assert wave.at(between) == pytest.approx(np.sin(np.pi * between), abs=2e-4)


def test_shapes_have_the_mean_they_are_asked_for() -> None:
    for name in SHAPES:
        wave = shape(name, 3.0, 0.8)
        assert wave.at(np.arange(4000) * 0.8 / 4000).mean() == pytest.approx(3.0, rel=1e-4)
    coronary = shape("kassab", 1.0, 0.7).at(np.arange(700) / 1000)
    # The trunk's 23.9 and 42.3 of a mean of 32.0 mL/min (Huo & Kassab 2006).
    assert (coronary.min(), coronary.max()) == pytest.approx((0.746, 1.322), abs=0.02)
    # Half a sine over 0.4 of the cycle has a mean of 0.4 · 2/π of its peak.
    peak = shape("ejection", 1.0, 1.0).at(np.array([0.2]))[0]
    assert peak == pytest.approx(np.pi / 0.8, rel=1e-3)


@pytest.mark.parametrize(
    ("time", "value", "period", "words"),
    [
        ([0, 1, 2], [1, NAN, 1], None, r"sample 2 of the waveform is missing \(1 of 3"),
        ([0, 1, 1], [1, 2, 1], None, "times don't rise: 1 s follows 1 s"),
        ([0, 1, 2], [1, 2, 1], -2.0, "period is -2 s"),
        ([0, 1, 2], [1, 2, 1], 1.5, "span 2 s, more than its period 1.5 s"),
        ([0, 1, 2], [1, 2, 2], None, "ends at 2 and began at 1"),
        ([0, 1], [1, 2, 1], None, "2 times and 3 values"),
        ([0], [1], None, "1 samples"),
    ],
)
def test_what_is_no_waveform_is_refused(time, value, period, words):
    with pytest.raises(FlowError, match=words):
        Tabulated(np.array(time, float), np.array(value, float), period)


def test_files_say_which_line_is_wrong(tmp_path: Path) -> None:
    path = tmp_path / "wave.csv"
    path.write_text("time_s,flow_ml_min\n0,1\n0.5,3\n1,1\n")
    wave = read_waveform(path, "flow_ml_min", 10.0)
    assert wave.at(np.array([0.25])) == pytest.approx([20.0])
    path.write_text("time_s,flow_ml_min\n0,1\n0.5,\n1,1\n")
    with pytest.raises(FlowError, match=r"wave.csv, line 3: '' is no number"):
        read_waveform(path, "flow_ml_min")
    path.write_text("t,q\n0,1\n")
    with pytest.raises(FlowError, match="no column time_s"):
        read_waveform(path, "flow_ml_min")
