"""Recipe's section on observing: what reaches the link, and what is refused."""

from __future__ import annotations

from copy import deepcopy
from pathlib import Path
from types import SimpleNamespace

import pytest
import yaml

from firmware_profiles import Printer, load
from printctl.errors import RecipeError, UsageError
from printctl.machine.link.marks import MarkKind
from printctl.observe.records import ORDER
from printctl.pipeline import observing
from printctl.pipeline.observing import device_settings, look_care, unlooked_words
from printctl.pipeline.refusals import refuse_unobservable
from printctl.pipeline.stages.toolpath import looks_within
from printctl.recipe import parse_recipe
from printctl.run_folder.artefacts import GCODE

ROOT = Path(__file__).parents[3]
GOOD = yaml.safe_load((ROOT / "examples" / "planar_fresh.yaml").read_text())


def recipe(observe, **printer):
    data = deepcopy(GOOD)
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
    part = recipe({"device": "camera", "every": every}).observe
    assert look_care(part, embedded=False) == {"look_limit_s": 120.0, "look_park_mm": None, **care}


def test_a_folder_that_isnt_there_yet_is_no_camera(tmp_path):
    part = recipe({"device": "camera", "source": "pictures/", "frame": "frame.yaml"}).observe
    settings = device_settings(SimpleNamespace(recipe_folder=tmp_path), part)
    assert (settings.kind, settings.source) == ("folder", str(tmp_path.resolve() / "pictures"))


def test_without_the_section_nobody_looks():
    assert look_care(None, embedded=False) == {}


def test_what_is_written_in_a_bath_is_looked_at_where_vessels_end():
    part = recipe({"device": "camera", "every": "10 s written"}).observe
    assert look_care(part, embedded=True)["look_after"] is MarkKind.VESSEL


def test_a_cameras_number_may_stand_as_a_number():
    part = recipe({"device": "camera", "source": 0, "frame": "frame.yaml"}).observe
    assert part.source == "0"
    with pytest.raises(RecipeError, match="source"):
        recipe({"device": "camera", "source": -1, "frame": "frame.yaml"})


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
        recipe(observe)


def test_a_real_printer_needs_a_real_device():
    with pytest.raises(UsageError, match="no source is named"):
        refuse_unobservable(
            recipe({"device": "camera"}, port="/dev/ttyUSB0"), load(Printer, "generic_marlin")
        )


@pytest.mark.parametrize("device", ["oct", "laser_line"])
def test_a_simulated_one_is_observed_by_its_twin(device):
    bare = recipe({"device": device}, bath_depth_mm=None)
    refuse_unobservable(bare, load(Printer, "generic_marlin"))


def test_a_laser_line_doesnt_see_what_a_bath_covers():
    marlin = load(Printer, "generic_marlin")
    filled = recipe({"device": "laser_line"}, dish="petri_60mm", bath_depth_mm=8)
    data = yaml.safe_load((ROOT / "examples" / "carbopol_scaled.yaml").read_text())
    embedded = parse_recipe(data | {"observe": {"device": "laser_line"}}, "test.yaml")
    for one in (filled, embedded):
        with pytest.raises(UsageError, match="sees the bath's surface alone"):
            refuse_unobservable(one, marlin)


def test_by_default_each_layer_or_vessel_is_looked_at_and_long_ones_within():
    part = recipe({"device": "camera"}).observe
    layered, bath = look_care(part, embedded=False), look_care(part, embedded=True)
    assert (layered["look_after"], bath["look_after"]) == (MarkKind.LAYER, MarkKind.VESSEL)
    assert layered["look_every_written_s"] == 60.0


@pytest.mark.parametrize(("every", "within"), [("vessel", True), ("60 s written", False)])
def test_vessels_are_looked_at_within_where_each_is_asked_for(every, within):
    data = yaml.safe_load((ROOT / "examples" / "planar_tree.yaml").read_text())
    embedded = parse_recipe(data | {"observe": {"device": "oct", "every": every}}, "test.yaml")
    layered = recipe({"device": "oct", "every": every})
    assert looks_within(SimpleNamespace(recipe=embedded)) is within
    assert not looks_within(SimpleNamespace(recipe=layered))
    assert not looks_within(SimpleNamespace(recipe=parse_recipe(data, "test.yaml")))


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
            observe=recipe({"device": "camera", "every": every}).observe, toolpath=None
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
    context = SimpleNamespace(recipe=recipe({"device": "oct"}), folder=tmp_path)
    begun = tmp_path / "print"
    begun.mkdir()
    (tmp_path / GCODE).touch()
    told = []
    for said[0], kept in (("ask", ""), ("ask", "ask"), ("mend", "ask")):
        if kept:
            (begun / ORDER).write_text(kept)
        told.append(observing.observed_otherwise(context, begun))
    assert told == [False, False, True]
    context.recipe = recipe(None)
    assert observing.observed_otherwise(context, begun)
