"""Fluids, losses, loops balanced, sensitivities: steady 0D flow beyond plain tubes."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.optimize import brentq

from design.errors import FlowError
from design.hemodynamics import (
    Carreau,
    FlowConditions,
    Losses,
    Newtonian,
    OutletLoad,
    PowerLaw,
    Pries1994,
    Stenosis,
    balance,
    flow_spread,
    flow_summary,
    solve_flow,
    vessel_resistance,
)
from design.hemodynamics.zero_d.steady import flow_and_sensitivity
from design.network import VesselKind, VesselNetwork
from tests.design.hemodynamics.networks import VISCOSITY, network_of, random_tree
from tests.design.networks import network, polyline

BLOOD = Carreau()


def _tube_flow(fluid: Carreau, radius: float, gradient: float) -> float:
    """Flow by the velocity profile itself: Q = π ∫ r² γ̇ dr with τ = r G/2, γ̇ solved for."""

    def rate(r: float) -> float:
        stress = gradient * r / 2.0
        return float(brentq(lambda g: g * float(fluid.viscosity(np.array(g))) - stress, 0.0, 1e12))

    return float(np.pi * quad(lambda r: r**2 * rate(r), 0.0, radius, epsrel=1e-10)[0])


@pytest.mark.parametrize("gradient", [0.01, 1.0, 30.0, 1000.0])
def test_carreau_in_a_tube_is_its_velocity_profile_integrated(gradient: float) -> None:
    radius = 0.3
    flow = _tube_flow(BLOOD, radius, gradient)
    network = network_of([[0, 0, 0], [7, 0, 0]], [(0, 1)], radius)
    solution = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=flow, fluid=BLOOD))
    assert solution.pressure[0] == pytest.approx(7 * gradient, rel=1e-7)
    assert solution.wall_shear[0] == pytest.approx(gradient * radius / 2, rel=1e-7)


@pytest.mark.parametrize("index", [0.3, 0.7, 1.0, 1.6])
def test_a_power_law_fluid_follows_its_closed_form_in_a_taper(index: float) -> None:
    """−dp/ds = 2 K/r ((3n+1)/(nπ) Q/r³)ⁿ with r = a + cs, integrated by hand."""
    consistency, flow, a, b, length = 0.02, 5.0, 0.5, 0.25, 8.0
    network = polyline([[0.0, 0, 0], [length, 0, 0]], [a, b])
    fluid = PowerLaw(consistency, index)
    found = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=flow, fluid=fluid))
    factor = 2 * consistency * ((3 * index + 1) / (index * np.pi) * flow) ** index
    whole = factor * (b ** (-3 * index) - a ** (-3 * index)) / (-3 * index) * length / (b - a)
    assert found.pressure[0] == pytest.approx(whole, rel=1e-12 if index == 1 else 1e-5)


def test_power_law_branches_divide_by_their_closed_form() -> None:
    """Q ~ r^(3 + 1/n) at the same drop and length."""
    n = 0.5
    network = network_of([[0, 0, 0], [5, 0, 0]], [(0, 1), (0, 1)], [0.4, 0.2])
    fluid = PowerLaw(0.05, n)
    found = solve_flow(network, FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0, fluid=fluid))
    assert found.flow[0] / found.flow[1] == pytest.approx(2 ** (3 + 1 / n), rel=1e-9)
    assert found.flow.sum() == pytest.approx(3.0, rel=1e-12)


@pytest.mark.parametrize("fluid", [BLOOD, PowerLaw(0.02, 0.4), PowerLaw(0.001, 1.7)])
def test_mass_and_energy_are_conserved_in_trees_of_any_fluid(fluid):
    network = random_tree(3, 60, 0.4)
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=20.0, fluid=fluid)
    told = flow_summary(network, solve_flow(network, conditions), conditions)
    assert told["mass_imbalance"] < 1e-12
    assert told["energy_imbalance"] < 1e-9


def test_blood_flows_thinner_where_vessels_are_narrow() -> None:
    """Pries et al. 1994 at 0.45: the in vivo law's own formula, typed once more."""
    radius = np.array([0.01, 0.05, 0.5])
    d = 2e3 * radius
    fluid = Pries1994(4e-3, 0.45)
    network = network_of([[0, 0, 0], [1, 0, 0]], [(0, 1)] * 3, radius)
    found = solve_flow(network, FlowConditions(VISCOSITY, inlet_pressure_pa=10.0, fluid=fluid))
    s = (d / (d - 1.1)) ** 2
    at_45 = 6 * np.exp(-0.085 * d) + 3.2 - 2.44 * np.exp(-0.06 * d**0.645)
    viscosity = 1.25e-3 * (1 + (at_45 - 1) * s) * s
    assert found.flow == pytest.approx(10 * np.pi * radius**4 / (8 * viscosity), rel=1e-12)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: PowerLaw(0.0, 0.5), "consistency"),
        (lambda: PowerLaw(1.0, 0.0), "index is 0"),
        (lambda: Carreau(0.001, 0.003), "swap them"),
        (lambda: Carreau(index=2.0), "0.1 to 1"),
        (lambda: Pries1994(4e-3, 0.9), "haematocrit"),
        (lambda: Newtonian(-1.0), "above 0"),
        (lambda: Stenosis(0, 1.2, 1.0), "0.1 to 1"),
        (lambda: Stenosis(0, 0.5, -1.0), "length above 0"),
        (lambda: Losses(junction=-1.0), "0 to 100"),
        (lambda: _solved(Stenosis(9, 0.5, 1.0)), "has 0 to 2"),
        (lambda: _solved(Stenosis(0, 0.5, 9.0)), "the vessel 4 mm"),
        (lambda: balance(ladder(3), FLOW, [1.0, 2.0]), "2 shares for 3"),
        (lambda: balance(ladder(3), FLOW, [1.0, 0.0, 1.0]), "a share is 0"),
        (lambda: balance(ladder(3), FLOW, [1, np.nan, 1]), "nan"),
        (lambda: balance(FORK, FLOW), "no vessel of kind connection"),
        (lambda: balance(ladder(4), replace(FLOW, fluid=Carreau())), "Newtonian fluid without"),
        (lambda: balance(ladder(4), replace(FLOW, losses=Losses(1.0))), "Newtonian fluid without"),
        (lambda: balance(ladder(4), replace(FLOW, behind=LOAD)), "Newtonian fluid without losses"),
    ],
)
def test_what_means_nothing_is_refused(make: object, words: str) -> None:
    with pytest.raises(FlowError, match=words):
        make()  # type: ignore[operator]


