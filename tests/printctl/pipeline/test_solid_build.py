"""Recipe section on the solid: fittings, tubes, chambers, marks."""

from __future__ import annotations

import re
from functools import cache
from itertools import pairwise
from math import dist
from pathlib import Path
from typing import Any

import nibabel
import numpy as np
import pytest
import trimesh
from hypothesis import given
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from rich.console import Console

from design.errors import DesignError, GrowthError, SolidError, TissueError
from design.network import VesselNetwork
from design.network_files.csv_format import read_network_csv
from design.network_files.swc import write_network_swc
from design.solids import block_solid, find_crossings, surface_genus
from design.tissue import block, tissue_from_surface
from design.vasculature import DepthPenalty, GrowthOptions, grow_tree, tree_to_network
from firmware_profiles import Plate, Printer, load, shipped
from kernels.arrays import FloatArray
from printctl.errors import RecipeError
from printctl.pipeline.network_sources.options import growth_options, read_terminals, read_trunk
from printctl.pipeline.plate_plan import (
    assigned,
    expand,
    points,
    route,
    scanned_wells,
    standing_plate,
)
from printctl.pipeline.prepared.solid_build import RunSolids, build
from printctl.pipeline.run_options import RunOptions
from printctl.pipeline.running.run import design_recipe, run_recipe
from printctl.pipeline.stages.paths.toolpath import make_region
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe.load import parse_recipe
from printctl.recipe.sections.growth import GrownNetwork
from printctl.recipe.sections.plate import PlatePart
from printctl.recipe.sections.regions import RegionPart
from printctl.recipe.sections.solid import SolidPart
from printctl.recipe.sections.tissue import TissuePart
from tests.design.solids.networks import channels, ladder
from tests.printctl.networks import network_recipe, vessels

BARB = {"kind": "barb", "bore_mm": 0.8, "outer_mm": 2.0, "length_mm": 5}


@cache
def plain_block():
    return block_solid((16, 8, 3))


def make(network: VesselNetwork | None = None, **keys: Any) -> RunSolids:
    built = build(SolidPart(**keys), network or ladder(), plain_block(), 0)
    for solid in (built.construct, *([built.chamber] if built.chamber else [])):
        assert len(find_crossings(solid.vertices, solid.faces).pairs) == 0
    assert surface_genus(built.construct.faces) == (built.genus, 1)
    return built


def test_barbs_stand_on_inlet_and_outlet_and_keep_the_lumen_open() -> None:
    built = make(inlets=BARB, outlets=BARB | {"length_mm": 4})
    assert built.construct.bounds[:, 0] == pytest.approx([-5.0, 20.0], abs=1e-3)
    assert built.fittings == 2
    # The bore is 0.8 mm from the tip on: no ray along the axis meets a face.
    faces = built.construct.vertices[built.construct.faces]
    across = np.hypot(faces[..., 1] - 4.1, faces[..., 2] - 1.5)
    assert across[faces[..., 0] < 0].min() == pytest.approx(0.4, abs=2e-3)


def test_a_chamber_has_a_way_in_for_each_port_it_fits() -> None:
    chamber = {"headroom_mm": 3, "inlets": BARB, "outlets": BARB, "ledge_mm": 0.5}
    built = make(chamber=chamber)
    assert built.chamber is not None
    assert surface_genus(built.chamber.faces) == (2, 1)
    assert built.chamber.bounds[:, 0] == pytest.approx([-8.0, 24.0], abs=1e-3)
    bare = make(chamber={"shape": "cylinder"})
    assert bare.chamber is not None
    assert surface_genus(bare.chamber.faces) == (0, 1)


def test_text_and_fiducials_are_cut_into_the_face_they_stand_on() -> None:
    plain = make()
    text = {"text": "A7", "at_mm": (6, 5.5, 3), "height_mm": 1, "depth_mm": 0.2}
    dots = {"at_mm": (5, 0.5, 3), "size_mm": 2, "diameter_mm": 0.4}
    marked = make(texts=[text], fiducials=[dots])
    assert marked.construct.volume_mm3 < plain.construct.volume_mm3
    raised = make(texts=[text | {"engraved": False}])
    assert raised.construct.bounds[1, 2] == pytest.approx(3.19, abs=1e-3)


@pytest.mark.parametrize(
    ("keys", "message"),
    [
        ({"texts": [{"text": "A", "at_mm": (6, 5, 9)}]}, r"texts.0: 'A' isn't on the construct"),
        ({"fiducials": [{"at_mm": (5, 0.5, 9)}]}, "put at_mm on its face"),
        ({"inlets": BARB | {"bore_mm": 0.3, "outer_mm": 0.9}}, "isn't wider than the vessel"),
        ({"chamber": {"inlets": BARB | {"outer_mm": 7.0}}}, "over the chamber's rim"),
    ],
)
def test_what_doesnt_fit_is_refused_with_the_key(keys: dict[str, Any], message: str) -> None:
    with pytest.raises(SolidError, match=message):
        make(**keys)


