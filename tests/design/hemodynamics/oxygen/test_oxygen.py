"""Oxygen: Krogh's cylinder, slabs, wells; exchange with a grid; summaries and files."""

import base64
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from design.errors import FlowError
from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.oxygen import (
    OxygenConditions,
    OxygenSolution,
    grid_of_box,
    grid_of_tissue,
    oxygen_summary,
    oxygen_table,
    solve_oxygen,
    solve_refined,
    write_oxygen_vti,
)
from design.hemodynamics.oxygen.solve import OxygenProblem
from design.hemodynamics.oxygen.transport import (
    COUPLING,
    cut_vessels,
    subgrid,
    sweep,
    transport_of,
)
from design.network import VesselNetwork
from design.tissue import SizeLimits, block
from kernels.arrays import FloatArray
from report.figures.oxygen_figures import oxygen_histogram, slice_figure
from tests.design.hemodynamics.networks import network_of
from tests.design.hemodynamics.oxygen.krogh import FLOW, compare, tissue_cylinder, vessel
from tests.design.tissue.kept import kept_tissue


@pytest.mark.parametrize(
    ("radius", "cells", "limit"),
    [(0.01, 12, 0.012), (0.03, 12, 0.012), (0.05, 12, 0.01), (0.1, 12, 0.015), (0.05, 4, 0.03)],
)
def test_krogh_s_cylinder_with_its_decline_along_the_vessel(radius, cells, limit):
    """From a lumen of 0.4 cells in radius to one of 4."""
    found = compare(radius, cells)
    assert found.worst < limit
    assert found.solution.exit[0] == pytest.approx(found.leaves, rel=1e-6)
    assert found.solution.imbalance < 1e-6


def test_a_finer_grid_is_nearer_to_krogh() -> None:
    assert compare(0.05, 16).rms < compare(0.05, 4).rms / 4.0


def test_a_turned_vessel_is_the_same() -> None:
    grid = tissue_cylinder(5)
    driven = FlowConditions(1e-3, inlet_flow_ul_s=FLOW, inlets=(0,), outlets=(1,))
    one, other = (
        solve_oxygen(network, solve_flow(network, driven), grid, OxygenConditions())
        for network in (vessel(0.05), vessel(0.05, turned=True))
    )
    np.testing.assert_allclose(one.concentration, other.concentration, atol=2e-5)
    assert one.exit == pytest.approx(other.exit, rel=1e-5)


def test_a_slab_between_baths_converges_with_the_square_of_the_spacing() -> None:
    """C = c_bath - M/(2D) x (L - x), far from a vessel that brings next to nothing."""
    given = OxygenConditions(cells_per_ml=2e6, half_millimolar=1e-9, bath_millimolar=0.2)
    off = []
    for cells in (8, 16):
        h = 1.0 / cells
        grid = grid_of_box(np.array([[0.0, 0, 0], [1.0, 8.0, 8.0]]), h)
        middle = grid.inside.shape[1] // 2
        network = network_of([[0.5, 0, 0.5], [0.5, 0.5, 0.5]], [(0, 1)], 1e-3)
        flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=1e-9))
        found = solve_oxygen(network, flow, grid, given)
        x = (np.arange(cells) + 0.5) * h
        exact = 0.2 - given.uptake_millimolar_s / (2 * 2e-3) * x * (1 - x)
        off.append(np.abs(found.concentration[1:-1, middle, middle] - exact).max())
    assert off[1] < off[0] / 3.5


def test_well_stirred_tissue_is_michaelis_and_menten_s_balance() -> None:
    """Q (c_in - c) = V M c/(K + c), when all that diffuses does so at once."""
    given = OxygenConditions(
        cells_per_ml=1e7, half_millimolar=0.05, tissue_diffusivity_mm2_s=1e4,
        medium_diffusivity_mm2_s=1e4,
    )  # fmt: skip
    grid = grid_of_box(np.array([[0.0, 0, 0], [1.0, 1.0, 1.0]]), 0.1)
    network = network_of([[0, 0.5, 0.5], [1, 0.5, 0.5]], [(0, 1)], 0.02)
    flow = 2e-3
    solved = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=flow))
    found = solve_oxygen(network, solved, grid, given)
    volume = found.tissue_share.sum() * grid.cell_ul
    most = volume * given.uptake_millimolar_s / flow
    b = 0.05 + most - 0.2
    expected = (-b + np.sqrt(b * b + 4 * 0.2 * 0.05)) / 2
    assert found.concentration[5, 5, 5] == pytest.approx(expected, rel=1e-4)
    assert found.exit[0] == pytest.approx(expected, rel=1e-4)


