"""Typer option types of `printctl slice`: meshes, heads, profiles, layers, lines, infill, speed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from design.toolpath.fresh import Infill
from design.units import LengthUnit

Models = Annotated[
    list[Path],
    typer.Argument(
        metavar="MESH...",
        help="STL, 3MF, PLY, OBJ or OFF; closed. Several, in one frame: each by a head of its "
        "own; where two overlap the later one counts.",
        show_default=False,
    ),
]
Out = Annotated[Path, typer.Option("--out", help="G-code file to write.", show_default=False)]
Unit = Annotated[
    LengthUnit | None, typer.Option("--unit", help="Of the meshes; a 3MF says it itself.")
]
Heads = Annotated[
    str | None,
    typer.Option(
        "--heads", help="Head of each mesh, counted from 0, like 0,1,1; if not given 0,1,..."
    ),
]
SyringeOfEach = Annotated[
    str, typer.Option("--syringe", help="Syringe profile; of several heads: left,right.")
]
InkOfEach = Annotated[str, typer.Option("--ink", help="Ink profile; of several heads: left,right.")]
NeedleOfEach = Annotated[
    str,
    typer.Option(
        "--needle",
        help="Needle profile, of several heads: left,right; what a pneumatic head lays needs it.",
    ),
]
DishName = Annotated[
    str | None,
    typer.Option("--dish", help="Dish profile: several heads are changed above its wall."),
]
Layer = Annotated[float, typer.Option("--layer-um", help="Height of a layer, µm.", min=5, max=2000)]
Thinnest = Annotated[
    float | None,
    typer.Option(
        "--thinnest-layer-um",
        help="Layers down to this height where walls are slanted, µm; all alike if not given.",
        min=5,
        max=2000,
    ),
]
Stair = Annotated[
    float,
    typer.Option(
        "--stair-um",
        help="With --thinnest-layer-um: depth of a slanted wall's stair from which on layers "
        "become thinner, µm.",
        min=1,
        max=500,
    ),
]
Line = Annotated[
    str, typer.Option("--line-um", help="Width of a line, µm; of several heads: left,right.")
]
Walls = Annotated[int, typer.Option("--walls", help="Along every boundary.", min=1, max=50)]
InfillKind = Annotated[Infill, typer.Option("--infill", help="What fills the inside of the walls.")]
InfillPercent = Annotated[
    float,
    typer.Option("--infill-percent", help="Share of the inside that is filled.", min=0, max=100),
]
Modifier = Annotated[
    list[str] | None,
    typer.Option(
        "--modifier",
        metavar="MESH:SETTING=VALUE,...",
        help="Inside this mesh the part is filled in another way: infill, infill-percent, "
        "infill-angles (45/135), or written by another head. Again for each.",
    ),
]
Speed = Annotated[float, typer.Option("--speed", help="Writing, mm/s.", min=0.01)]
