"""`printctl flow RUN --as-printed`: solve the flow in a run's designed and printed lumens."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import typer

from printctl.cli.flow_output import FlowOutput
from printctl.cli.flow_part import part_of
from printctl.cli.options import messages
from printctl.errors import UsageError
from printctl.flow.printed_case import PrintedCase, recipe_of, solve_as_printed
from printctl.recipe.parts import FlowPart
from printctl.recipe.space import ThreeDPart
from printctl.recipe.waves import OneDPart

_DRIVING: Final = (
    "inlet_flow_ml_min", "inlet_pressure_mmhg", "outlet_pressure_mmhg",
    "outlet_resistance_mmhg_min_ml", "outlet_proximal_mmhg_min_ml", "outlet_compliance_ml_mmhg",
    "outlets", "viscosity_mpa_s", "density_g_cm3", "fluid", "junction_k", "stenosis",
    "amplitude_ml_min",
    "amplitude_mmhg", "shape", "waveform", "period_s", "wall_young_kpa", "wall_thickness_mm",
)  # fmt: skip
_ELSEWHERE: Final = (
    "svzerod",
    "svoned",
    "ranks",
    "slurm",
    "svmultiphysics",
    "compare",
    "check",
    "results",
)


def run_as_printed(context: typer.Context, folder: Path, out: Path, output: FlowOutput) -> None:
    """Solve and write; what was typed of the flow stands in for the recipe's section, whole.

    Raises
    ------
    UsageError
        For a network that is no run folder, options that don't go with --as-printed, and as
        `solve_as_printed`.
    FlowError, SolidError, OSError
        As `solve_as_printed`.
    """
    asked = context.params
    for key in _ELSEWHERE:
        if asked[key] not in (None, False):
            name = key.replace("_", "-")
            raise UsageError(f"--{name} doesn't go with --as-printed; leave one of them out")
    if asked["unit"] not in (None, "mm"):
        raise UsageError(f"a run folder's files are in mm, not {asked['unit']}; drop --unit")
    if asked["scanned"] and not asked["three_d"]:
        raise UsageError("--scanned is for --three-d; add that, or leave it out")
    recipe = recipe_of(folder)
    typed = any(_typed(context, key) for key in _DRIVING)
    part = part_of(asked) if typed else _with_asked(recipe.flow, asked)
    fillet = asked["fillet_ratio"] if _typed(context, "fillet_ratio") else recipe.solid.fillet_ratio
    scale = 1.0 if typed else recipe.print_scale
    case = PrintedCase(folder, part, scale, fillet, asked["scanned"])
    with messages().status("flow as printed") as status:
        summary, files = solve_as_printed(case, out, status.update)
    output.summary |= {"conditions": "as typed" if typed else "the recipe's"} | summary
    output.files += files


def _typed(context: typer.Context, key: str) -> bool:
    source = context.get_parameter_source(key)
    return source is not None and source.name == "COMMANDLINE"


def _with_asked(part: FlowPart, asked: Mapping[str, Any]) -> FlowPart:
    """A recipe's section with the fidelities and the band that were typed."""
    typed = {
        key: value
        for key, value in asked.items()
        if key in ("cell_mm", "wall_viscosity_pa_s", "edge_ratio", "order") and value is not None
    }
    own: dict[str, Any] = {
        key: typed[key] for key in ("cell_mm", "wall_viscosity_pa_s") if key in typed
    }
    space: dict[str, Any] = {key: typed[key] for key in ("edge_ratio", "order") if key in typed}
    idle = [key for key in own if not asked["one_d"]] + [k for k in space if not asked["three_d"]]
    if idle:
        wants = "one-d" if idle[0] in own else "three-d"
        raise UsageError(
            f"--{idle[0].replace('_', '-')} is for --{wants}; add that, or leave it out"
        )
    if asked["one_d"] and part.pulse is None:
        raise UsageError(
            "--one-d follows a pulse, and the recipe has none; give --amplitude-ml-min, --shape "
            "or --waveform, and what else drives the flow"
        )
    one_d = (part.one_d or OneDPart()).model_copy(update=own) if asked["one_d"] else None
    three_d = (part.three_d or ThreeDPart()).model_copy(update=space) if asked["three_d"] else None
    change: dict[str, Any] = {"one_d": one_d, "three_d": three_d, "compare": None}
    if asked["shear_band_dyn_cm2"] is not None:
        low_high = part_of({**_blank(asked), "shear_band_dyn_cm2": asked["shear_band_dyn_cm2"]})
        change["shear_band_dyn_cm2"] = low_high.shear_band_dyn_cm2
    return part.model_copy(update=change)


def _blank(asked: Mapping[str, Any]) -> dict[str, Any]:
    """The same options, none of them given."""
    return {key: False if value is True or value is False else None for key, value in asked.items()}
