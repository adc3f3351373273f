"""Outputs of oxygen solutions: summary numbers, and the ParaView field."""

from __future__ import annotations

import base64
import struct
import zlib
from pathlib import Path

import numpy as np
import pytest
from lxml import etree

from design.hemodynamics import FlowConditions, solve_flow
from design.hemodynamics.oxygen import (
    OxygenConditions,
    OxygenSolution,
    grid_of_box,
    grid_of_tissue,
    oxygen_summary,
    oxygen_table,
    solve_refined,
    write_oxygen_vti,
)
from design.tissue import SizeLimits, block
from registration.report.oxygen_figures import oxygen_histogram, slice_figure
from tests.design.hemodynamics.networks import network_of
from tests.design.tissue.kept import kept_tissue

BOX = np.array([[0.0, 0, 0], [3.0, 2.0, 2.0]])
NETWORK = network_of([[0, 1, 1], [3, 1, 1], [3.5, 1, 1]], [(0, 1), (1, 2)], 0.15)
FLOW = solve_flow(NETWORK, FlowConditions(1e-3, inlet_flow_ul_s=0.05))


@pytest.fixture(scope="module")
def pair() -> tuple[OxygenSolution, OxygenSolution]:
    given = OxygenConditions(cells_per_ml=2e7)
    return solve_refined(NETWORK, FLOW, lambda h: grid_of_box(BOX, h), 0.1, given)


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
    surface = block((1.5, 1.0, 1.0))
    tissue = kept_tissue(surface, limits=SizeLimits(0.5, 100.0))
    grid = grid_of_tissue(tissue, 0.1, 2.0)
    whole = grid_of_box(BOX, 0.1)
    assert (grid.inside == whole.inside).all()
    np.testing.assert_allclose(grid.depth_mm[grid.inside], whole.depth_mm[grid.inside], atol=0.05)
