"""Several heads in a recipe: their contents, and the vessels they write."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from rich.console import Console

from design.network import VesselKind, VesselNetwork
from design.network_files.csv_format import write_network_csv
from firmware_profiles import Printer, load
from printctl.errors import RecipeError, SafetyError, UsageError
from printctl.machine.link.marks import MarkKind
from printctl.observe.records import ORDER
from printctl.pipeline import observing
from printctl.pipeline.heads import layer_lines_um, vessel_heads
from printctl.pipeline.observing import look_care, unlooked_words
from printctl.pipeline.refusals import refuse_unobservable
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import parse_recipe
from printctl.recipe.making import Fresh, HeadPart
from printctl.run_folder.artefacts import GCODE

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
    write_network_csv(folder / "two.csv", BESIDE)
    data = {
        "schema": 1,
        "name": "two_inks",
        "tissue": {"shape": "block", "size_mm": [10, 6, 4]},
        "vasculature": {"network": "two.csv", "unit": "mm"},
        "toolpath": {"method": "embedded", "needle": "30g"},
        "printer": {
            "profile": "two_syringe_marlin",
            "bath": "cell_matrix",
            "dish": "petri_60mm",
            "heads": [
                {"ink": "gelatin_sacrificial", "kinds": ["artery"]},
                {"syringe": "hamilton_2_5ml", "ink": "gelatin_sacrificial", "kinds": ["vein"]},
            ],
            **printer,
        },
    }
    recipe = parse_recipe(data, "two.yaml")
    return toolpath_recipe(recipe, folder, folder / "run", Console(quiet=True))


BESIDE = VesselNetwork.from_segments(
    np.array([[1.0, 2, 2], [9, 2, 2], [1, 4, 2], [9, 4, 2]]),
    np.array([[0, 1], [2, 3]]),
    np.full(2, 0.2),
    np.array([VesselKind.ARTERY, VesselKind.VEIN], dtype=np.int64),
    np.array([0, 1]),
)


def test_two_inks_are_planned_written_and_checked(tmp_path: Path) -> None:
    found = whole(tmp_path, bath_depth_mm=6.0)
    text = (tmp_path / "run" / "part.gcode").read_text()
    assert text.count("\nT1 S1\n") == 1
    names = [check["check"] for check in found["dry_run"]["checks"]]
    assert "head 1 (right): needle to the dish's wall" in names
    assert "lowest tip that doesn't write, above the bath's surface" in names
    pushed = [one["ink_pushed_ul"] for one in found["dry_run"]["ink_of_heads"]]
    assert pushed == pytest.approx([np.pi * 0.04 * 8] * 2, rel=0.05)
    assert found["lumens"]["passed"]


def test_heads_that_stay_in_the_bath_are_refused(tmp_path: Path) -> None:
    data = load(Printer, "two_syringe_marlin").model_dump(mode="json", exclude_unset=True)
    for head in data["heads"]:
        for key in ("raised_mm", "raises", "lowers", "moving_s"):
            head.pop(key)
    (tmp_path / "fixed.yaml").write_text(yaml.safe_dump(data))
    with pytest.raises(SafetyError, match="drag through gel"):
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
NONE = np.zeros(1, dtype=np.int64)
TUBE = VesselNetwork.from_segments(
    np.array([[0.0, 2, 0.75], [6, 2, 0.75]]), np.array([[0, 1]]), np.array([0.25]), NONE, NONE
)
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
            (folder / ORDER).write_text(said[0])

    monkeypatch.setattr(observing, "_order", lambda context, part: Order())
    context = SimpleNamespace(recipe=recipe_observing({"device": "oct"}), folder=tmp_path)
    begun = tmp_path / "print"
    begun.mkdir()
    (tmp_path / GCODE).touch()
    told = []
    for said[0], kept in (("ask", ""), ("ask", "ask"), ("mend", "ask")):
        if kept:
            (begun / ORDER).write_text(kept)
        told.append(observing.observed_otherwise(context, begun))
    assert told == [False, False, True]
    context.recipe = recipe_observing(None)
    assert observing.observed_otherwise(context, begun)