# Losses at stenoses and bifurcations.


DENSITY = 1.06e-3
FORK = network_of(
    [[0, 0, 0], [4, 0, 0], [8, 2, 0], [8, -2, 0]], [(0, 1), (1, 2), (3, 1)], [0.5, 0.4, 0.3]
)


def test_a_stenosis_takes_what_young_and_tsai_found() -> None:
    network = network_of([[0, 0, 0], [20, 0, 0]], [(0, 1)], 1.0)
    flow, share, length = 400.0, 0.5, 3.0
    losses = Losses(stenoses=(Stenosis(0, share, length),))
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=flow, losses=losses)
    speed = flow / np.pi
    # K_v = 32 (0.83 L_s + 1.64 D_s)/D₀ (A₀/A_s)², of Δp = K_v μ U/D₀.
    viscous = 32 * (0.83 * length + 1.64 * 1.0) / 2 * 16 * VISCOSITY * speed / 2
    inertial = 1.52 / 2 * (4 - 1) ** 2 * DENSITY * speed**2
    rest = 8 * VISCOSITY * (20 - length) * flow / np.pi
    found = solve_flow(network, conditions)
    assert found.pressure[0] == pytest.approx(viscous + inertial + rest, rel=1e-12)
    assert found.loss is not None
    assert found.loss[0] == pytest.approx(inertial, rel=1e-12)


