"""Options of `printctl flow` for 1D waves, and what they do."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import ValidationError

from design.hemodynamics import PulsatileConditions, write_svoned
from design.network import VesselNetwork
from printctl.cli.options import messages
from printctl.errors import UsageError
from printctl.flow.one_d import ONE_D, ONE_D_WAVES, one_d_options, solve_and_write_one_d
from printctl.recipe.waves import OneDPart

OneDFlag = Annotated[
    bool, typer.Option("--one-d", help="Follow the pulse's waves along the vessels, too.")
]
CellOption = Annotated[float | None, typer.Option("--cell-mm", help="Of 1D flow.")]
WallViscosityOption = Annotated[
    float | None, typer.Option("--wall-viscosity-pa-s", help="Kelvin-Voigt walls in 1D flow.")
]
SvonedOption = Annotated[
    Path | None,
    typer.Option("--svoned", help="Write the pulsatile problem for svOneDSolver, too."),
]


def one_d_part(
    one_d: bool, cell_mm: float | None, wall_viscosity_pa_s: float | None, pulse: bool
) -> OneDPart | None:
    """The options as a recipe's section; None where 1D flow isn't asked for.

    Raises
    ------
    UsageError
        For what doesn't go together, or is out of bounds.
    """
    given = {"cell_mm": cell_mm, "wall_viscosity_pa_s": wall_viscosity_pa_s}
    said = {key: value for key, value in given.items() if value is not None}
    if not one_d:
        if said:
            raise UsageError(f"--{next(iter(said)).replace('_', '-')} is for --one-d")
        return None
    if not pulse:
        raise UsageError("--one-d follows a pulse; give --amplitude-ml-min, --shape or --waveform")
    try:
        return OneDPart.model_validate(said)
    except ValidationError as exc:
        first = exc.errors()[0]
        raise UsageError(f"{'.'.join(map(str, first['loc']))}: {first['msg']}") from exc


def follow_waves(
    out: Path,
    network: VesselNetwork,
    conditions: PulsatileConditions,
    part: OneDPart | None,
    samples: int,
    svoned: Path | None,
) -> tuple[dict[str, Any], list[Path]]:
    """Solve 1D flow where it is asked for, write svOneDSolver's input where that is.

    Returns
    -------
    summary, files
        Both empty where neither is asked for.
    """
    summary: dict[str, Any] = {}
    files: list[Path] = []
    options = one_d_options(part or OneDPart(), samples)
    if part is not None:
        with messages().status("1D flow") as status:

            def tell(cycle: int, change: float) -> None:
                status.update(f"1D flow, cycle {cycle}: changed by {change:.2g} of the swing")

            summary = solve_and_write_one_d(out, network, conditions, options, tell)
        files += [out / ONE_D, out / ONE_D_WAVES]
    if svoned is not None:
        write_svoned(svoned, network, conditions, options)
        files.append(svoned)
    return summary, files
