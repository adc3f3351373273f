"""Typer options of `printctl simulate` for the ink prediction: lag, design, origin, voxel size."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from design.units import LengthUnit
from printctl.cli.options import folder_to_write

OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        callback=folder_to_write,
        help="Folder for what will lie in the bath: tables, a time line, voxels.",
    ),
]
LagOption = Annotated[
    float | None,
    typer.Option(
        "--lag-s", min=0.0, max=100, help="τ of the ink's flow, instead of its profile's."
    ),
]
NetworkOption = Annotated[
    Path | None,
    typer.Option(
        "--network", help="The designed vessels, for the diameter of each: a file or a run folder."
    ),
]
UnitOption = Annotated[
    LengthUnit | None, typer.Option("--unit", help="Of the network's file, if it doesn't say.")
]
PlaceOption = Annotated[
    str | None,
    typer.Option(
        "--place",
        metavar="X,Y,Z",
        help="The part's origin in the printer's frame, mm; found from what is written if not.",
    ),
]
VoxelOption = Annotated[
    float | None,
    typer.Option("--voxel-um", min=1, max=2000, help="Write voxels (NRRD) and a surface (PLY)."),
]
WindowOption = Annotated[
    str | None,
    typer.Option("--window-s", metavar="FROM,TO", help="Of the time line; the whole job if not."),
]


@dataclass(frozen=True)
class BeadChoices:
    """What the options say; None for what wasn't given."""

    out: Path | None = None
    lag_s: float | None = None
    network: Path | None = None
    unit: LengthUnit | None = None
    place: str | None = None
    voxel_um: float | None = None
    window: str | None = None

    @property
    def asks(self) -> bool:
        """Whether anything of this is wanted."""
        return self != BeadChoices()
