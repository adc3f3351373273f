"""`printctl flow RUN --as-printed`: solve the flow in a run's designed and printed lumens."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

import typer
from pydantic import ValidationError

from firmware_profiles.strict_model import StrictModel
from printctl.cli.flow_output import FlowOutput
from printctl.cli.flow_part import (
    DRIVING,
    ONE_D,
    SECTIONS,
    THREE_D,
    part_of,
    refuse_idle_options,
    shear_band,
)
from printctl.cli.options import messages
from printctl.cli.section_options import SectionOptions, wrong_option
from printctl.errors import UsageError
from printctl.flow.printed_case import PrintedCase, recipe_of, solve_as_printed
from printctl.recipe.parts import FlowPart

_DRIVING: Final = (*(name for group in DRIVING for name in group.fields()), "fluid", "stenosis")
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
    refuse_idle_options(asked)
    if asked["one_d"] and part.pulse is None:
        raise UsageError(
            "--one-d follows a pulse, and the recipe has none; give --amplitude-ml-min, --shape "
            "or --waveform, and what else drives the flow"
        )
    change = {"one_d": _asked_of(ONE_D, part.one_d, asked), "compare": None}
    change |= {"three_d": _asked_of(THREE_D, part.three_d, asked)} | shear_band(asked)
    try:
        return FlowPart.model_validate(part.model_dump(exclude_unset=True) | change)
    except ValidationError as exc:
        raise wrong_option(exc, SECTIONS, "flow") from exc


def _asked_of(
    group: SectionOptions, known: StrictModel | None, asked: Mapping[str, Any]
) -> dict[str, Any] | None:
    """The recipe's section of one fidelity with what was typed; None where it isn't asked for."""
    typed = group.typed(asked)
    if not asked[group.at[-1]]:
        return None
    return ({} if known is None else known.model_dump()) | typed
