"""Typer options of `printctl film`: growth or pulse, steps, solver, colour, size, frame rate."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

ShowOption = Annotated[
    Literal["growth", "pulse"], typer.Option("--show", help="How it grew, or a pulse through it.")
]
OutOption = Annotated[
    Path | None,
    typer.Option(
        "--out",
        help="The film: .mp4, .mov, .avi, .gif or .webp; growth.mp4 or pulse.mp4 in the run.",
        show_default=False,
    ),
]
ByOption = Annotated[
    Literal["terminals", "generations"],
    typer.Option("--by", help="Of growth: one terminal after the other, or joint after joint."),
]
StepsOption = Annotated[
    int, typer.Option("--steps", min=2, max=2000, help="Frames of growth by terminals.")
]
ColourOption = Annotated[
    Literal["radius", "kind", "tree", "order", "flow", "pressure"] | None,
    typer.Option(
        "--colour",
        "--color",
        help="Of growth any (kind where there are several, else radius); of a pulse pressure or "
        "flow.",
        show_default=False,
    ),
]
SolverOption = Annotated[
    Literal["0d", "1d"], typer.Option("--solver", help="Of a pulse: lumped, or waves (1d).")
]
FramesOption = Annotated[int, typer.Option("--frames", min=8, max=2000, help="Of a cycle.")]
CyclesOption = Annotated[int, typer.Option("--cycles", min=1, max=100, help="Of a pulse.")]
FpsOption = Annotated[
    float, typer.Option("--fps", min=1.0, max=60.0, help="Frames in 1 s of the film.")
]
WidthOption = Annotated[int, typer.Option("--width", min=300, max=3000, help="Pixels.")]
TablesOption = Annotated[
    Path,
    typer.Option("--tables", help="Folder of the recipe's tables (a pulse's, the outlets')."),
]
