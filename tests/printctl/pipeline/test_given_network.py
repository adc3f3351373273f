"""Recipe's network from a file of any format; overlapping vessels in it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from design.errors import NetworkError
from design.network import VesselNetwork
from design.network_files.by_suffix import read_with_notes
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.network_files.json_format import write_network_json
from design.network_files.vtp import write_network_vtp
from design.tissue.shapes import annulus, block
from design.tissue.surface import tissue_from_surface
from printctl.errors import RecipeError
from printctl.pipeline.run import toolpath_recipe
from printctl.pipeline.stages.vasculature import outside_note, parts_note
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe import parse_recipe

# A straight vessel, and another that runs 0.3 mm above it: radii of 0.2 mm, 0.1 mm in each other.
OVER = VesselNetwork.from_segments(
    np.array([[1.0, 3, 2], [9, 3, 2], [5, 1, 2.3], [5, 5, 2.3]]),
    np.array([[0, 1], [2, 3]]),
    np.full(2, 0.2),
    np.zeros(2, dtype=np.int64),
    np.zeros(2, dtype=np.int64),
)


def test_every_format_gives_the_same_network(tmp_path: Path) -> None:
    write_network_json(tmp_path / "a.json", OVER)
    write_network_vtp(tmp_path / "a.vtp", OVER, {})
    write_network_csv(tmp_path / "a.csv", OVER)
    for name, unit in (("a.json", None), ("a.vtp", "mm"), ("a.csv", "mm")):
        network, notes = read_with_notes(tmp_path / name, unit)
        assert network.points == pytest.approx(OVER.points)
        assert notes == ()
    rows = ["Vessel: 0, Number of Points: 2", "0.1, 0.3, 0.2, 0.02", "0.9, 0.3, 0.2, 0.02"]
    (tmp_path / "a.txt").write_text("\n".join(rows))
    network, notes = read_with_notes(tmp_path / "a.txt", None)
    assert network.points == pytest.approx(OVER.points[:2])
    assert len(notes) == 1


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


@pytest.mark.parametrize(
    ("gap", "said"), [(0.005, "0.005 mm from it, at (5.005, 0, 0)"), (0.0, "")]
)
def test_parts_that_share_no_node_are_told_with_how_near_they_come(gap: float, said: str) -> None:
    nodes = np.array([[0.0, 0, 0], [5, 0, 0], [3, 2, 0], [5 + gap, 0, 0], [9, 0, 0]])
    vessels = np.array([[0, 1], [1, 2], [3 if gap else 1, 4]])
    radius, zeros = np.full(3, 0.2), np.zeros(3)
    network = VesselNetwork.from_segments(nodes, vessels, radius, zeros, zeros)
    told = parts_note(network)
    assert len(told) == bool(said)
    assert said in "".join(told)


def test_vessels_outside_the_tissue_are_told_and_none_within_is_refused() -> None:
    shape = block((10.0, 6.0, 4.0))
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    assert outside_note(tissue, OVER) == ()
    (note,) = outside_note(tissue, OVER.moved(np.array([6.0, 0, 0])))
    assert note.startswith("9 of 12 mm of vessels lie outside the tissue, up to ")
    reach = r"no vessel .* vessels reach from \(101, 1, 2\) to \(109, 5, 2.3\) mm.*unit"
    with pytest.raises(RecipeError, match=reach):
        outside_note(tissue, OVER.moved(np.array([100.0, 0, 0])))


def test_a_network_far_larger_than_its_tissue_is_refused() -> None:
    shape = block((10.0, 6.0, 4.0))
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    large = replace(OVER, nodes=10 * OVER.nodes, points=10 * OVER.points)
    with pytest.raises(RecipeError, match=r"beyond .* to \(81, 21, 4\) mm.*unit"):
        outside_note(tissue, large.moved(np.array([-9.0, -29.0, -19.0])))


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
