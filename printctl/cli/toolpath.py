"""`printctl toolpath`: write a recipe's checked G-code, and a map of lines to vessels or layers."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from design.files import atomic_replacement
from printctl.cli.options import (
    JsonFlag,
    RecipeArg,
    messages,
    print_json,
    print_lines,
    print_note,
    refuse_input_as_output,
)
from printctl.cli.process_lines import process_lines
from printctl.errors import UsageError
from printctl.pipeline.run import toolpath_recipe
from printctl.recipe import load_recipe
from printctl.run_folder.artefacts import GCODE, LINE_MAP, PLATE_PICTURE, PLATE_TABLE

# Terminal text on vessels left unwritten and joints left open by an embedded toolpath.


def plan_lines(plan: Mapping[str, Any]) -> Iterator[str]:
    """Name every vessel that isn't written and every open joint, from ``summary.plan``."""
    left, cut = plan.get("left_out", ()), plan.get("cut_off", ())
    if left:
        yield (
            f"{len(left)} vessels aren't written, since the needle would pass through ink in any "
            f"order (toolpath.leave_out); {len(cut)} written ones lose their supply"
            + (f": {', '.join(map(str, cut))}" if cut else "")
        )
    yield from map(_left_out, left)
    for one in plan.get("open", ()):
        if "barred_by" in one:
            yield _open(one)


def _left_out(one: Mapping[str, Any]) -> str:
    text = (
        f"vessel {one['vessel']} isn't written: too near to vessel {one['other']} at "
        f"{_place(one)}; they would have to be at least {one['apart_mm']:.3f} mm further apart"
    )
    if one["needle_mm"] > 0:
        text += f", or the needle's tip {one['needle_mm']:.3f} mm wide outside"
    return text


def _open(one: Mapping[str, Any]) -> str:
    text = f"joint of vessels {one['vessel']} and {one['other']} at {_place(one)} stays open"
    if one["barred_by"] >= 0:
        text += f": vessel {one['barred_by']} is in the shaft's way on either side"
    if one["needle_mm"] > 0:
        text += (
            f"; a quarter of the overlap has room with that vessel {one['apart_mm']:.3f} mm "
            f"further off sideways, or a tip {one['needle_mm']:.3f} mm wide outside"
        )
    return text


def _place(one: Mapping[str, Any]) -> str:
    x, y, z = one["place_mm"]
    return f"({x:.2f}, {y:.2f}, {z:.2f}) mm"


def toolpath(
    recipe: RecipeArg,
    out: Annotated[Path, typer.Option("--out", help="G-code file to write.", show_default=False)],
    as_json: JsonFlag = False,
) -> None:
    """Write a recipe's G-code after its dry run, with FILE.map.npz (line to vessel or layer).

    Of a plate with FILE.wells.csv and a picture, FILE.svg.
    """
    if out.is_dir():
        raise UsageError(f"{out} is a folder; give the name of a .gcode file in it")
    refuse_input_as_output(out, recipe)
    loaded = load_recipe(recipe, print_note)
    with tempfile.TemporaryDirectory() as scratch:
        data = toolpath_recipe(loaded, recipe.resolve().parent, Path(scratch), messages())
        beside = [(LINE_MAP, out.with_suffix(".map.npz")), (GCODE, out)]
        if loaded.plate is not None:
            beside += [
                (PLATE_TABLE, out.with_suffix(".wells.csv")),
                (PLATE_PICTURE, out.with_suffix(".svg")),
            ]
        for name, place in beside:
            with atomic_replacement(place) as draft:
                shutil.copyfile(Path(scratch) / name, draft)
    if as_json:
        print_json(data)
        return
    print_lines(
        f"{data['toolpath']['lines']} lines, {data['toolpath']['written_ul']:.4g} µL, "
        f"{data['dry_run']['duration_s'] / 60:.1f} min",
        *process_lines(data["dry_run"]),
        *plan_lines(data["toolpath"].get("plan", {})),
        str(out),
    )
