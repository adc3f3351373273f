"""Apply a recipe's compensation file: check that it fits, correct the printed geometry."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from design.errors import ToolpathError
from design.hemodynamics import scaled_network
from design.solids import Solid, surface_genus
from design.toolpath.correction import check_outside, check_walls
from printctl.corrections.compensation import (
    CompensationFile,
    PrintConditions,
    changes_line,
    save_compensation,
)
from printctl.errors import SafetyError, UsageError
from printctl.pipeline.context import RunContext
from printctl.pipeline.prepared.solid_build import built_solids
from printctl.pipeline.run_options import SIMULATED_PORT
from printctl.run_folder.artefacts import NETWORK, PRINTED_WITH
from printctl.run_folder.manifest import digest_file

"""Copy of the file, in the run's folder."""
_SAME_UM = 1.0
"""Sizes of one part, read from files, differ by less."""


def check_compensation(context: RunContext, wall_mm: float) -> None:
    """Refuse a compensation that isn't this design's, or leaves walls too thin.

    Parameters
    ----------
    context : RunContext
    wall_mm : float, mm
        Thinnest wall that the method can write.

    Raises
    ------
    UsageError
        For another design's or method's.
    SafetyError
        For a simulated scan's on a real printer.
    DesignError
        When vessels collide, or walls became too thin.
    """
    made = context.compensation
    if made is None:
        return
    _check_design(context, made)
    _check_use(context, made)
    local = context.local_network
    check_walls(context.network, local, wall_mm)
    if made.made_with.method == "embedded":
        # A filament is as thick as its tube is wide, whichever way the part is stretched.
        check_walls(context.network, context.written_network, wall_mm)
    if context.recipe.solid.tubes is None:
        scale = 1 / context.recipe.print_scale  # the tissue's grid has the design's size
        designed = scaled_network(local, scale)
        check_outside(context.designed_network, designed, context.tissue.grid, wall_mm * scale)


def _check_design(context: RunContext, made: CompensationFile) -> None:
    name = context.recipe.toolpath.compensation
    remedy = (
        "print and scan this design once without it (leave toolpath.compensation out) and make its "
        "own with `printctl compensate`"
    )
    if digest_file(context.folder / NETWORK) != made.design.network_sha256:
        raise UsageError(
            f"toolpath.compensation: {name} belongs to another design: its network isn't this "
            f"recipe's; {remedy}"
        )
    off = 1e3 * np.abs(context.solid.bounds - np.array(made.design.bounds_mm)).max()
    if off > _SAME_UM:
        raise UsageError(
            f"toolpath.compensation: {name} belongs to another design: its construct's bounds "
            f"differ from this one's by {off:.0f} um; {remedy}"
        )


def _check_use(context: RunContext, made: CompensationFile) -> None:
    name, now = context.recipe.toolpath.compensation, print_conditions(context)
    if made.made_with.method != now.method:
        raise UsageError(
            f"toolpath.compensation: {name} was measured on prints by {made.made_with.method}, and "
            f"this one is {now.method}; each method has errors of its own: make one of its own"
        )
    if made.simulated and context.recipe.printer.port != SIMULATED_PORT:
        raise SafetyError(
            f"toolpath.compensation: {name} rests on a simulated scan, and printer.port is "
            f"{context.recipe.printer.port}; scan a real print and make one from it"
        )
    for key, value in now.model_dump().items():
        was = getattr(made.made_with, key)
        if was != value:
            context.bars.remark(
                "toolpath", f"note: {name} was measured with {key} {was}; here it is {value}"
            )


def print_conditions(context: RunContext) -> PrintConditions:
    """What this print is made with."""
    part = context.recipe.toolpath
    return PrintConditions(
        method=part.method,
        printer=context.printer.name,
        needle=context.needle.name,
        ink=context.ink.name,
        bath=context.bath.name,
        layer_um=getattr(part, "layer_um", None),
        line_um=getattr(part, "line_um", None),
    )


def written_solid(context: RunContext) -> Solid:
    """The construct as it is to be written: lumens corrected, then stretched.

    Raises
    ------
    ToolpathError
        When corrected lumens open into each other or out of the body.
    """
    corrections = context.corrections
    if not corrections.changes_lumens:
        return corrections.stretch.solid(context.solid)
    built = built_solids(context, context.local_network)
    genus, _ = surface_genus(built.construct.faces)
    if genus != built.genus:
        raise ToolpathError(
            f"with toolpath.compensation the construct has {genus} handles, {built.genus} by "
            "design: lumens would open into each other or close; compensate --without-vessel for "
            "the ones that it names, or leave local corrections out (compensate --whole-only)"
        )
    return corrections.stretch.solid(built.construct)


def compensation_facts(context: RunContext) -> tuple[dict[str, Any], list[str]]:
    """What the run's summary says of it, and the file kept in the run's folder."""
    made, place = context.compensation, context.folder / PRINTED_WITH
    if made is None:
        place.unlink(missing_ok=True)
        return {}, []
    name = str(context.recipe.toolpath.compensation)
    save_compensation(place, made)
    line = f"{Path(name).name}: {changes_line(made)}"
    context.bars.remark("toolpath", f"compensation {line}")
    details = made.model_dump(mode="json", exclude={"evidence"})
    digest = context.compensation_digest[name]
    return {"compensation": line, "corrections": {"sha256": digest, **details}}, [PRINTED_WITH]


def solid_dependence(context: RunContext) -> list[Any]:
    """What the corrected construct is made of, beside the design's files."""
    if context.compensation is None:
        return []
    return [context.recipe.solid.model_dump(mode="json")]