def test_medium_at_a_quarter_millilitre_a_minute_feeds_seventeen_million_cells() -> None:
    """0.25 mL/min at 0.2 mM over 5e-17 mol/s a cell (physics.md)."""
    grid = grid_of_box(np.array([[0.0, 0, 0], [2.0, 2.0, 2.0]]), 0.25)
    network = network_of([[0, 1, 1], [2, 1, 1]], [(0, 1)], 0.2)
    solved = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.25 / 0.06))
    found = oxygen_summary(solve_oxygen(network, solved, grid, OxygenConditions()))
    assert found["cells_fed_at_most"] == pytest.approx(1.7e7, rel=0.03)


# Exchange of vessels with cells: any size, position and direction.


BOX = np.array([[0.0, 0.0, 0.0], [2.0, 2.0, 2.0]])
BRIDGE = [(0, 1), (1, 2), (1, 3), (2, 3), (2, 4), (3, 4), (4, 5)]
NODES = [[0.1, 1, 1], [0.5, 1, 1], [1, 1.5, 1], [1, 0.5, 1.2], [1.5, 1, 1], [1.9, 1, 1]]


def solved_problem(network: VesselNetwork, cells_per_ml: float = 1e7) -> OxygenProblem:
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.02))
    grid = grid_of_box(BOX, 0.2)
    return OxygenProblem(network, flow, grid, OxygenConditions(cells_per_ml=cells_per_ml))


def test_the_subgrid_correction_is_the_mean_over_a_blurred_ring() -> None:
    """Against samples of ln max(1, |1 + noise|), and the limit of a line."""
    rng = np.random.default_rng(0)
    noise = rng.normal(size=(2, 400_000))
    for ratio in (0.3, 1.0, 3.0):
        blur = COUPLING.smoothing / ratio
        away = np.hypot(1.0 + blur * noise[0], blur * noise[1])
        expected = np.log(np.maximum(1.0, away)).mean()
        assert subgrid(np.array([ratio]), 1.0)[0] == pytest.approx(expected, abs=0.003)
    assert subgrid(np.array([1e-4]), 1.0)[0] == pytest.approx(np.log(0.6606 / 1e-4), abs=1e-3)


@pytest.mark.parametrize("radius", [0.02, 0.1, 0.3])
@pytest.mark.slow
def test_what_a_vessel_gives_depends_neither_on_its_place_in_a_cell_nor_on_the_grid(radius):
    """An oblique vessel in a box whose surface is a bath without oxygen."""
    given = OxygenConditions(cells_per_ml=1.0, bath_millimolar=0.0)

    def flux(spacing: float, shift: float) -> float:
        grid = grid_of_box(BOX, spacing)
        nodes = np.array([[0.4, 0.5, 0.6], [1.6, 1.4, 1.5]]) + [shift, 0.7 * shift, -shift]
        network = network_of(nodes, [(0, 1)], radius)
        flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=1.0))
        return float(solve_oxygen(network, flow, grid, given).wall_flux[0])

    fine = flux(0.0625, 0.0)
    for shift in (0.0, 0.03, 0.07):
        assert flux(0.2, shift) == pytest.approx(fine, rel=0.04)


def test_a_network_with_loops_mixes_by_flow_and_keeps_what_it_is_given() -> None:
    network = network_of(NODES, BRIDGE, [0.1, 0.08, 0.05, 0.04, 0.06, 0.08, 0.1])
    problem = solved_problem(network)
    around = np.random.default_rng(2).random(len(problem.conductance)) * 0.1
    flux, entry, leaves = sweep(problem.transport, problem.conductance, around, 0.2)
    assert flux.sum() == pytest.approx(0.02 * (0.2 - leaves[6]), rel=1e-12)
    size = problem.transport.flow
    into = [(vessel, leaves[vessel]) for vessel in (4, 5)]
    mixed = sum(size[v] * c for v, c in into) / sum(size[v] for v, _ in into)
    assert entry[6] == pytest.approx(mixed, rel=1e-12)


@pytest.mark.parametrize("cells_per_ml", [1e7, 3e8])
def test_starved_tissue_stays_above_nothing_and_in_balance(cells_per_ml: float) -> None:
    network = network_of(NODES, BRIDGE, 0.08)
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.02))
    given = OxygenConditions(cells_per_ml=cells_per_ml)
    found = solve_oxygen(network, flow, grid_of_box(BOX, 0.1), given)
    assert found.concentration.min() > -1e-9
    assert np.nanmax(found.exit) <= 0.2
    assert found.imbalance < 1e-6
    assert found.drained == pytest.approx(0.02 * found.exit[6], rel=1e-9)
    more = solve_oxygen(network, flow, grid_of_box(BOX, 0.1), replace(given, inlet_millimolar=0.4))
    assert more.share_below(0.01) < found.share_below(0.01)


