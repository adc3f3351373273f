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
from printctl.pipeline.observable import refuse_unobservable
from printctl.pipeline.observing import look_care, unlooked_words
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


def test_a_laser_line_doesnt_see_what_a_bath_covers():
    marlin = load(Printer, "generic_marlin")
    filled = recipe({"device": "laser_line"}, dish="petri_60mm", bath_depth_mm=8)
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
