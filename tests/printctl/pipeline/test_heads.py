"""Several heads in a recipe: their contents, and the vessels they write."""

from __future__ import annotations

import io
import json
from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from benchmarks.checkers import near_pairs, read_network
from design.errors import NetworkError
from design.hemodynamics import FlowConditions, solve_flow
from design.network import VesselKind, VesselNetwork
from design.network_files.csv_format import read_network_csv, write_network_csv
from design.tissue.shapes import annulus, block
from design.tissue.surface import tissue_from_surface
from firmware_profiles import Printer, load
from printctl.errors import RecipeError, SafetyError, UsageError
from printctl.machine.job.marks import MarkKind
from printctl.observe.records import ORDER_FILE
from printctl.pipeline import observing
from printctl.pipeline.job.heads import layer_lines_um, vessel_heads
from printctl.pipeline.network_sources.given import outside_note
from printctl.pipeline.observing import look_care, unlooked_words
from printctl.pipeline.refusals import refuse_unobservable
from printctl.pipeline.running.run import design_recipe, toolpath_recipe
from printctl.pipeline.tissue_source import make_tissue
from printctl.recipe import Recipe, parse_recipe
from printctl.recipe.sections.making import HeadPart
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.artefacts import GCODE
from tests.printctl.networks import network_recipe, vessels

ROOT = Path(__file__).parents[3]
GOOD = yaml.safe_load((ROOT / "examples" / "ring_two_inks.yaml").read_text())
KIND = np.array([VesselKind.ARTERY, VesselKind.VEIN, VesselKind.CONNECTION], dtype=np.int64)
NETWORK = VesselNetwork.from_segments(
    np.array([[0.0, 0, 0], [1, 0, 0], [2, 0, 0], [3, 0, 0]]),
    np.array([[0, 1], [1, 2], [2, 3]]),
    np.full(3, 0.2),
    KIND,
    np.array([0, 1, 2]),
)


def heads(*said: dict[str, Any]) -> list[int]:
    found = vessel_heads(NETWORK, [HeadPart(**one) for one in said])
    return [int(head) for head in found]


def test_vessels_go_to_heads_by_kind_by_tree_and_by_what_is_left() -> None:
    assert heads({"kinds": ["artery", "connection"]}, {"kinds": ["vein"]}) == [0, 1, 0]
    assert heads({}, {"kinds": ["vein"]}) == [0, 1, 0]
    assert heads({"trees": [2]}, {}) == [1, 1, 0]
    assert heads({"kinds": ["artery"]}, {"trees": [0], "kinds": ["vein", "connection"]}) == [
        1,
        1,
        1,
    ]
    assert heads() == [0, 0, 0]
    assert heads({}, {}) == [0, 0, 0]


def with_heads(*said: dict[str, Any], **printer: Any) -> dict[str, Any]:
    data = deepcopy(GOOD)
    data["printer"] |= {"heads": list(said), **printer}
    return data


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (with_heads({"kinds": ["vein"]}, {"kinds": ["vein"]}), "kinds vein is given to two"),
        (with_heads({"trees": [1]}, {"trees": [1]}), "trees 1 is given to two"),
        (with_heads({"kinds": ["vein"]}, {}, {}), "only one can write the rest"),
        (with_heads({}, {}, ink="collagen_fresh"), "say it in heads alone"),
        (with_heads({"kinds": ["hose"]}, {}), "kinds"),
    ],
)
def test_heads_that_contradict_each_other_are_refused(data: dict[str, Any], words: str) -> None:
    with pytest.raises(RecipeError, match=words):
        parse_recipe(data, "test.yaml")


def whole(folder: Path, **printer: Any) -> dict[str, Any]:
    """An artery and a vein side by side, as far as the dry run."""
    heads = [
        {"ink": "gelatin_sacrificial", "kinds": ["artery"]},
        {"syringe": "hamilton_2_5ml", "ink": "gelatin_sacrificial", "kinds": ["vein"]},
    ]
    two = {"profile": "two_syringe_marlin", "bath": "cell_matrix", "dish": "petri_60mm"}
    data = network_recipe(
        folder,
        BESIDE,
        (10, 6, 4),
        toolpath={"method": "embedded", "needle": "30g"},
        printer={**two, "heads": heads, **printer},
    )
    recipe = parse_recipe(data, "two.yaml")
    return toolpath_recipe(recipe, folder, folder / "run", Console(quiet=True))


