"""Typer options of `printctl view` for networks and all files: page, picture, colour, view."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

import typer

from registration.report.picture import View

Shown = Literal[
    "radius", "flow", "pressure", "shear", "order", "tree", "deviation",
    "width", "kind", "speed", "height", "vessel",
]  # fmt: skip
"""`registration.report.picture.Colour` for networks, `registration.report.gcode.GcodeColour` for
G-code; the order is the vessels' in the one, that of writing in the other."""

SourceArg = Annotated[
    Path,
    typer.Argument(
        help="A run folder, a network (.csv, .vtp, .swc, .json, .npz, .txt), or G-code (.gcode).",
        show_default=False,
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", help="The page; view.html in the run, NAME.view.html beside a file."),
]
PngOption = Annotated[
    Path | None,
    typer.Option("--png", help="Draw a picture for a paper; without --out no page."),
]
ColourOption = Annotated[
    Shown | None,
    typer.Option(
        "--colour",
        "--color",
        help="What is coloured by at first: radius to deviation a network (kind where it has "
        "several, else radius), width to vessel and order G-code (width; height z of a job in "
        "passes).",
    ),
]
FromOption = Annotated[View, typer.Option("--from", help="Where the picture is seen from.")]
WidthOption = Annotated[int, typer.Option("--width", min=300, max=6000, help="Of --png.")]
PaletteFlag = Annotated[
    bool, typer.Option("--palette", help="Keep --png to 256 colours: a third of the size.")
]
OpenOption = Annotated[
    bool | None,
    typer.Option("--open/--no-open", help="Open the page in the browser; on a desktop, do."),
]
MostPiecesOption = Annotated[
    int,
    typer.Option("--most-pieces", min=1, help="Beyond it the page leaves out the thinnest."),
]
