"""Options of `printctl flow` that no field of a recipe's `flow` section stands for."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import typer

from printctl.cli.options import folder_to_write

OutOption = Annotated[
    Path,
    typer.Option(
        "--out", callback=folder_to_write, help="Folder for the tables; made where it isn't."
    ),
]
FluidOption = Annotated[
    Path | None,
    typer.Option("--fluid", help="YAML with a recipe's flow.viscosity: model: carreau and so on."),
]
StenosisOption = Annotated[
    list[str] | None,
    typer.Option(
        "--stenosis",
        metavar="VESSEL,SHARE,MM",
        help="Vessel, diameter left (0.1 to 1), length; may be given again.",
    ),
]
ShearBandOption = Annotated[
    str | None,
    typer.Option("--shear-band-dyn-cm2", metavar="LOW,HIGH", help="Wall shear that is wanted."),
]
SvzerodOption = Annotated[
    Path | None,
    typer.Option("--svzerod", help="Write the problem for svZeroDSolver, too."),
]
SvonedOption = Annotated[
    Path | None,
    typer.Option("--svoned", help="Write the pulsatile problem for svOneDSolver, too."),
]
FilletOption = Annotated[
    float | None,
    typer.Option("--fillet-ratio", help="Of 3D: fillet over the thinnest vessel's radius."),
]
AsPrintedFlag = Annotated[
    bool,
    typer.Option(
        "--as-printed", help="Of a run: as designed against the lumens that registration found."
    ),
]
ScannedFlag = Annotated[
    bool, typer.Option("--scanned", help="3D as printed in the scan's own surface.")
]
ResultsOption = Annotated[
    Literal["csv", "npz"] | None,
    typer.Option("--results", help="Tables as csv, or as arrays of one npz (NumPy, fast)."),
]


@dataclass(frozen=True)
class OtherSolvers:
    """Options that have 3D flow solved by, or written for, other programs."""

    ranks: Annotated[
        int | None, typer.Option("--ranks", help="Solve 3D on so many MPI processes, by FEniCSx.")
    ] = None
    ranks_python: Annotated[
        Path | None, typer.Option("--ranks-python", help="Interpreter with dolfinx, for --ranks.")
    ] = None
    svmultiphysics: Annotated[
        Path | None,
        typer.Option("--svmultiphysics", help="Write the 3D case for svMultiPhysics here."),
    ] = None


@dataclass(frozen=True)
class Match:
    """Options that adjust radii until 3D flow divides as wanted."""

    match_split: Annotated[
        bool,
        typer.Option("--match-split", help="Adjust radii until 3D divides as 0D, or --want."),
    ] = False
    want: Annotated[
        list[str] | None,
        typer.Option(
            "--want", metavar="NODE,ML_MIN", help="Flow wanted at an outlet; again for more."
        ),
    ] = None
    match_percent: Annotated[
        float | None,
        typer.Option("--match-percent", help="Largest deviation, of the inlet's flow; 0.5."),
    ] = None
    least_lumen_mm: Annotated[
        float | None,
        typer.Option("--least-lumen-mm", min=0.0, help="Smallest diameter that can be printed."),
    ] = None
