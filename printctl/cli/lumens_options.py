"""Typer options of `printctl lumens`: G-code, network or part, ink, needle, line widths, origin."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from design.units import LengthUnit

FileArg = Annotated[Path, typer.Argument(help="The G-code file.", show_default=False)]
NetworkOption = Annotated[
    Path | None,
    typer.Option("--network", help="The designed vessels: a network's file or a run folder."),
]
ModelOption = Annotated[
    Path | None,
    typer.Option(
        "--model", help="The part as a closed mesh; without a network its holes are the lumens."
    ),
]
UnitOption = Annotated[
    LengthUnit | None,
    typer.Option("--unit", help="Of the network's and the model's files, if they don't say."),
]
SyringeOption = Annotated[
    str | None,
    typer.Option(
        "--syringe",
        help="E is the plunger's travel in this syringe; of several heads: left,right.",
    ),
]
InkOption = Annotated[
    str | None,
    typer.Option(
        "--ink",
        help="Whose flow factor (out over pushed) the file was made for, and whose bead lines have "
        "(without one: rounded); of a pneumatic head, what flows.",
    ),
]
NeedleOption = Annotated[
    str | None,
    typer.Option("--needle", help="Of a pneumatic head: through which the ink flows."),
]
FlowOption = Annotated[
    float | None,
    typer.Option("--flow-ul-s", min=1e-9, help="Of a pneumatic head while its valve is open."),
]
FilamentOption = Annotated[
    float | None,
    typer.Option("--filament-mm", min=0.05, max=20, help="E is the way of such a filament."),
]
LineOption = Annotated[
    float | None,
    typer.Option("--line-um", min=5, max=10_000, help="All lines are so wide, whatever E is."),
]
LayerOption = Annotated[
    float | None,
    typer.Option("--layer-um", min=1, max=5000, help="Of a file with one layer."),
]
EmbeddedFlag = Annotated[
    bool,
    typer.Option(
        "--embedded",
        help="Filaments written along the vessels, not layers; found by itself where writing isn't "
        "level, or where FILE.map.npz says so.",
    ),
]
PlaceOption = Annotated[
    str | None,
    typer.Option("--place", metavar="X,Y,Z", help="The part's origin in the printer's frame, mm."),
]
LeakOption = Annotated[
    float, typer.Option("--leak-um", min=10, max=2000, help="Narrower ways are no leaks.")
]
AllFlag = Annotated[bool, typer.Option("--all", help="A row for every lumen.")]
