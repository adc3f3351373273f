"""Command-line options of a print's set-up: needle, bath, dish, shaft crossings to accept."""

from __future__ import annotations

from typing import Annotated

import typer

NeedleOption = Annotated[
    str | None,
    typer.Option(
        "--needle", help="Needle profile; force and walls need it. Of several heads: left,right."
    ),
]
ThinnestBoreOption = Annotated[
    float,
    typer.Option(
        "--thinnest-bore",
        min=0.05,
        max=2.0,
        help="Narrowest line, over the needle's bore (0.8 of 0.2 mm are 0.16 mm); try it on the "
        "ink first.",
    ),
]
BathOption = Annotated[
    str | None, typer.Option("--bath", help="Bath profile; chemistry and warmth need it.")
]
AcceptCrossingsFlag = Annotated[
    bool,
    typer.Option(
        "--accept-crossings",
        help="Print although the needle's shaft passes through written vessels; the journal keeps "
        "it.",
    ),
]
DishOption = Annotated[str | None, typer.Option("--dish", help="Dish profile; walls need it.")]
DishCentreOption = Annotated[
    str | None,
    typer.Option("--dish-centre", metavar="X,Y", help="Printer's frame; below --start if not."),
]
BathDepthOption = Annotated[
    float | None, typer.Option("--bath-depth", help="How high the dish is filled, mm.", min=0.1)
]
