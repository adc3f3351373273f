"""Options shared by commands on vessel networks: file, unit, tissue mesh, inlet flow, viscosity."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from design.units import BLOOD_MPA_S, LengthUnit

SourceArg = Annotated[
    Path,
    typer.Argument(
        help="A run folder, or a network: .csv, .vtp, .swc, .json, .npz, .txt.", show_default=False
    ),
]
UnitOption = Annotated[
    LengthUnit | None,
    typer.Option("--unit", help="Of the file, where it doesn't say (.csv, .vtp, .stl, .swc)."),
]
TissueOption = Annotated[
    Path | None,
    typer.Option("--tissue", help="A closed mesh, or a run folder; a run has its own."),
]
TissueUnitOption = Annotated[
    LengthUnit | None, typer.Option("--tissue-unit", help="Of the tissue's mesh.")
]
InletFlowOption = Annotated[
    float | None,
    typer.Option(
        "--inlet-flow-ml-min", min=1e-9, help="In place of a run's own; of a file 0.25 without it."
    ),
]
ViscosityOption = Annotated[
    float | None,
    typer.Option(
        "--viscosity-mpa-s",
        min=1e-6,
        help=f"In place of a run's own; of a file {BLOOD_MPA_S:g}, blood's, without it.",
    ),
]
