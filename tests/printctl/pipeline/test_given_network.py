"""Recipe's network from a file of any format; overlapping vessels in it."""

from __future__ import annotations

import io
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from benchmarks.checkers import near_pairs, read_network
from design.errors import NetworkError
from design.hemodynamics import FlowConditions, solve_flow
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.tissue.shapes import annulus, block
from design.tissue.surface import tissue_from_surface
from printctl.errors import RecipeError
from printctl.pipeline.run import design_recipe, toolpath_recipe
from printctl.pipeline.stages.vasculature import outside_note
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe import Recipe, parse_recipe

# A straight vessel, and another that runs 0.3 mm above it: radii of 0.2 mm, 0.1 mm in each other.
OVER = VesselNetwork.from_segments(
    np.array([[1.0, 3, 2], [9, 3, 2], [5, 1, 2.3], [5, 5, 2.3]]),
    np.array([[0, 1], [2, 3]]),
    np.full(2, 0.2),
    np.zeros(2, dtype=np.int64),
    np.zeros(2, dtype=np.int64),
)


def _made(folder: Path, **vasculature: Any) -> dict[str, Any]:
    write_network_csv(folder / "over.csv", OVER)
    data = {
        "schema": 1,
        "name": "over",
        "tissue": {"shape": "block", "size_mm": [10, 6, 4]},
        "vasculature": {"network": "over.csv", "unit": "mm", **vasculature},
        "toolpath": {"method": "embedded", "needle": "30g", "allowed_crossings": 10},
        "printer": {"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
    }
    recipe = parse_recipe(data, "over.yaml")
    return toolpath_recipe(recipe, folder, folder / "run", Console(quiet=True))


def test_vessels_that_run_into_each_other_are_refused_or_told_of(tmp_path: Path) -> None:
    with pytest.raises(
        NetworkError, match=r"vessels 0 and 1 overlap by 0\.1 mm at \(5, 3, 2\.15\)"
    ):
        _made(tmp_path)
    parts, note = _made(tmp_path, overlaps="tell")["network"]["notes"]
    assert parts.startswith("The network has 2 parts that share no node")
    assert note.startswith("Places where vessels are nearer than 0 mm without meeting: 1 ")
    assert "vessels 0 and 1, -0.1 mm apart at (5, 3, 2.15) mm" in note
    kept = read_network_csv(tmp_path / "run" / "network.csv", unit="mm")
    assert kept.vessel_count == 2


def test_vessels_outside_the_tissue_are_told_and_none_within_is_refused() -> None:
    shape = block((10.0, 6.0, 4.0))
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    assert outside_note(tissue, OVER) == ()
    (note,) = outside_note(tissue, OVER.moved(np.array([6.0, 0, 0])))
    assert note.startswith("9 of 12 mm of vessels lie outside the tissue, up to ")
    reach = r"no vessel .* vessels reach from \(101, 1, 2\) to \(109, 5, 2.3\) mm.*unit"
    with pytest.raises(RecipeError, match=reach):
        outside_note(tissue, OVER.moved(np.array([100.0, 0, 0])))


@pytest.mark.parametrize("radius", [0.5, 1.0])
def test_a_tissue_with_the_vessels_cut_out_is_told_as_that(radius: float) -> None:
    """Channels of radius 0.5 mm, as wide as the vessels or half as wide."""
    hollow = annulus(6.0, 1.0, 10.0)
    tissue = tissue_from_surface(hollow.vertices, hollow.faces)
    upright = VesselNetwork.from_segments(
        np.array([[0.0, 0, -1], [0, 0, 11]]),
        np.array([[0, 1]]),
        np.full(1, radius),
        np.zeros(1, dtype=np.int64),
        np.zeros(1, dtype=np.int64),
    )
    with pytest.raises(RecipeError, match=r"hollow .* 10 of 12 mm .*solid outline"):
        outside_note(tissue, upright)
    # The channel of something else, or a network beside the tissue, isn't.
    with pytest.raises(RecipeError, match="see to the network's unit"):
        outside_note(tissue, upright.moved(np.array([3.4, 0.0, 0.0])))


def test_an_embedded_print_of_a_given_network_needs_no_tissue(tmp_path: Path) -> None:
    write_network_csv(tmp_path / "one.csv", OVER)
    data = {
        "schema": 1,
        "name": "one",
        "vasculature": {"network": "one.csv", "unit": "mm"},
        "toolpath": {"method": "embedded"},
    }
    tissue = make_tissue(parse_recipe(data, "one.yaml").tissue, tmp_path)
    # Vessels from (1, 1, 2) to (9, 5, 2.3) mm with radii of 0.2 mm, and 2 mm around.
    assert tissue.bounds == pytest.approx(np.array([[-1.2, -1.2, -0.2], [11.2, 7.2, 4.5]]))
    assert "2 mm (tissue.margin_mm)" in tissue.notes[0]
    with pytest.raises(RecipeError, match="tissue: is missing"):
        parse_recipe(data | {"toolpath": {"method": "fresh"}}, "one.yaml")


# --- forests from a recipe: mixing beside given vessels, notes on what isn't supplied
CHANNEL = (
    "vessel,node0,node1,x0,y0,z0,x1,y1,z1,radius0_mm,radius1_mm,kind,tree\n"
    "0,0,1,0,8,6,20,8,6,0.8,0.8,channel,0\n"
)


def designed(folder: Path, vessels: dict[str, Any]) -> dict[str, Any]:
    block = {"shape": "block", "size_mm": [20, 16, 12]}
    forest = {"grow": "forest", **vessels}
    data = {"schema": 1, "name": "forest", "tissue": block, "vasculature": forest}
    recipe = parse_recipe(data, "forest.yaml")
    console = Console(file=io.StringIO())
    design_recipe(recipe, folder, folder, console, until="vasculature")
    manifest = json.loads((folder / "manifest.json").read_text())
    summary: dict[str, Any] = manifest["stages"]["vasculature"]["summary"]
    return summary


def test_a_mixing_network_grows_round_given_vessels(tmp_path: Path) -> None:
    (tmp_path / "given.csv").write_text(CHANNEL)
    kinds = ("artery", "artery", "vein")
    mixed = {"trees": [{"kind": kind} for kind in kinds], "join": "mixing"}
    given = {"network": "given.csv", "unit": "mm"}
    found = designed(tmp_path, {"terminals": 6, "networks": [given, mixed]})
    assert found["networks"][0]["connections"] == 6
    net = read_network(tmp_path / "network.csv")
    assert len(near_pairs(net, clearance_ratio=0.1).colliding) == 0
    # Trees 0 to 2, the limbs of their nodes, what was there.
    np.testing.assert_array_equal(np.unique(net.tree), np.arange(5))


# --- trees with curves in the place of bends, judged by a checker of their files
TREE = {"grow": "tree", "terminals": 60, "curves": True}


def recipe(vessels: dict[str, Any]) -> Recipe:
    block = {"shape": "block", "size_mm": [12, 10, 8]}
    data = {"schema": 1, "name": "curved", "tissue": block, "vasculature": vessels}
    return parse_recipe(data, "curved.yaml")


def test_main_lines_are_curves_clear_of_each_other_with_flows_as_asked(tmp_path: Path) -> None:
    said = io.StringIO()
    design_recipe(recipe(TREE), tmp_path, tmp_path, Console(file=said), until="vasculature")
    assert "0 curved" in said.getvalue().replace("\n", " ")
    found = near_pairs(read_network(tmp_path / "network.csv"), 0.0, 0.1)
    assert len(found.colliding) == 0
    network = read_network_csv(tmp_path / "network.csv", "mm")
    assert network.vessel_count == 2 * 60 - 1
    assert len(network.points) > 3 * network.vessel_count
    flow = solve_flow(network, FlowConditions(4e-3, inlet_flow_ul_s=1.0)).flow
    ends = np.isin(network.vessel_nodes[:, 1], network.outlets())
    assert flow[ends] == pytest.approx(1.0 / 60, rel=1e-9)


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"printable": True}, "curves wouldn't keep to printable"),
        ({"turn_angle_degrees": [0, 90]}, "curves wouldn't keep to turn_angle_degrees"),
        ({"anatomy": {"template": "heart"}}, "curved as it is; leave curves out"),
    ],
)
def test_what_curves_would_break_is_refused(more: dict[str, Any], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        recipe(TREE | more)