BESIDE = vessels([[1, 2, 2], [9, 2, 2]], [[1, 4, 2], [9, 4, 2]], kind=KIND[:2], tree=[0, 1])


def test_two_inks_are_planned_written_and_checked(tmp_path: Path) -> None:
    found = whole(tmp_path, bath_depth_mm=6.0)
    text = (tmp_path / "run" / "part.gcode").read_text()
    assert text.count("\nT1 S1\n") == 1
    names = [check["check"] for check in found["dry_run"]["checks"]]
    assert "head 1 (right): needle to dish wall" in names
    assert "lowest idle tip vs. the bath surface" in names
    pushed = [one["ink_pushed_ul"] for one in found["dry_run"]["ink_of_heads"]]
    assert pushed == pytest.approx([np.pi * 0.04 * 8] * 2, rel=0.05)
    assert found["lumens"]["passed"]


def test_heads_that_stay_in_the_bath_are_refused(tmp_path: Path) -> None:
    data = load(Printer, "two_syringe_marlin").model_dump(mode="json", exclude_unset=True)
    for head in data["heads"]:
        for key in ("raised_mm", "raises", "lowers", "moving_s"):
            head.pop(key)
    (tmp_path / "fixed.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(SafetyError, match="drag through the gel"):
        whole(tmp_path, profile=str(tmp_path / "fixed.yaml"), bath_depth_mm=6.0)


# --- FRESH layers in two inks, from recipe to checked G-code
SIZE_MM = (6.0, 4.0, 1.5)
WHOLE_UL = 6.0 * (4.0 * 1.5 - np.pi * 0.25**2)
CREST = 0.06 * (1 - np.pi / 4) / 2
"""How far a line's round side stands beyond that of the rectangle of its area, mm."""
WRITTEN_UL = WHOLE_UL - CREST * (2 * (6.0 + 4.0) * 1.5 + 2 * 6.0 * 0.5)
"""Without the notches between the lines' crests along the part's sides and its lumen's."""
LEVELS = 0.06 * (np.arange(25) + 0.5) - 0.75
RING = 0.06 * 2 * np.sqrt(np.maximum(0.65**2 - LEVELS**2, 0.0)).sum() - np.pi * 0.25**2
"""Area of what lies within 0.4 mm of the lumen, as layers cut it, mm²."""
ROUND_UL = 6.0 * RING - CREST * (2 * 6.0 * 0.5 + 2 * RING)
TUBE = vessels([[0, 2, 0.75], [6, 2, 0.75]], radius=0.25)
HALF = {"where": {"shape": "block", "from_mm": [3, -1, -1], "to_mm": [7, 5, 3]}, "head": 1}
HEADS = [{"ink": "collagen_fresh"}, {"syringe": "hamilton_2_5ml", "ink": "collagen_fresh"}]


def recipe(regions: list[dict[str, Any]], heads: list[dict[str, Any]]) -> dict[str, Any]:
    return {
        "schema": 1,
        "name": "two_inks",
        "tissue": {"shape": "block", "size_mm": list(SIZE_MM)},
        "vasculature": {"network": "tube.csv", "unit": "mm"},
        "toolpath": {"method": "fresh", "needle": "fresh_150um", "regions": regions},
        "printer": {
            "profile": "two_syringe_marlin",
            "bath": "gelatin_support",
            "dish": "petri_60mm",
            "bath_depth_mm": 6.0,
            "heads": heads,
        },
    }


def planned(folder: Path, regions: list[dict[str, Any]], name: str = "run") -> dict[str, Any]:
    write_network_csv(folder / "tube.csv", TUBE)
    made = parse_recipe(recipe(regions, HEADS), "two.yaml")
    return toolpath_recipe(made, folder, folder / name, Console(quiet=True))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("region", "second_ul"),
    [(HALF, WRITTEN_UL / 2), ({"around_vessels_mm": 0.4, "head": 1}, ROUND_UL)],
)
def test_two_inks_pass_the_checks_and_leave_the_lumen_as_open_as_one(
    tmp_path: Path, region: dict[str, Any], second_ul: float
) -> None:
    one, two = planned(tmp_path, [], "one"), planned(tmp_path, [region], "two")
    assert 20 <= two["toolpath"]["plan"]["changes"] <= 25  # at most one for each layer
    each = two["toolpath"]["plan"]["written_ul_of_heads"]
    assert each == pytest.approx([WRITTEN_UL - second_ul, second_ul], rel=0.01)
    pushed = [head["ink_pushed_ul"] for head in two["dry_run"]["ink_of_heads"]]
    assert pushed == pytest.approx(each, rel=0.01)
    lumen = [found["lumens"]["lumens"][0] for found in (one, two)]
    for size in ("narrowest_mm", "mean_mm"):
        assert lumen[1][size] == pytest.approx(lumen[0][size], abs=5e-3)
    assert two["lumens"]["passed"]


