"""Tissue built from a recipe's section, with files beside the recipe."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import trimesh
from pydantic import TypeAdapter
from rich.console import Console

from design.errors import DesignError, TissueError
from design.network import VesselNetwork
from design.vasculature import DepthPenalty
from printctl.errors import RecipeError
from printctl.pipeline.growth_source import growth_options, read_terminals
from printctl.pipeline.regions import make_region
from printctl.pipeline.run import run_recipe
from printctl.pipeline.run_options import RunOptions
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe import parse_recipe
from printctl.recipe.growth import GrownNetwork
from printctl.recipe.regions import RegionPart
from printctl.recipe.tissue import TissuePart

PART: TypeAdapter[Any] = TypeAdapter(TissuePart)


def made(folder: Path, **tissue: Any) -> Any:
    """The tissue of this section."""
    return make_tissue(PART.validate_python(tissue), folder)


def test_needle_and_port_are_cut_out_of_a_shape(tmp_path: Path) -> None:
    port = trimesh.creation.box(extents=(2, 2, 2))
    port.export(tmp_path / "port.stl")
    needle = {"shape": "cylinder", "from_mm": [5, 5, -1], "to_mm": [5, 5, 11], "radius_mm": 0.5}
    tissue = made(
        tmp_path,
        shape="block",
        size_mm=[10, 10, 10],
        keep_out=[
            needle,
            {"mesh": "port.stl", "unit": "mm"},
            {**needle, "from_mm": [5, 5, 50], "to_mm": [5, 5, 60]},
        ],
    )
    assert tissue.volume_mm3 == pytest.approx(1000 - 1 - np.pi * 2.5, rel=1e-3)
    assert len(tissue.notes) == 1
    assert "keep_out 3 (cylinder) doesn't meet the tissue" in tissue.notes[0]


def test_label_image_with_demand_from_another_image(tmp_path: Path) -> None:
    voxels = np.zeros((20, 20, 20), np.uint8)
    voxels[4:16, 4:16, 4:16] = 2
    affine = np.diag([0.5, 0.5, 0.5, 1.0])
    image = nibabel.Nifti1Image(voxels, affine)
    image.header.set_xyzt_units("mm")
    nibabel.save(image, tmp_path / "seg.nii.gz")
    cells = np.broadcast_to(np.arange(20.0)[:, None, None], (20, 20, 20)).astype(np.float32)
    nibabel.save(nibabel.Nifti1Image(cells, affine), tmp_path / "cells.nii")
    tissue = made(
        tmp_path, labels="seg.nii.gz", value=2, demand={"image": "cells.nii", "unit": "mm"}
    )
    assert tissue.volume_mm3 == pytest.approx(216.0, rel=0.01)
    assert tissue.demand.mean_weight == pytest.approx(0.5, rel=0.01)
    low, high = tissue.demand.weight(np.array([[2.5, 4.75, 4.75], [7.0, 4.75, 4.75]]))
    assert (low, high) == (pytest.approx(5 / 19), pytest.approx(14 / 19))


# --- regions with their own infill or head, from a recipe
NONE = np.zeros(1, dtype=np.int64)
TUBE = VesselNetwork.from_segments(
    np.array([[0.0, 0, 0], [10, 0, 0]]), np.array([[0, 1]]), np.array([0.5]), NONE, NONE
)


def made_regions(words: dict[str, object], folder: Path = Path()) -> float:
    part = TypeAdapter(RegionPart).validate_python(words)
    return make_region(part, 2, folder, TUBE).solid.volume_mm3


def test_a_flat_region_is_refused_by_name() -> None:
    flat = {"shape": "block", "from_mm": [0, 0, 0], "to_mm": [1, 2, 0]}
    with pytest.raises(DesignError, match=r"toolpath\.regions\.2"):
        made_regions({"where": flat})


# --- recipe's growth section: conversion to growth options, files read
def test_every_word_arrives_in_the_design_s_units(tmp_path: Path) -> None:
    part = GrownNetwork.model_validate(
        {
            "grow": "tree",
            "terminal_flow": "demand",
            "viscosity_law": "pries_1994",
            "haematocrit": 0.4,
            "smallest_diameter_mm": 0.2,
            "branch_angle_degrees": [30, 140],
            "turn_angle_degrees": [0, 80],
            "flow_ratio": 0.05,
            "length_to_radius": 2,
            "follow_demand": False,
            "penalty": {"depth_mm": [0, 1], "factor": [3, 1]},
            "root": "search",
            "root_candidates": 8,
            "stages": [
                {"terminals": 50, "clearance_mm": 0.3, "penalty": {"depth_mm": [0], "factor": [2]}},
                {"terminals": 800},
            ],
        }
    )
    options = growth_options(part, 7, tmp_path)
    assert (options.terminals, options.seed, options.terminal_flow) == (800, 7, "demand")
    assert (options.viscosity_law, options.haematocrit) == ("pries_1994", 0.4)
    assert options.smallest_radius_mm == 0.1
    assert (options.branch_angle_degrees, options.turn_angle_degrees) == ((30, 140), (0, 80))
    assert (options.flow_ratio, options.length_to_radius) == (0.05, 2.0)
    assert not options.follow_demand
    assert options.penalty == DepthPenalty((0.0, 1.0), (3.0, 1.0))
    assert options.root_candidates == 8
    assert options.stages[0].clearance_mm == 0.3
    assert options.stages[0].penalty == DepthPenalty((0.0,), (2.0,))
    assert options.stages[1].clearance_mm is None


def test_terminals_come_from_a_table_with_or_without_flows(tmp_path: Path) -> None:
    path = tmp_path / "wells.csv"
    path.write_text("name, x_mm, y_mm, z_mm\nA1, 1, 2, 3\nA2, 4, 5, 6\n")
    points, flows = read_terminals(path)
    np.testing.assert_array_equal(points, [[1, 2, 3], [4, 5, 6]])
    assert flows is None
    path.write_text("flow,z_mm,y_mm,x_mm\n0.5,3,2,1\n2,6,5,4\n")
    part = GrownNetwork.model_validate({"grow": "tree", "terminal_points": "wells.csv"})
    options = growth_options(part, 1, tmp_path)
    assert options.terminals == 2
    assert options.terminal_points_mm == ((1, 2, 3), (4, 5, 6))
    assert options.terminal_flows == (0.5, 2.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("x,y,z\n1,2,3\n", r"columns are x, y, z; give x_mm"),
        ("", r"columns are missing"),
        ("x_mm,y_mm,z_mm\n1,2,3\n1,b,3\n", r"line 3: \['1', 'b', '3'\] aren't numbers"),
        ("x_mm,y_mm,z_mm\n1,2\n", r"line 2: .*None.* aren't numbers"),
        ("x_mm,y_mm,z_mm\n1,2,nan\n", r"line 2: \['1', '2', 'nan'\] aren't all finite"),
        ("x_mm,y_mm,z_mm,flow\n1,2,3,-1\n", r"line 2: flow is -1; give one above 0"),
        ("x_mm,y_mm,z_mm\n1,2,3\n4,5,6\n1,2,3\n", r"\(1, 2, 3\) mm stands in line 2 and in line 4"),
    ],
)
def test_a_table_of_another_kind_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "wells.csv"
    path.write_text(text)
    with pytest.raises(RecipeError, match=message):
        read_terminals(path)
    with pytest.raises(RecipeError, match="can't be read"):
        read_terminals(tmp_path / "none.csv")


# --- a recipe whose tissue has two parts
def design(folder: Path, **vasculature: Any) -> dict[str, Any]:
    one, two = trimesh.creation.box((10, 10, 10)), trimesh.creation.box((6, 6, 6))
    two.apply_translation((20, 0, 0))
    trimesh.util.concatenate([one, two]).export(folder / "two.stl")
    recipe = {
        "schema": 1,
        "name": "two",
        "tissue": {"mesh": "two.stl", "unit": "mm"},
        "vasculature": vasculature,
    }
    made = parse_recipe(recipe, "two.yaml")
    return run_recipe(made, folder, folder / "out", Console(quiet=True), RunOptions(until="flow"))


@pytest.mark.parametrize("grow", ["tree", "closed_loop"])
def test_a_part_without_vessels_is_refused_by_size_and_place(tmp_path: Path, grow: str) -> None:
    with pytest.raises(TissueError, match=r"part of 216 mm³ around \(20, 0, 0\)"):
        design(tmp_path, grow=grow, terminals=4)


def test_with_an_inlet_each_both_are_supplied_and_the_manifest_says_by_how_much(
    tmp_path: Path,
) -> None:
    network = design(tmp_path, grow="tree", terminals=40, inlets="each_part")["network"]
    assert [part["terminals"] for part in network["supply"]] == [33, 7]
    assert [part["flow_share"] for part in network["supply"]] == pytest.approx(
        [1000 / 1216, 216 / 1216]
    )
    assert "2 separate parts, each with vessels" in network["notes"][-1]