def test_a_junction_takes_k_heads_of_each_vessel_that_leaves_it() -> None:
    conditions = FlowConditions(
        VISCOSITY, inlet_flow_ul_s=50.0, inlets=(0,), outlets=(2, 3), losses=Losses(junction=0.8)
    )
    found = solve_flow(FORK, conditions)
    first, last = FORK.vessel_nodes.T
    viscous = vessel_resistance(FORK, VISCOSITY) * found.flow
    head = 0.8 * DENSITY / 2 * found.velocity * np.abs(found.velocity) * [0, 1, 1]
    drop = found.pressure[first] - found.pressure[last]
    assert found.flow[2] < 0 < found.flow[1]
    assert drop == pytest.approx(viscous + head, rel=1e-9)


@pytest.mark.parametrize("pressure", [1.0, 1e3, 1e6])
@pytest.mark.parametrize("fluid", [None, Carreau()])
def test_strong_losses_settle_and_balance(pressure: float, fluid: Carreau | None) -> None:
    network = random_tree(5, 40, 0.5)
    losses = Losses(junction=20.0, stenoses=(Stenosis(0, 0.2, 0.01), Stenosis(7, 0.5, 0.01)))
    conditions = FlowConditions(VISCOSITY, inlet_pressure_pa=pressure, losses=losses, fluid=fluid)
    told = flow_summary(network, solve_flow(network, conditions), conditions)
    assert told["mass_imbalance"] < 1e-12
    assert told["energy_imbalance"] < 1e-9


def _solved(stenosis: Stenosis) -> object:
    losses = Losses(stenoses=(stenosis,))
    return solve_flow(
        FORK,
        FlowConditions(VISCOSITY, inlet_flow_ul_s=1.0, inlets=(0,), outlets=(2, 3), losses=losses),
    )


# Loops that carry the same.


FLOW = FlowConditions(4e-3, inlet_flow_ul_s=2.0)
PRESSURE = FlowConditions(4e-3, inlet_pressure_pa=5e5)
LOAD = {5: OutletLoad(1.0)}
A, V, C = VesselKind.ARTERY, VesselKind.VEIN, VesselKind.CONNECTION


def ladder(rungs, seed=1):
    """A rail of arteries, a rail of veins, connections between."""
    random = np.random.default_rng(seed)
    x = np.arange(rungs + 1.0)
    top, bottom = (np.column_stack([x, 0 * x + y, 0 * x]) for y in (1.0, 0.0))
    nodes = np.concatenate([top, bottom])
    step = np.arange(rungs)
    ends = np.concatenate(
        [
            np.column_stack([step, step + 1]),
            np.column_stack([step + 2 + rungs, step + 1 + rungs]),
            np.column_stack([step + 1, step + 2 + rungs]),
        ]
    )
    kind = np.repeat([A, V, C], rungs)
    radius = np.concatenate([np.full(2 * rungs, 0.3), random.uniform(0.05, 0.12, rungs)])
    return network(nodes, ends, radius, kind)


@pytest.mark.parametrize("conditions", [FLOW, PRESSURE], ids=["flow", "pressure"])
@pytest.mark.parametrize("rungs", [1, 2, 7, 40])
def test_every_loop_carries_the_same(rungs, conditions):
    rails = ladder(rungs)
    assert rungs == 1 or flow_spread(rails, conditions) > 0.1
    balanced = balance(rails, conditions)
    assert flow_spread(balanced, conditions) < 1e-9


