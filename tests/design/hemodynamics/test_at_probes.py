"""Lumped (0D) solutions at probes between vessel ends."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    Carreau,
    FlowConditions,
    Fluid,
    GelWall,
    PowerLaw,
    PulsatileConditions,
    RigidWall,
    solve_flow,
    solve_pulsatile,
)
from design.hemodynamics.probes import Probes, probes_along
from design.hemodynamics.waveforms import Sine
from design.hemodynamics.zero_d.at_probes import pulsatile_at_probes, steady_at_probes
from design.network import VesselNetwork
from tests.design.hemodynamics.networks import VISCOSITY, network_of

TAPER = VesselNetwork(
    nodes=np.array([[0.0, 0, 0], [6, 3, 0], [9, 3, 0]]),
    vessel_nodes=np.array([[0, 1], [1, 2]]),
    kind=np.zeros(2, dtype=np.int64),
    tree=np.zeros(2, dtype=np.int64),
    offset=np.array([0, 3, 5]),
    points=np.array([[0.0, 0, 0], [6, 0, 0], [6, 3, 0], [6, 3, 0], [9, 3, 0]]),
    radius=np.array([0.6, 0.3, 0.2, 0.2, 0.25]),
)


def _cut(network: VesselNetwork) -> VesselNetwork:
    """The same with a node more, two thirds along the first vessel (4 + 2 of 9 mm)."""
    return VesselNetwork(
        nodes=np.array([[0.0, 0, 0], [6, 0, 0], [6, 3, 0], [9, 3, 0]]),
        vessel_nodes=np.array([[0, 1], [1, 2], [2, 3]]),
        kind=np.zeros(3, dtype=np.int64),
        tree=np.zeros(3, dtype=np.int64),
        offset=np.array([0, 2, 4, 6]),
        points=np.array([[0.0, 0, 0], [6, 0, 0], [6, 0, 0], [6, 3, 0], [6, 3, 0], [9, 3, 0]]),
        radius=np.array([0.6, 0.3, 0.3, 0.2, 0.2, 0.25]),
    )


@pytest.mark.parametrize("fluid", [None, PowerLaw(0.02, 0.5), Carreau()])
def test_pressure_at_a_probe_is_that_of_a_node_there(fluid: Fluid | None) -> None:
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0, fluid=fluid)
    found = steady_at_probes(
        TAPER, solve_flow(TAPER, conditions), conditions,
        Probes(np.array([0, 0, 0, 1]), np.array([0.0, 2 / 3, 1.0, 1.0])),
    )  # fmt: skip
    nodes = solve_flow(_cut(TAPER), conditions).pressure
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
        cut = solve_pulsatile(_cut(TAPER), conditions)
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
    return network_of(nodes.tolist(), [(k, k + 1) for k in range(pieces)], 0.8)


def test_probes_off_the_network_are_refused() -> None:
    conditions = FlowConditions(VISCOSITY, inlet_flow_ul_s=3.0)
    solution = solve_flow(TAPER, conditions)
    probe = probes_along(0, 1)
    for wrong in (replace(probe, vessel=np.array([2])), replace(probe, fraction=np.array([1.5]))):
        with pytest.raises(FlowError, match="a probe is"):
            steady_at_probes(TAPER, solution, conditions, wrong)
