"""Typer options of `printctl view FILE.gcode`: layer, syringe, filament, flow, designed part."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

LayerOption = Annotated[
    int | None,
    typer.Option(
        "--layer",
        min=1,
        help="G-code: layer or pass shown first, or drawn, counted from 1; the middle.",
    ),
]
GcodePrinterOption = Annotated[
    str | None,
    typer.Option(
        "--printer",
        help="G-code: whose head writes, by profile (a valve's file needs it); generic_marlin.",
    ),
]
GcodeSyringeOption = Annotated[
    str | None,
    typer.Option("--syringe", help="G-code: profile whose bore makes E a volume; hamilton_1ml."),
]
FilamentOption = Annotated[
    float | None,
    typer.Option(
        "--filament-mm",
        min=0.01,
        max=100,
        help="G-code: diameter that E is counted in, instead of a syringe's; as the file says.",
    ),
]
FlowOption = Annotated[
    float | None,
    typer.Option(
        "--flow-ul-s", min=1e-9, help="G-code: of a pneumatic head; as the profile measured it."
    ),
]
LayerHeightOption = Annotated[
    float | None,
    typer.Option(
        "--layer-um",
        min=1,
        max=5000,
        help="G-code: height of the lines; as the file says, or the spacing of its levels.",
    ),
]
ModelOption = Annotated[
    Path | None,
    typer.Option(
        "--model",
        help="G-code: the part's mesh; its outline is drawn in each layer, coloured by how far "
        "ink lies beyond it.",
    ),
]
PlaceOption = Annotated[
    str | None,
    typer.Option(
        "--place",
        metavar="X,Y,Z",
        help="G-code: the --model's origin in the printer's frame, mm; found from what is written.",
    ),
]