def test_a_construct_that_a_lumen_cuts_in_two_is_refused_with_the_loose_part() -> None:
    across = channels([[8, 0, 1.5], [8, 8, 1.5]], [(0, 1)], 1.6)
    with pytest.raises(
        SolidError, match=r"falls into 2 parts.*of 160 mm³ around \(3\.722, 4, 1\.5"
    ):
        make(across)


@pytest.mark.parametrize(
    ("solid", "message"),
    [
        ({"inlets": BARB | {"bore_mm": 2.5}}, "solid.inlets: bore_mm 2.5 leaves no wall"),
        ({"inlets": {"kind": "luer_male", "bore_mm": 3.2}}, "over 2.9 or 10.5 mm"),
        ({"inlets": {"kind": "hose", "bore_mm": 1}}, "solid.inlets.kind"),
        ({"chamber": {"ledge_mm": 3}}, "ledge_mm 3 isn't below wall_mm 2"),
        ({"texts": [{"text": " ", "at_mm": [0, 0, 0]}]}, "solid.texts.0.text"),
        ({"fiducials": [{"at_mm": [0, 0, 0], "along": [0, 0, 2]}]}, "must be two directions"),
        ({"formats": ["stl", "stl"]}, "names one twice"),
        ({"formats": ["iges"]}, "solid.formats"),
        ({"walls": 1}, "solid.walls"),
    ],
)
def test_a_recipe_is_told_what_is_wrong_with_it(solid: dict[str, Any], message: str) -> None:
    recipe = {
        "schema": 1,
        "name": "x",
        "tissue": {"shape": "block", "size_mm": [16, 8, 3]},
        "vasculature": {"design": "planar_four_vessel"},
        "solid": solid,
    }
    with pytest.raises(RecipeError) as told:
        parse_recipe(recipe, "x.yaml")
    assert message in str(told.value)


# --- notes on constructs whose handles or open ends differ from the network's
def test_vessels_that_merge_are_told_by_number_and_place(tmp_path: Path) -> None:
    """Two channels side by side, whose lumens become one; a foreign network has 329 such places."""
    ends = np.array([(0.0, 3, 2), (10, 3, 2), (0, 3.6, 2), (10, 3.6, 2)])
    told = design_notes(tmp_path, ends, 0.4)
    assert "vessels merge that the network keeps apart: 0 and 1 by 0.2 mm at (" in told
    assert told.count("0 and 1 by") == 1
    assert "break through" not in told


@pytest.mark.parametrize(
    ("first", "last", "radius", "said"),
    [
        ((0.0, 3.0, 2.0), (10.0, 3.0, 2.0), 0.4, ""),
        ((0.0, 3.0, 0.2), (10.0, 3.0, 0.2), 0.4, "vessel 0 by 0.2 mm at ("),
        ((2.0, 3.0, 2.0), (8.0, 3.0, 2.0), 0.4, "vessel 0 at (2, 3, 2) mm, 2 mm below it"),
    ],
)
def test_broken_walls_and_closed_lumens_are_told(
    tmp_path: Path, first: tuple[float, ...], last: tuple[float, ...], radius: float, said: str
) -> None:
    told = design_notes(tmp_path, np.array([first, last]), radius)
    assert ("handles, the network" in told or "0 ports" in told) == bool(said)
    assert said in told


