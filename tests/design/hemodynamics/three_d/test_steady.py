"""Steady 3D flow, against Poiseuille's law, known resistances and its own balances."""

import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("ngsolve", reason='the extra "flow3d" isn\'t installed')

from design.errors import FlowError
from design.hemodynamics import FlowConditions, OutletLoad, PulsatileConditions, ResistanceOutlet
from design.hemodynamics.three_d import (
    FlowOptions,
    LumenMesh,
    estimate_error,
    face_mean,
    residence_time,
    shear_of_faces,
    solve_steady,
    straighten_edges,
)
from design.hemodynamics.three_d.meshing.mesh import MeshOptions, lumen_mesh
from design.hemodynamics.waveforms import Constant, Sine
from design.network import VesselNetwork
from tests.design.hemodynamics.three_d.lumens import bend, beside, pipe

MU, FLOW, RADIUS, LENGTH = 1e-3, 4.0, 0.5, 4.0
POISEUILLE = 8.0 * MU * LENGTH / (np.pi * RADIUS**4)
DRIVEN = FlowConditions(MU, inlet_flow_ul_s=FLOW, outlet_pressure_pa=7.0)


def _pinched(mesh: LumenMesh, by: float) -> LumenMesh:
    """The lumen with an elliptic section."""
    return replace(mesh, points=mesh.points * [1.0, by, 1.0])


def test_a_pipe_obeys_poiseuille() -> None:
    """With convection: the developed profile isn't changed by it, nor by the open end."""
    found = solve_steady(pipe(2, 4), DRIVEN)
    drop = found.port_pressure[0] - found.port_pressure[1]
    shear = 4.0 * MU * FLOW / (np.pi * RADIUS**3)
    assert drop == pytest.approx(POISEUILLE * FLOW, rel=1e-3)
    assert found.port_pressure[1] == pytest.approx(7.0, abs=1e-5)
    assert found.wall_shear.magnitude == pytest.approx(shear, rel=3e-3)
    assert np.all(found.wall_shear.traction[:, 2] > 0.0)
    assert found.port_flow == pytest.approx([-FLOW, FLOW], rel=1e-9)
    assert found.reynolds[0] == pytest.approx(2 * 1.06e-3 * FLOW / (np.pi * MU * RADIUS))
    assert found.energy.imbalance < 1e-5
    assert found.energy.viscous_nw == pytest.approx(POISEUILLE * FLOW**2, rel=1e-3)


def test_finer_meshes_converge_with_fourth_order() -> None:
    """Quadratic edges let go of a circle's area by the fourth power of their length."""
    error = []
    for rings in (1, 2):
        found = solve_steady(pipe(rings, 3 * rings), DRIVEN, FlowOptions(convection=False))
        error.append(found.port_pressure[0] - found.port_pressure[1] - POISEUILLE * FLOW)
    assert 3.0 < np.log2(error[0] / error[1]) < 5.0


def test_an_elliptic_inlet_has_its_own_profile() -> None:
    """Δp = 4 μ L Q (a² + b²)/(π a³ b³), and nothing to develop behind the inlet."""
    a, b = RADIUS, 0.7 * RADIUS
    found = solve_steady(_pinched(pipe(2, 4), 0.7), DRIVEN)
    exact = 4.0 * MU * LENGTH * FLOW * (a * a + b * b) / (np.pi * a**3 * b**3)
    assert found.port_pressure[0] - found.port_pressure[1] == pytest.approx(exact, rel=1e-3)
    # With the wrong profile flow would turn to develop, and lose kinetic energy.
    assert found.energy.imbalance < 1e-5


def test_pressures_and_resistances_divide_by_hand() -> None:
    mesh, given, resistance = pipe(2, 4), 4.0, 0.3
    by_pressure = solve_steady(mesh, FlowConditions(MU, inlet_pressure_pa=given))
    assert by_pressure.port_flow[1] == pytest.approx(given / POISEUILLE, rel=2e-3)
    behind = PulsatileConditions(
        MU,
        Sine(given, 1.0, 1.0),
        inlet_is="pressure",
        outlet=ResistanceOutlet(resistance, distal_pa=2.0),
    )
    found = solve_steady(mesh, behind)
    flow = (given - 2.0) / (POISEUILLE + resistance)
    assert found.port_flow[1] == pytest.approx(flow, rel=2e-3)
    assert found.port_pressure[1] == pytest.approx(2.0 + resistance * found.port_flow[1], rel=1e-5)


def test_inlets_on_one_supply_share_its_pressure_and_outlets_have_their_own() -> None:
    """Two pipes side by side: flow divides by hand between different resistances."""
    wide, narrow = pipe(2, 4), pipe(2, 4, 0.4 * RADIUS)
    mesh = beside(wide, narrow, np.array([3.0, 0.0, 0.0]))
    other = POISEUILLE / 0.4**4
    outlet = {1: ResistanceOutlet(1.0), 3: ResistanceOutlet(2.0, distal_pa=-1.0)}
    found = solve_steady(mesh, PulsatileConditions(MU, Constant(2.0), outlet=outlet))
    # p = (R₁ + 1) Q₁ = (R₂ + 2) Q₂ - 1 with Q₁ + Q₂ = 2.
    first = (2.0 * (other + 2.0) - 1.0) / (POISEUILLE + 1.0 + other + 2.0)
    assert found.port_flow == pytest.approx([-first, first, first - 2.0, 2.0 - first], rel=3e-3)
    assert found.port_pressure[0] == pytest.approx(found.port_pressure[2], rel=1e-3)


