"""Set up a recipe's wells, and refuse a part too wide for its well."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Dish, Plate, load
from printctl.checks.set_up import WALL_CLEARANCE_MM
from printctl.errors import RecipeError
from printctl.pipeline.context import RunContext
from printctl.pipeline.facts import run_facts
from printctl.pipeline.plate_plan import (
    StandingPlate,
    Well,
    assigned,
    route,
    scanned_wells,
    standing_plate,
    varied_recipe,
)
from printctl.recipe.sections.measuring import FileScan
from printctl.recipe.sections.plate import PlatePart
from printctl.recipe.sections.toolpath import Fresh
from printctl.run_folder.manifest import Manifest

WELLS: Final = "wells"
"""Folder of the wells' own runs."""


@dataclass(frozen=True, eq=False)
class PlateRun:
    """A run over a plate.

    Attributes
    ----------
    whole : RunContext
        The plate's own folder; its stand is the first well that is printed in.
    part : PlatePart
    standing : StandingPlate
    wells : list of Well
        In the order in which they are printed.
    scanned : list of str
        Wells whose scan is held against the design.
    runs : dict of str to RunContext
        By well: the first well of each variant, and those that are scanned.
    """

    whole: RunContext
    part: PlatePart
    standing: StandingPlate
    wells: list[Well]
    scanned: list[str]
    runs: dict[str, RunContext]

    def run_of(self, well: Well) -> RunContext:
        """The run that says what a well gets: its own, or the first of its variant."""
        own = self.runs.get(well.name)
        return own if own is not None else self.runs[self.first_of(well.variant).name]

    def first_of(self, variant: int) -> Well:
        """The first well of a variant, as the recipe names them."""
        return next(well for well in self.wells if well.variant == variant and well.copy == 1)

    def place_of(self, well: Well) -> NDArray[np.float64]:
        """Where a well's part has its origin, printer's frame, (3,), mm."""
        of = self.run_of(well)
        assert of.stand is not None
        moved = np.subtract(self.standing.centre_mm(well.name), of.stand.centre_mm)
        return np.asarray(np.round(of.place_mm + np.append(moved, 0.0), 3))

    def folder_of(self, well: Well) -> str:
        """Name of the folder of `run_of`, in the plate's."""
        return f"{WELLS}/{self.run_of(well).folder.name}"


def plate_run(whole: RunContext) -> PlateRun:
    """Read the recipe's plate; give its wells their runs.

    Raises
    ------
    RecipeError
        For a plate, well or swept value that can't be used.
    """
    part = whole.recipe.plate
    if part is None:
        raise RecipeError("the recipe names no plate")
    _refuse_unbuilt(whole, part)
    plate = load(Plate, part.profile)
    named = assigned(part, plate)
    standing = standing_plate(plate, whole.printer, part.a1_mm, part.turned_deg, part.bath_depth_mm)
    _check_reach(whole, standing, named)
    by_name = {well.name: well for well in named}
    order = [by_name[name] for name in route(list(by_name), standing)]
    scanned = scanned_wells(part, plate, named)
    _one_scan(whole, scanned)
    whole.stand = standing.stand(order[0].name)
    runs: dict[str, RunContext] = {}
    for well in named:
        if well.copy == 1 or well.name in scanned:
            runs[well.name] = _run_of(whole, well, standing, list(runs.values()))
    return PlateRun(whole, part, standing, order, scanned, runs)


def _run_of(
    whole: RunContext, well: Well, standing: StandingPlate, before: Sequence[RunContext]
) -> RunContext:
    folder = whole.folder / WELLS / well.name
    context = RunContext(
        varied_recipe(whole.recipe, well.point, well.name),
        whole.recipe_folder,
        folder,
        Manifest.load(folder),
        whole.bars,
        whole.assume_yes,
        stand=standing.stand(well.name),
        ink_changes=well.point.ink,
        title=well.name,
        siblings=before,
    )
    context.manifest.facts = run_facts(context) | {
        "well": well.name,
        "label": well.label,
        "varied": dict(well.point.values),
    }
    for other in before:
        if other.recipe.tissue == context.recipe.tissue and "tissue" in vars(other):
            vars(context)["tissue"] = other.tissue  # made once; it may take seconds
            break
    return context