def design_notes(tmp_path: Path, ends: FloatArray, radius: float) -> str:
    """Design straight vessels between pairs of `ends` in a block; return the run's manifest."""
    data = network_recipe(
        tmp_path,
        vessels(*ends.reshape(-1, 2, 3), radius=radius),
        (10, 6, 4),
        vasculature={"overlaps": "tell"},
        toolpath={"method": "embedded"},
        printer={"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
    )
    recipe = parse_recipe(data, "n.yaml")
    design_recipe(recipe, tmp_path, tmp_path / "run", Console(quiet=True))
    return (tmp_path / "run" / "manifest.json").read_text()


# --- tissue built from a recipe's section, with files beside the recipe
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
TUBE = vessels([[0, 0, 0], [10, 0, 0]], radius=0.5)


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


def test_a_tree_without_room_names_what_was_grown_and_grows(tmp_path: Path) -> None:
    part = {"shape": "block", "size_mm": [8, 8, 4]}
    vessels = {"grow": "tree", "terminals": 24, "smallest_diameter_mm": 0.6, "clearance_mm": 0.4}
    data = {"schema": 1, "name": "crowded", "tissue": part, "vasculature": vessels}

    def made(terminals: int) -> dict[str, Any]:
        recipe = parse_recipe(
            data | {"vasculature": vessels | {"terminals": terminals}}, "crowded.yaml"
        )
        options = RunOptions(until="vasculature")
        return run_recipe(recipe, tmp_path, tmp_path / str(terminals), Console(quiet=True), options)

    with pytest.raises(GrowthError, match=r"only \d+ of 24 terminals .* it fits: ") as refused:
        made(24)
    fits = int(re.findall(r"vasculature\.terminals: (\d+)", str(refused.value))[0])
    assert made(fits)["network"]["terminals"] == fits


def test_with_an_inlet_each_both_are_supplied_and_the_manifest_says_by_how_much(
    tmp_path: Path,
) -> None:
    network = design(tmp_path, grow="tree", terminals=40, inlets="each_part")["network"]
    assert [part["terminals"] for part in network["supply"]] == [33, 7]
    assert [part["flow_share"] for part in network["supply"]] == pytest.approx(
        [1000 / 1216, 216 / 1216]
    )
    assert "2 separate parts, each with vessels" in network["notes"][-1]


def test_a_trunk_is_read_from_swc(tmp_path: Path) -> None:
    shape = block((12.0, 10.0, 8.0))
    tissue = tissue_from_surface(shape.vertices, shape.faces)
    first = tree_to_network(grow_tree(tissue, GrowthOptions(terminals=4)))
    write_network_swc(tmp_path / "artery.swc", first)
    part = GrownNetwork.model_validate({"grow": "tree", "terminals": 40, "trunk": "artery.swc"})
    trunk = read_trunk(part, tmp_path)
    assert trunk is not None
    tree = grow_tree(tissue, growth_options(part, 1, tmp_path), trunk=trunk)
    assert (tree.children[:, 0] < 0).sum() == 40
    assert tree.given.sum() >= 7


# --- well plates: positions, well names, travels, assignment
PLATE = load(Plate, "corning_24")
PRINTER = load(Printer, "generic_marlin")
STANDING = standing_plate(PLATE, PRINTER)


def names(*words: str) -> list[str]:
    return expand(words, PLATE, "plate.wells")


def part(**said: Any) -> PlatePart:
    return PlatePart(profile="corning_24", **said)


@pytest.mark.parametrize("count", [6, 12, 24, 48, 96])
def test_shipped_plates_have_their_wells_inside_the_standard_outside(count: int) -> None:
    plate = load(Plate, f"corning_{count}")
    assert len(plate.wells) == count
    assert (plate.length_mm, plate.width_mm) == pytest.approx((127.76, 85.48), abs=0.25)
    assert shipped(Plate).count(f"corning_{count}") == 1


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"well_x_mm": 20.0, "well_y_mm": 20.0}, "don't fit beside each other"),
        ({"a1_x_mm": 5.0}, "beyond the plate"),
        ({"columns": 7}, "beyond the plate"),
        ({"well_y_mm": 15.0}, "a round well"),
        ({"well_depth_mm": 30.0}, "is above height_mm"),
    ],
)
def test_a_plate_that_can_t_be_is_refused(changes: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        Plate.model_validate(PLATE.model_dump() | changes)


def test_a_plate_too_high_for_the_printer_is_refused() -> None:
    low = PRINTER.model_copy(
        update={"z_mm": PRINTER.z_mm.model_copy(update={"low": 0.0, "high": 21.0})}
    )
    with pytest.raises(RecipeError, match=r"above the 21 mm of .* take a lower plate"):
        standing_plate(PLATE, low)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["Z9"], "Z9 isn't on Corning Costar 24-well plate.* rows A to D and columns 1 to 6"),
        (["A7"], "A7 isn't on"),
        (["A1..D9"], "D9 isn't on"),
        (["one"], "'one' is no well"),
        (["A1", "A1..A3"], "names A1 twice"),
        (["B3..A1"], r"runs backwards; .* A1\.\.B3"),
    ],
)
def test_wells_that_aren_t_there_are_refused(words: list[str], message: str) -> None:
    with pytest.raises(RecipeError, match=message):
        names(*words)


def length(wells: list[str]) -> float:
    return sum(dist(STANDING.centre_mm(a), STANDING.centre_mm(b)) for a, b in pairwise(wells))


@given(st.sets(st.sampled_from(PLATE.wells), min_size=1))
def test_the_way_visits_each_well_once_and_isn_t_longer_than_row_by_row(wells: set[str]) -> None:
    found = route(sorted(wells), STANDING)
    assert sorted(found) == sorted(wells)
    assert length(found) <= length(sorted(wells)) + 1e-9