def test_a_given_outlet_flow_comes_out() -> None:
    asked = FlowConditions(MU, inlet_pressure_pa=5.0, outlet_flow_ul_s={1: 2.5})
    found = solve_steady(pipe(2, 3), asked)
    assert found.port_flow == pytest.approx([-2.5, 2.5], rel=1e-6)
    assert found.port_pressure[1] == pytest.approx(5.0 - 2.5 * POISEUILLE * 0.999, rel=3e-3)


@pytest.mark.slow
def test_a_bend_loses_more_the_faster_and_balances() -> None:
    """Dean flow: in the limit of slow flow a bend is a pipe of its axis' length, nearly."""
    mesh = bend(2, 6)
    drop = []
    for flow in (0.1, 20.0):
        found = solve_steady(mesh, FlowConditions(MU, inlet_flow_ul_s=flow))
        drop.append((found.port_pressure[0] - found.port_pressure[1]) / flow)
        assert found.mass_imbalance < 1e-10
        assert found.energy.imbalance < 3e-3
    axis = 8.0 * MU * (1.5 * np.pi / 2.0) / (np.pi * RADIUS**4)
    assert drop[0] == pytest.approx(axis, rel=0.02)
    assert drop[1] > 1.02 * drop[0]


def test_two_orders_bound_the_error() -> None:
    mesh = pipe(2, 3)
    found = solve_steady(mesh, DRIVEN)
    estimate = estimate_error(mesh, DRIVEN, found)
    drop = found.port_pressure[0] - found.port_pressure[1]
    assert 1e-5 < estimate.pressure < 5e-3
    assert estimate.flow < 1e-9
    assert abs(drop / (POISEUILLE * FLOW) - 1.0) < estimate.pressure + 4e-4  # of the shape


@pytest.mark.parametrize(("radius", "length"), [(0.5, 3.0), (0.05, 0.4), (0.25, 3.0)])
def test_wall_shear_is_off_by_about_what_is_estimated(radius: float, length: float) -> None:
    """Of a lumen meshed as products are: at single nodes errors of both signs cancel."""
    ends, none = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, length]]), np.zeros(1)
    one = VesselNetwork.from_segments(ends, np.array([[0, 1]]), np.array([radius]), none, none)
    mesh, _ = straighten_edges(lumen_mesh(one, MeshOptions()))
    driven = FlowConditions(MU, inlet_flow_ul_s=10.0 * radius**2)
    found = solve_steady(mesh, driven, FlowOptions(order=2))
    estimate = estimate_error(mesh, driven, found)
    _, area, shear = shear_of_faces(found)
    mean = float(area @ face_mean(shear)) / float(area.sum())
    error = abs(mean / (4.0 * MU * 10.0 * radius**2 / (np.pi * radius**3)) - 1.0)
    assert 0.5 * error < estimate.wall_shear < 3.0 * error


def test_age_at_the_outlet_is_volume_over_flow() -> None:
    mesh = bend(2, 6)
    found = solve_steady(mesh, FlowConditions(MU, inlet_flow_ul_s=FLOW))
    age = residence_time(found)
    volume = np.pi * RADIUS**2 * 1.5 * np.pi / 2.0
    assert age.volume_ul == pytest.approx(volume, rel=1e-3)
    assert age.mean_s == pytest.approx(age.volume_ul / FLOW, rel=1e-9)
    assert np.isnan(age.port_age[0])
    assert age.port_age[1] == pytest.approx(age.mean_s, rel=1e-9)
    # The core goes twice as fast as the mean; the wall's fluid stays until it diffuses away.
    assert age.age.max() > 3.0 * age.mean_s
    assert age.age.min() > -0.2 * age.mean_s


def test_what_cannot_be_solved_is_refused_with_numbers(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = pipe(1, 2)
    with pytest.raises(FlowError, match=r"Reynolds number 2[0-9]{3} at port 0 \(node 0, radius"):
        solve_steady(mesh, FlowConditions(MU, inlet_flow_ul_s=2000.0))
    with pytest.raises(FlowError, match=r"takes some 0\.2 GB, above the 0\.1 GB allowed"):
        solve_steady(mesh, DRIVEN, FlowOptions(memory_gb=0.1))
    with pytest.raises(FlowError, match="no pressure is determined"):
        solve_steady(mesh, FlowConditions(MU, inlet_flow_ul_s=1.0, outlet_flow_ul_s={1: 1.0}))
    with pytest.raises(FlowError, match="node 7 isn't at a port"):
        solve_steady(mesh, FlowConditions(MU, inlet_flow_ul_s=1.0, outlet_flow_ul_s={7: 1.0}))
    with pytest.raises(FlowError, match="faces have label 9"):
        solve_steady(replace(mesh, label=np.where(mesh.label == 2, 9, mesh.label)), DRIVEN)
    monkeypatch.setitem(sys.modules, "ngsolve", None)
    with pytest.raises(FlowError, match=r"printctl\[flow3d\]"):
        solve_steady(mesh, DRIVEN)


def test_resistances_behind_outlets_hold_in_space() -> None:
    behind = {1: OutletLoad(2.5, 7.0)}
    found = solve_steady(pipe(1, 2), FlowConditions(1e-3, 4.0, behind=behind), FlowOptions(2))
    assert found.port_pressure[1] == pytest.approx(7.0 + 2.5 * found.port_flow[1], rel=1e-4)
