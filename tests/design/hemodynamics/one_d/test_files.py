"""Walls of each vessel's own, and svOneDSolver's input, written card by card."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from design.errors import FlowError
from design.hemodynamics import (
    GelWall,
    OneDOptions,
    PulsatileConditions,
    ResistanceOutlet,
    RigidWall,
    ThinWall,
    VesselWalls,
    WindkesselOutlet,
    solve_one_d,
    write_svoned,
)
from design.hemodynamics.other_solvers.svoned import svoned_input
from design.hemodynamics.waveforms import Constant, Sine
from tests.design.hemodynamics.networks import network_of

LINE = network_of([[0, 0, 0], [40, 0, 0], [80, 0, 0]], [(0, 1), (1, 2)], [2.0, 1.8])
WALL = VesselWalls(np.full(2, 4e5), np.array([0.3, np.nan]), np.zeros(2))
COARSE = OneDOptions(cell_mm=10.0, samples=20)


def test_walls_of_each_vessels_own_are_the_thin_walls_where_they_are_alike() -> None:
    alike = replace(WALL, thickness_mm=np.full(2, 0.3))
    thin = ThinWall(4e5, 0.3)
    tapered = replace(LINE, radius=np.array([2.0, 1.5, 1.5, 1.0]))
    np.testing.assert_allclose(alike.compliance(tapered), thin.compliance(tapered), rtol=1e-12)


def test_pressure_outside_and_behind_lifts_the_pressure_inside_and_nothing_else() -> None:
    outlet = WindkesselOutlet(0.5, 0.1, 5.0)
    wave = Sine(100.0, 60.0, 0.8)
    bare = PulsatileConditions(4e-3, wave, outlet=outlet, wall=WALL)
    lifted = replace(
        bare,
        outlet=replace(outlet, distal_pa=900.0),
        wall=replace(WALL, external_pa=np.full(2, 900.0)),
    )
    a, b = (solve_one_d(LINE, conditions, COARSE) for conditions in (bare, lifted))
    np.testing.assert_allclose(b.pressure, a.pressure + 900.0, rtol=1e-5)
    np.testing.assert_allclose(b.flow, a.flow, rtol=1e-5)
    with pytest.raises(FlowError, match="outside"):
        svoned_input(LINE, lifted)


def test_vessels_under_unlike_pressures_share_the_pressure_where_they_meet() -> None:
    """Steady flow: the second vessel is squeezed, and narrower by what its wall law says."""
    wall = replace(WALL, external_pa=np.array([0.0, 2e3]))
    outlet = WindkesselOutlet(0.5, 0.1, 40.0)
    conditions = PulsatileConditions(4e-3, Constant(100.0), outlet=outlet, wall=wall)
    found = solve_one_d(LINE, conditions, replace(COARSE, alpha=1.0))
    assert found.pressure_out[1] == pytest.approx(40.5 * 100.0, rel=1e-3)
    stiff = wall.stiffness(np.arange(2), np.array([2.0, 1.8]))
    width = 1.0 + (found.pressure[:, 0] - wall.external_pa) / stiff
    assert found.area[:, 0] == pytest.approx(np.pi * np.array([2.0, 1.8]) ** 2 * width**2, rel=1e-4)
    ends = found.pressure_out[0, 0], found.pressure_in[1, 0]
    heads = [
        p + 0.5 * 1.06e-3 * (100.0 / a) ** 2 for p, a in zip(ends, found.area[:, 0], strict=True)
    ]
    assert heads[0] == pytest.approx(heads[1], rel=1e-5)


def test_a_viscous_wall_is_kelvin_and_voigts_with_openbfs_gamma() -> None:
    """Γ = 0.6 kg/s + 0.0015 kg·m/s over the diameter; K τ/2 = Γ/√A₀ in a thin wall."""
    walls = VesselWalls(
        np.array([4e5, 5e5]), np.array([0.3, 0.5]), np.zeros(2), viscous=np.array([False, True])
    )
    found = walls.damping(np.array([0, 1]), np.array([7.0, 4.0]))
    assert found == pytest.approx([0.0, (0.6 + 0.0015 / 8e-3) * 1e3])
    even = replace(LINE, radius=np.full(4, 2.0))
    viscous = replace(WALL, thickness_mm=np.full(2, 0.3), viscous=np.array([True, True]))
    tau = 2.0 * (600.0 + 1500.0 / 4.0) / (4 / 3 * 4e5 * 0.3 / 2.0) / np.sqrt(np.pi * 4.0)
    outlet = WindkesselOutlet(0.5, 0.1, 5.0)
    bare = PulsatileConditions(4e-3, Sine(100.0, 60.0, 0.8), outlet=outlet, wall=viscous)
    a = solve_one_d(even, bare, COARSE)
    thin = replace(bare, wall=ThinWall(4e5, 0.3))
    b = solve_one_d(even, thin, replace(COARSE, wall_viscosity_pa_s=4e5 * tau))
    np.testing.assert_allclose(a.pressure, b.pressure, rtol=1e-9)
    elastic = solve_one_d(even, thin, COARSE)
    assert np.abs(a.area - elastic.area).max() > 1e-3 * np.ptp(elastic.area)
    with pytest.raises(FlowError, match="no viscous wall"):
        svoned_input(LINE, replace(bare, wall=viscous))


# svOneDSolver's input.


FORK = network_of(
    # Inlet 1 and junction 3: numbers that the writer has to change.
    [[15, 5, 0], [0, 0, 0], [15, -5, 0], [10, 0, 0]],
    [(1, 3), (3, 0), (3, 2)],
    [0.5, 0.4, 0.3],
)
OF_THE_FORK = PulsatileConditions(
    1e-3,
    Sine(4.0, 2.0, 0.8),
    wall=GelWall(1e4),
    outlet={0: WindkesselOutlet(2.0, 0.01, 8.0, 100.0), 2: ResistanceOutlet(5.0)},
)
FIELDS = {"MODEL": 1, "NODE": 4, "JOINT": 4, "SEGMENT": 16, "MATERIAL": 9, "SOLVEROPTIONS": 9}


def cards(text: str) -> tuple[list[list[str]], dict[str, list[list[float]]]]:
    """Cards, and data tables by name; read as the solver does, word by word."""
    found, tables, open_ = [], {}, None
    for line in text.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] == "DATATABLE":
            assert words[2] == "LIST"
            open_ = tables.setdefault(words[1], [])
        elif words[0] == "ENDDATATABLE":
            open_ = None
        elif open_ is not None:
            open_.append([float(word) for word in words])
        else:
            found.append(words)
    return found, tables


def test_every_card_is_whole_and_refers_to_what_is_there(tmp_path: Path) -> None:
    path = tmp_path / "fork.in"
    write_svoned(path, FORK, OF_THE_FORK)
    found, tables = cards(path.read_text())
    for card in found:
        if card[0] in FIELDS:
            assert len(card) - 1 == FIELDS[card[0]], card
    by = {kind: [c[1:] for c in found if c[0] == kind] for kind in {c[0] for c in found}}
    at = {n[0]: 10.0 * np.array([float(x) for x in n[1:]]) for n in by["NODE"]}
    # The only joint has to be at the first node listed.
    assert by["JOINT"][0][1] == by["NODE"][0][0] == "0"
    np.testing.assert_allclose(at["0"], FORK.nodes[3])
    assert by["JOINTINLET"][0][1:] == ["1", "0"]
    assert by["JOINTOUTLET"][0][1:] == ["2", "1", "2"]
    materials = {m[0]: m for m in by["MATERIAL"]}
    for k, segment in enumerate(by["SEGMENT"]):
        first, last = FORK.vessel_nodes[k]
        np.testing.assert_allclose(at[segment[4]], FORK.nodes[first])
        np.testing.assert_allclose(at[segment[5]], FORK.nodes[last])
        assert float(segment[6]) == pytest.approx(np.pi * FORK.mean_radius()[k] ** 2 / 100.0)
        assert segment[14] == ("NOBOUND", "RCR", "RESISTANCE")[k]
        assert segment[15] == "NONE" or segment[15] in tables
        # dA/dp at rest, 2 A₀/(4/3 k₃), is the gel's 2 A₀ (1 + ν)/E; in dyn/cm².
        assert 4 / 3 * float(materials[segment[9]][8]) == pytest.approx(1e4 / 1.5 * 10.0)
    assert float(by["MATERIAL"][0][2]) == pytest.approx(1.06)
    assert float(by["MATERIAL"][0][3]) == pytest.approx(0.01)
    assert [row[1] for row in tables["END0"]] == pytest.approx([2e4, 1e-6, 8e4, 1e3])
    assert [row[1] for row in tables["END2"]] == pytest.approx([5e4, 0.0])
    time, flow = np.array(tables["INLET"]).T
    assert time[-1] == pytest.approx(0.8)
    assert flow[-1] == flow[0]
    assert flow.mean() == pytest.approx(4e-3, rel=0.01)


@pytest.mark.parametrize(
    ("change", "options", "words"),
    [
        ({"wall": RigidWall()}, {}, "rigid wall"),
        ({}, {"wall_viscosity_pa_s": 5.0}, "no viscous wall"),
        ({"inlets": (1, 0), "outlets": (2,)}, {}, "takes one"),
    ],
)
def test_what_it_cannot_say_is_refused(change, options, words) -> None:  # type: ignore[no-untyped-def]
    with pytest.raises(FlowError, match=words):
        svoned_input(FORK, replace(OF_THE_FORK, **change), OneDOptions(**options))