def _refuse_unbuilt(whole: RunContext, part: PlatePart) -> None:
    if whole.printer.heads:
        raise RecipeError(
            f"plate: {whole.printer.name} has {whole.printer.head_count} heads, and a job over a "
            "plate is written by one; take a printer with one (printer.profile)"
        )
    if whole.printer.pneumatic is None:
        return
    idle = [key for key in part.sweep if key.startswith("ink.") or key.endswith("write_speed_mm_s")]
    if idle:
        raise RecipeError(
            f"plate.sweep: {idle[0]} does nothing on {whole.printer.name}, whose speed follows "
            "from one flow (dispenser); vary something else, or take a plunger"
        )


def _check_reach(whole: RunContext, standing: StandingPlate, wells: Sequence[Well]) -> None:
    """Refuse wells that no needle of the printer can stand in the middle of."""
    spans = {"x": whole.printer.x_mm, "y": whole.printer.y_mm}
    for well in wells:
        for (axis, span), at in zip(spans.items(), standing.centre_mm(well.name), strict=True):
            if not span.low <= at <= span.high:
                raise RecipeError(
                    f"plate: the middle of well {well.name} is at {axis} {at:g} mm, beyond the "
                    f"{span.low:g} to {span.high:g} mm of {whole.printer.name} ({axis}_mm); move "
                    "the plate (plate.a1_mm), turn it (turned_deg) or name other wells"
                )


def _one_scan(whole: RunContext, scanned: Sequence[str]) -> None:
    if isinstance(whole.recipe.scan, FileScan) and len(scanned) > 1:
        raise RecipeError(
            f"scan.file is one well's, and plate.scanned names {len(scanned)}; name the one that "
            "was scanned, and hold other scans against their wells with `printctl register`"
        )


def make_folders(run: PlateRun) -> None:
    """Make the wells' folders, and keep what their manifests say."""
    for context in run.runs.values():
        context.folder.mkdir(parents=True, exist_ok=True)
        context.manifest.save()


def relative(run: PlateRun, context: RunContext, name: str) -> str:
    """A file of a well's run as the plate's folder names it."""
    return Path(WELLS, context.folder.relative_to(run.whole.folder / WELLS), name).as_posix()


def check_fit(context: RunContext) -> None:
    """Refuse a part that its needle can't write without touching the well's wall.

    Of layers all of the tissue counts, of embedded writing the vessels alone.

    Raises
    ------
    RecipeError
        With both sizes.
    """
    dish, stand = context.dish, context.stand
    if dish is None or stand is None:
        return
    taken = reach_mm(context, dish) + context.needle.outer_mm / 2 + WALL_CLEARANCE_MM
    inside = np.array([dish.inner_x_mm, dish.inner_y_mm])[: len(taken)] / 2
    if (taken <= inside).all():
        return
    axis = int((taken - inside).argmax())
    along = "" if dish.shape == "round" else f" along {'xy'[axis]}"
    raise RecipeError(
        f"plate: with the needle ({context.needle.outer_mm:g} mm) and {WALL_CLEARANCE_MM:g} mm "
        f"between it and the wall the part takes {2 * taken[axis]:.4g} mm{along}, and well "
        f"{stand.well} has {2 * inside[axis]:g} mm ({dish.name}); take a plate with wider wells or "
        "a smaller part"
    )


def reach_mm(context: RunContext, dish: Dish) -> NDArray[np.float64]:
    """How far the tip goes from the part's middle: (1,) all around, or (2,) along x and y, mm."""
    if isinstance(context.recipe.toolpath, Fresh):
        stretch = context.corrections.stretch
        corners = np.asarray(context.tissue.surface.vertices, dtype=np.float64)
        points = stretch.points(corners * context.recipe.print_scale)
    else:
        points = context.written_network.points
    off = points[:, :2] - context.bounds.mean(axis=0)[:2]
    if dish.shape == "round":
        return np.linalg.norm(off, axis=1).max(keepdims=True)
    return np.abs(off).max(axis=0)