def test_a_grid_holds_every_pair_and_a_list_only_those_named() -> None:
    sweep = {"toolpath.write_speed_mm_s": (3, 5), "seed": (1, 2)}
    assert [tuple(point.values.values()) for point in points(sweep, "grid")] == [
        (3, 1), (3, 2), (5, 1), (5, 2),
    ]  # fmt: skip
    assert [point.label for point in points(sweep, "list")] == [
        "write speed 3 mm/s, seed 1",
        "write speed 5 mm/s, seed 2",
    ]
    assert [point.values for point in points({}, "grid")] == [{}]


@pytest.mark.parametrize(
    ("sweep", "words"),
    [
        ({"toolpath.needle": ("30g", "25g")}, "can't differ from well to well"),
        ({"toolpath.prime.line_mm": (5, 10)}, "can't differ from well to well"),
        ({"printer.bath": ("a", "b")}, "isn't among what can be varied"),
        ({"scan.seed": (1, 2)}, "isn't among what can be varied"),
        ({"ink.viscosity_pa_s": (1, 2)}, "isn't among what can be varied"),
        ({"toolpath": (1, 2)}, "isn't among what can be varied"),
        ({"seed": (1, 2, 1)}, "holds seed 1 more than once"),
    ],
)
def test_what_no_sweep_can_vary_is_refused(sweep: dict[str, Any], words: str) -> None:
    with pytest.raises(RecipeError, match=words):
        points(sweep, "grid")


@pytest.mark.parametrize(
    ("said", "words"),
    [
        ({"sweep": {"seed": [1, 2]}, "wells": ["A1..A3"]}, "names 3 wells, and 2 variants"),
        ({"copies": 3, "wells": ["A1..A2"]}, "names 2 wells, and 1 variants with 3 copies"),
        ({"copies": 25}, "make 25 parts, and .* has 24 wells"),
    ],
)
def test_wells_that_don_t_come_out_even_are_refused(said: dict[str, Any], words: str) -> None:
    with pytest.raises(RecipeError, match=words):
        assigned(part(**said), PLATE)


def test_an_empty_well_can_t_be_scanned() -> None:
    asked = part(wells=["B1..B3"], scanned=["B3", "B2"])
    assert scanned_wells(asked, PLATE, assigned(asked, PLATE)) == ["B2", "B3"]
    asked = part(wells=["B1..B3"], scanned=["A1"])
    with pytest.raises(RecipeError, match="A1, in which nothing is printed"):
        scanned_wells(asked, PLATE, assigned(asked, PLATE))


def test_a_turned_plate_has_a1_where_one_sees_it() -> None:
    """Behind on the left; a quarter against the clock in front on the left; and so on."""
    signs = [
        tuple(
            at > middle
            for at, middle in zip(
                standing_plate(PLATE, PRINTER, turned_deg=turn).centre_mm("A1"),
                (100, 100),
                strict=True,
            )
        )
        for turn in (0, 90, 180, 270)
    ]
    assert signs == [(False, True), (False, False), (True, False), (True, True)]
    box = load(Plate, "corning_6").model_copy(update={"shape": "box", "well_y_mm": 30.0})
    for turn, size_mm in ((0, (34.8, 30.0)), (90, (30.0, 34.8)), (270, (30.0, 34.8))):
        well = standing_plate(box, PRINTER, turned_deg=turn).dish
        assert (well.inner_x_mm, well.inner_y_mm) == size_mm


def test_a_closed_loops_artery_enters_where_a_tree_alone_would(tmp_path: Path) -> None:
    part = {"shape": "block", "size_mm": [16, 10, 8]}
    way = {"terminals": 6, "smallest_diameter_mm": 0.4, "root": "search", "root_candidates": 4}
    found = {}
    for grow in ("tree", "closed_loop"):
        data = {"schema": 1, "name": grow, "tissue": part, "vasculature": {"grow": grow, **way}}
        options = RunOptions(until="vasculature")
        recipe = parse_recipe(data, "loop.yaml")
        made = run_recipe(recipe, tmp_path, tmp_path / grow, Console(quiet=True), options)
        network = read_network_csv(tmp_path / grow / "network.csv", unit="mm")
        found[grow] = network.nodes[network.inlets()[0]]
        assert "root searched for: of 4 places tried" in " ".join(made["network"]["notes"])
    assert found["closed_loop"] == pytest.approx(found["tree"])
    with pytest.raises(RecipeError, match="root: search finds root and direction itself"):
        parse_recipe(data | {"vasculature": {**data["vasculature"], "root_mm": [8, 5, 8]}}, "a")