def test_what_cannot_be_solved_is_said() -> None:
    network = network_of(NODES, BRIDGE, 0.08)
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.02))
    still = replace(flow, flow=np.zeros(7))
    with pytest.raises(FlowError, match="no vessel carries any flow"):
        solve_oxygen(network, still, grid_of_box(BOX, 0.2), OxygenConditions())
    for given, moved, words in (
        (0.2, [9.0, 0.0, 0.0], "check that network and tissue"),
        (2.0, [0.0, 0.0, 0.0], "lumens fill it"),
    ):
        wide = network_of(NODES, BRIDGE, 0.9 if given == 2.0 else 0.08).moved(np.array(moved))
        with pytest.raises(FlowError, match=words):
            solve_oxygen(wide, flow, grid_of_box(BOX, given), OxygenConditions())
    with pytest.raises(FlowError, match="raise the spacing"):
        grid_of_box(BOX, 0.002)
    with pytest.raises(FlowError, match="cells_per_ml is -1"):
        OxygenConditions(cells_per_ml=-1.0)


def _laid(size: int, x: float, y: float) -> FloatArray:
    out = np.zeros((size, size))
    spline = []
    for at in (x, y):
        away = np.abs(np.arange(size) - at)
        away = np.minimum(away, size - away)
        near, next_ = 0.75 - away**2, 0.5 * (1.5 - away) ** 2
        spline.append(np.where(away <= 0.5, near, np.where(away <= 1.5, next_, 0.0)))
    out += spline[0][:, None] * spline[1]
    return out


def test_the_lattice_answers_as_the_smoothing_says() -> None:
    """A line laid on a periodic lattice by B-splines, read where it is and far away."""
    size, far = 64, 10.0
    k = 2.0 - 2.0 * np.cos(2.0 * np.pi * np.fft.fftfreq(size))
    star = k[:, None] + k
    star[0, 0] = np.inf
    rng = np.random.default_rng(1)
    radii = []
    for x, y in size / 2 + rng.random((12, 2)):
        source = _laid(size, x, y)
        field = np.fft.ifft2(np.fft.fft2(source) / star).real
        ring = [
            (field * _laid(size, x + far * np.cos(t), y + far * np.sin(t))).sum()
            for t in np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
        ]
        # The even sink that a periodic lattice needs adds r²/(4 area).
        rise = (field * source).sum() - np.mean(ring) + far**2 / (4.0 * size**2)
        radii.append(far * np.exp(-2.0 * np.pi * rise))
    expected = np.sqrt(2) * COUPLING.smoothing * np.exp(-np.euler_gamma / 2)
    assert np.mean(radii) == pytest.approx(expected, rel=0.02)
    assert np.std(radii) / np.mean(radii) < 0.06


def test_the_change_that_newton_uses_is_that_of_the_loss() -> None:
    """Downstream action through the stream included."""
    problem = solved_problem(network_of(NODES, BRIDGE, 0.08))
    rng = np.random.default_rng(3)
    inside = problem.grid.inside.ravel()
    c, step = (np.where(inside, rng.random(inside.size), 0.0) for _ in range(2))
    eps = 1e-6
    expected = (problem.loss(c + eps * step) - problem.loss(c - eps * step)) / (2 * eps)
    found = problem.change(step, problem.slope(c))
    np.testing.assert_allclose(found, expected, atol=1e-7 * np.abs(expected).max())


def test_a_stream_relaxes_exponentially_to_what_is_around_it() -> None:
    network = network_of([[0.5, 1, 1], [1.5, 1, 1]], [(0, 1)], 0.05)
    flow = solve_flow(network, FlowConditions(1e-3, inlet_flow_ul_s=0.02))
    elements = cut_vessels(network, grid_of_box(BOX, 0.1))
    count = len(elements.length)
    transport, around = transport_of(network, flow, elements), np.full(count, 0.1)
    flux, _, leaves = sweep(transport, np.full(count, 0.03 / count), around, 0.2)
    assert leaves[0] == pytest.approx(0.1 + 0.1 * np.exp(-1.5), rel=1e-12)
    assert flux.sum() == pytest.approx(0.02 * (0.2 - leaves[0]), rel=1e-12)


# Summaries, and the field for ParaView.


