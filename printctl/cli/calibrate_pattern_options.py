"""Typer options of `printctl calibrate pattern`: profiles, line size, speeds, gaps, spans."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

Name = Annotated[
    Literal["lines", "spiral", "joint", "bridge", "comb", "squares"],
    typer.Argument(help="lines, spiral, joint, bridge, comb or squares.", show_default=False),
]
Output = Annotated[
    Path,
    typer.Option("--output", "-o", help="The G-code; .csv, .json, .svg stand beside it."),
]
NeedleName = Annotated[str, typer.Option("--needle", help="Needle profile.", show_default=False)]
PrinterName = Annotated[
    str, typer.Option("--printer", "--profile", help="Printer profile, shipped or a .yaml.")
]
InkName = Annotated[str, typer.Option("--ink", help="Ink profile.")]
At = Annotated[
    str,
    typer.Option(
        "--at", metavar="X,Y,Z", help="Middle of the pattern and height of its lines, mm."
    ),
]
Width = Annotated[
    float | None, typer.Option("--width", help="Of the line, mm; the needle's bore if not.")
]
Layer = Annotated[
    float | None, typer.Option("--layer", help="Height of a line, mm; half its width if not.")
]
RoundBead = Annotated[
    bool | None,
    typer.Option("--round/--flat", help="A filament, if a bath is named; or on a plate."),
]
Speeds = Annotated[str, typer.Option("--speeds", help="Of lines, mm/s.")]
FlowFactors = Annotated[
    str, typer.Option("--flow-factors", help="Of lines: multiples of the cross-section.")
]
Length = Annotated[float, typer.Option("--length", help="Of a line, mm.", min=1)]
Repeats = Annotated[int, typer.Option("--repeats", help="Of each line.", min=1)]
Steps = Annotated[
    int, typer.Option("--steps", help="Lines written slow, fast, slow, for the lag.", min=0)
]
Speed = Annotated[float, typer.Option("--speed", help="Of all but lines, mm/s.", min=0.01)]
Turns = Annotated[float, typer.Option("--turns", help="Of the spiral.", min=1, max=50)]
Pitch = Annotated[float | None, typer.Option("--pitch", help="Of the spiral, mm; 5 widths if not.")]
Gaps = Annotated[
    str | None, typer.Option("--gaps", help="Of the comb, mm; 0.2 to 2 widths if not.")
]
Overlaps = Annotated[
    str, typer.Option("--overlaps", help="Of joints, radii beyond the trunk's surface.")
]
Spans = Annotated[str, typer.Option("--spans", help="Of bridges, mm.")]
Across = Annotated[
    float | None,
    typer.Option(
        "--across", help="Of the squares' circle, mm; --dish less the needle and 3 mm, 50 if not."
    ),
]
Height = Annotated[float, typer.Option("--height", help="Of the bridges' pillars, mm.", min=0.1)]