def lines(regions: list[dict[str, Any]], *heads: dict[str, Any], count: int = 2) -> list[float]:
    part = Fresh.model_validate({"method": "fresh", "regions": regions})
    return layer_lines_um(part, [HeadPart(**one) for one in heads], count)


@pytest.mark.parametrize(
    ("regions", "heads", "count", "words"),
    [
        ([HALF], [], 1, r"regions\.0: head is 1, and the printer has 1"),
        ([HALF | {"line_um": 200}, HALF | {"line_um": 300}], [], 2, "lines of one width"),
        ([HALF], [{"kinds": ["artery"]}, {}], 2, r"heads\.0 names kinds or trees"),
    ],
)
def test_heads_that_can_t_write_layers_so_are_refused(
    regions: list[dict[str, Any]], heads: list[dict[str, Any]], count: int, words: str
) -> None:
    with pytest.raises(UsageError, match=words):
        lines(regions, *heads, count=count)


# --- recipe's section on observing: what reaches the link, and what is refused
GOOD_OBSERVING = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())


def recipe_observing(observe, **printer):
    data = deepcopy(GOOD_OBSERVING)
    data["printer"] |= printer
    data["observe"] = observe
    if printer.get("port", "simulated") != "simulated":
        data["scan"] = {"file": "scan.tif"}
    return parse_recipe(data, "test.yaml")


@pytest.mark.parametrize(
    ("every", "care"),
    [
        ("layer", {"look_after": MarkKind.LAYER}),
        ("vessel", {"look_after": MarkKind.LAYER}),
        ("0.5 mm", {"look_every_height_mm": 0.5}),
        ("10 min", {"look_every_s": 600.0}),
        ("30 s", {"look_every_s": 30.0}),
        ("800 mm written", {"look_every_mm": 800.0, "look_after": MarkKind.LAYER}),
        ("10 s written", {"look_every_written_s": 10.0, "look_after": MarkKind.LAYER}),
        ("0.5 min written", {"look_every_written_s": 30.0, "look_after": MarkKind.LAYER}),
    ],
)
def test_every_says_when_the_print_is_held(every, care):
    part = recipe_observing({"device": "camera", "every": every}).observe
    assert look_care(part, embedded=False) == {"look_limit_s": 120.0, "look_park_mm": None, **care}


@pytest.mark.parametrize(
    ("observe", "said"),
    [
        ({"device": "camera", "every": "sometimes"}, "isn't a place to look at"),
        ({"device": "camera", "every": "800 mm"}, "say `800 mm written`"),
        ({"device": "camera", "every": "0 mm"}, "amounts are above 0"),
        ({"device": "camera", "every": "10"}, "isn't a place to look at"),
        ({"device": "camera", "every": 10}, "'10' isn't a place to look at"),
        ({"device": "camera", "source": "0"}, "needs frame"),
        ({"device": "laser_line", "source": "scans"}, "printer_to_scan"),
        ({"device": "ct"}, "device"),
        ({"device": "camera", "mend": "maybe"}, "mend"),
    ],
)
def test_a_wrong_section_is_refused(observe, said):
    with pytest.raises(RecipeError, match=said):
        recipe_observing(observe)


def test_a_real_printer_needs_a_real_device():
    with pytest.raises(UsageError, match="no source is named"):
        refuse_unobservable(
            recipe_observing({"device": "camera"}, port="/dev/ttyUSB0"),
            load(Printer, "generic_marlin"),
        )