def test_trees_and_shapes_stay_and_flow_drawn_backwards_counts_the_same():
    rails = ladder(5)
    balanced = balance(rails, FLOW)
    tree = np.repeat(rails.kind != C, 2)
    np.testing.assert_array_equal(balanced.radius[tree], rails.radius[tree])
    np.testing.assert_array_equal(balanced.points, rails.points)
    ratio = balanced.radius / rails.radius
    np.testing.assert_array_equal(ratio[::2], ratio[1::2])
    rails = ladder(4)
    ends = rails.vessel_nodes.copy()
    ends[-1] = ends[-1, ::-1]
    turned = network(rails.nodes, ends, rails.radius[::2], rails.kind)
    conditions = FlowConditions(4e-3, inlet_flow_ul_s=2.0, inlets=(0,), outlets=(5,))
    flow = solve_flow(balance(turned, conditions), conditions).flow[-4:]
    np.testing.assert_allclose(flow, [0.5, 0.5, 0.5, -0.5], rtol=1e-9)


def test_narrowing_alone_refuses_what_needs_widening():
    """Two connections side by side, then a third: both levels between them are free."""
    nodes = np.column_stack([np.arange(6.0), np.zeros(6), np.zeros(6)])
    ends = [[0, 1], [1, 2], [1, 2], [2, 3], [3, 4], [4, 5]]
    radius = np.array([0.3, 0.1, 0.08, 0.3, 0.1, 0.3])
    kind = np.array([A, C, C, A, C, V])
    chain = network(nodes, ends, radius, kind)
    assert flow_spread(balance(chain, FLOW, [1.0, 1.0, 2.0]), FLOW, [1.0, 1.0, 2.0]) < 1e-9
    with pytest.raises(FlowError, match=r"\d of 3 connections would have to be widened"):
        balance(chain, FLOW, [1.0, 1.0, 2.0], widen=False)


# Sensitivity of flows to radii, against finite differences.


WATER = 1e-3


def _mesh_of_two_loops() -> VesselNetwork:
    """Two inlets, two outlets, a bridge, a taper."""
    nodes = [[0, 0, 0], [0, 2, 0], [1, 0, 0], [1, 2, 0], [2, 0, 0], [2, 2, 0], [4, 0, 0], [4, 2, 0]]
    ends = [(0, 2), (1, 3), (2, 3), (2, 4), (3, 5), (4, 5), (4, 6), (5, 7)]
    radius = [0.5, 0.4, 0.2, 0.3, 0.35, 0.25, 0.3, 0.2]
    network = network_of(nodes, ends, radius)
    tapered = network.radius.copy()
    tapered[7] *= 0.7
    return replace(network, radius=tapered)


@pytest.mark.parametrize(
    "conditions",
    [
        FlowConditions(WATER, inlet_flow_ul_s=3.0),
        FlowConditions(WATER, inlet_pressure_pa=50.0, outlet_pressure_pa=10.0),
        FlowConditions(WATER, inlet_flow_ul_s=3.0, behind={6: OutletLoad(2.0, 5.0)}),
        FlowConditions(WATER, inlet_flow_ul_s=3.0, outlet_flow_ul_s={6: 1.0}),
    ],
)
def test_derivatives_are_those_of_central_differences(conditions: FlowConditions) -> None:
    network, step = _mesh_of_two_loops(), 1e-5
    vessels = np.array([0, 2, 3, 7])
    flow, slope = flow_and_sensitivity(network, conditions, vessels)
    assert flow == pytest.approx(solve_flow(network, conditions).flow, rel=1e-12)
    owner = np.repeat(np.arange(network.vessel_count), np.diff(network.offset))
    for column, vessel in enumerate(vessels):
        up, down = (
            solve_flow(
                replace(network, radius=network.radius * np.exp(sign * step * (owner == vessel))),
                conditions,
            ).flow
            for sign in (1.0, -1.0)
        )
        assert slope[:, column] == pytest.approx((up - down) / (2.0 * step), abs=1e-7)


def test_nonlinear_problems_are_refused() -> None:
    network = _mesh_of_two_loops()
    for more in ({"fluid": PowerLaw(0.01, 0.6)}, {"losses": Losses(junction=1.0)}):
        conditions = replace(FlowConditions(WATER, inlet_flow_ul_s=3.0), **more)
        with pytest.raises(FlowError, match="Newtonian flow without losses"):
            flow_and_sensitivity(network, conditions, np.array([0]))