LONG_BOX = np.array([[0.0, 0, 0], [3.0, 2.0, 2.0]])
NETWORK = network_of([[0, 1, 1], [3, 1, 1], [3.5, 1, 1]], [(0, 1), (1, 2)], 0.15)
SOLVED = solve_flow(NETWORK, FlowConditions(1e-3, inlet_flow_ul_s=0.05))


@pytest.fixture(scope="module")
def pair() -> tuple[OxygenSolution, OxygenSolution]:
    given = OxygenConditions(cells_per_ml=2e7)
    return solve_refined(NETWORK, SOLVED, lambda h: grid_of_box(LONG_BOX, h), 0.1, given)


def test_the_summary_holds_together(pair: tuple[OxygenSolution, OxygenSolution]) -> None:
    found = oxygen_summary(*pair)
    assert found["supplied_nmol_s"] == pytest.approx(0.05 * 0.2)
    assert found["outlet_millimolar"] == pytest.approx(pair[0].exit[1], rel=1e-6)
    used = found["supplied_nmol_s"] - found["drained_nmol_s"]
    assert used == pytest.approx(found["consumed_nmol_s"], rel=1e-5)
    assert found["tissue_mm3"] == pytest.approx(12.0 - 3.0 * np.pi * 0.15**2, rel=0.01)
    assert sum(found["histogram"]["share"]) == pytest.approx(1.0)
    low = sum(found["histogram"]["share"][:2])
    assert found["hypoxic_percent"] == pytest.approx(100 * low, abs=0.5)
    assert found["hypoxic_coarser_percent"] == pytest.approx(found["hypoxic_percent"], abs=3.0)
    assert {row["measured"] for row in found["assumptions"]} == {False}
    given = {row["name"] for row in found["assumptions"] if row["source"] == "given by the user"}
    assert given == {"cells_per_ml"}


def test_vessels_outside_the_tissue_give_it_nothing(pair):
    table = oxygen_table(NETWORK, pair[0])
    assert table["wall_flux_nmol_s"][1] == 0.0
    assert table["oxygen_out_millimolar"][1] == table["oxygen_in_millimolar"][1]
    assert table["wall_flux_nmol_s"][0] == pytest.approx(pair[0].consumed, rel=1e-5)


def test_the_image_reads_back(pair: tuple[OxygenSolution, OxygenSolution], tmp_path: Path) -> None:
    write_oxygen_vti(tmp_path / "o.vti", pair[0])
    image = etree.parse(tmp_path / "o.vti").find("ImageData")
    assert image is not None
    assert [float(x) for x in image.get("Origin", "").split()] == pytest.approx([0.05] * 3)
    assert image.get("WholeExtent") == "0 29 0 19 0 19"
    text = image.find(".//DataArray[@Name='oxygen_millimolar']").text
    blocks = struct.unpack("<I", base64.b64decode(text[:8])[:4])[0]
    head = 4 * ((4 * (3 + blocks) + 2) // 3)
    sizes = struct.unpack(f"<{blocks}I", base64.b64decode(text[:head])[12 : 12 + 4 * blocks])
    body = base64.b64decode(text[head:])
    at = np.cumsum([0, *sizes])
    data = b"".join(zlib.decompress(body[at[k] : at[k + 1]]) for k in range(blocks))
    field = np.frombuffer(data, "<f4").reshape(20, 20, 30).transpose(2, 1, 0)
    inner = pair[0].concentration[1:-1, 1:-1, 1:-1]
    np.testing.assert_allclose(field, inner, rtol=1e-6)


def test_a_picture_of_the_worst_place_is_drawn(pair):
    assert slice_figure(pair[0], NETWORK) == slice_figure(pair[0], NETWORK)
    found = oxygen_summary(*pair)
    assert b"<svg" in oxygen_histogram(found["histogram"], 0.01)
    i, j, k = pair[0].worst
    assert pair[0].concentration[i, j, k] < 0.01
    # As far from the vessel as from the surface, or farther.
    assert np.hypot(j - 10.5, k - 10.5) > 3.0


def test_a_tissue_is_cut_in_the_print_s_size() -> None:
    tissue = kept_tissue(block((1.5, 1.0, 1.0)), limits=SizeLimits(0.5, 100.0))
    grid = grid_of_tissue(tissue, 0.1, 2.0)
    whole = grid_of_box(LONG_BOX, 0.1)
    assert (grid.inside == whole.inside).all()
    np.testing.assert_allclose(grid.depth_mm[grid.inside], whole.depth_mm[grid.inside], atol=0.05)