def test_a_laser_line_doesnt_see_what_a_bath_covers():
    marlin = load(Printer, "generic_marlin")
    filled = recipe_observing({"device": "laser_line"}, dish="petri_60mm", bath_depth_mm=8)
    data = yaml.safe_load((ROOT / "examples" / "carbopol_scaled.yaml").read_text())
    embedded = parse_recipe(data | {"observe": {"device": "laser_line"}}, "test.yaml")
    for one in (filled, embedded):
        with pytest.raises(UsageError, match="sees the bath's surface alone"):
            refuse_unobservable(one, marlin)


@pytest.mark.parametrize(
    ("every", "unlooked"),
    [("0.05 mm", False), ("0.5 mm", True), ("10 min", True), ("5 s", False), ("vessel", False)],
)
def test_a_print_that_is_over_before_a_look_is_due_is_told(tmp_path, every, unlooked):
    """A part of 0.2 mm, looked at every 0.5 mm, was printed without a look and without a word."""
    lines = ["M82"]
    for layer in range(3):
        lines += [
            f"G1 X{10 + layer} Y10 Z{0.1 * (layer + 1):g} F600",
            f"G1 Y20 E{0.1 * (layer + 1):g}",
        ]
        lines.append(f";LAYER_END:{layer}")
    (tmp_path / GCODE).write_text("\n".join([*lines, "G1 Z5"]) + "\n")
    stages = {"dry run": SimpleNamespace(summary={"duration_s": 20.0})}
    context = SimpleNamespace(
        recipe=SimpleNamespace(
            observe=recipe_observing({"device": "camera", "every": every}).observe, toolpath=None
        ),
        folder=tmp_path,
        printer=load(Printer, "generic_marlin"),
        manifest=SimpleNamespace(stages=stages),
    )
    assert bool(unlooked_words(context)) is unlooked


def test_what_changed_in_observe_while_a_print_goes_on_is_told(tmp_path, monkeypatch):
    """`mend: ask` was changed to `mend` in a pause: the print asked on, and nothing said why."""
    said = ["ask"]

    class Order:
        def save(self, folder):
            (folder / ORDER_FILE).write_text(said[0])

    monkeypatch.setattr(observing, "_order", lambda context, part: Order())
    context = SimpleNamespace(recipe=recipe_observing({"device": "oct"}), folder=tmp_path)
    begun = tmp_path / "print"
    begun.mkdir()
    (tmp_path / GCODE).touch()
    told = []
    for said[0], kept in (("ask", ""), ("ask", "ask"), ("mend", "ask")):
        if kept:
            (begun / ORDER_FILE).write_text(kept)
        told.append(observing.observed_otherwise(context, begun))
    assert told == [False, False, True]
    context.recipe = recipe_observing(None)
    assert observing.observed_otherwise(context, begun)


# --- recipe's network from a file of any format; overlapping vessels in it
# A straight vessel, and another that runs 0.3 mm above it: radii of 0.2 mm, 0.1 mm in each other.
OVER = vessels([[1, 3, 2], [9, 3, 2]], [[5, 1, 2.3], [5, 5, 2.3]])


def _made(folder: Path, **vasculature: Any) -> dict[str, Any]:
    data = network_recipe(
        folder,
        OVER,
        (10, 6, 4),
        vasculature=vasculature,
        toolpath={"method": "embedded", "needle": "30g", "allowed_crossings": 10},
        printer={"ink": "gelatin_sacrificial", "bath": "cell_matrix"},
    )
    made = parse_recipe(data, "over.yaml")
    return toolpath_recipe(made, folder, folder / "run", Console(quiet=True))


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
    upright = vessels([[0, 0, -1], [0, 0, 11]], radius=radius)
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
    made = parse_recipe(data, "forest.yaml")
    console = Console(file=io.StringIO())
    design_recipe(made, folder, folder, console, until="vasculature")
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


def given_recipe(vessels: dict[str, Any]) -> Recipe:
    block = {"shape": "block", "size_mm": [12, 10, 8]}
    data = {"schema": 1, "name": "curved", "tissue": block, "vasculature": vessels}
    return parse_recipe(data, "curved.yaml")


def test_main_lines_are_curves_clear_of_each_other_with_flows_as_asked(tmp_path: Path) -> None:
    said = io.StringIO()
    design_recipe(given_recipe(TREE), tmp_path, tmp_path, Console(file=said), until="vasculature")
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
        given_recipe(TREE | more)
