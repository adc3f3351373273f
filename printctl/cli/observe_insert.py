"""`printctl observe insert`: write a dish insert with marks, to print, plot or engrave."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final, cast, get_args

import typer

from design.solids.write import write_stl
from firmware_profiles import load
from firmware_profiles.plates import Dish
from printctl.cli.options import JsonFlag, folder_to_write, messages, print_json
from printctl.errors import UsageError
from registration.devices.camera_frame import (
    design_insert,
    insert_solids,
    write_dots,
    write_insert,
    write_svg,
)
from registration.devices.camera_frame.insert import Process

_SOLID: Final = ("fdm", "resin")
_DPI: Final = 1200


def insert(
    dish: Annotated[str, typer.Option("--dish", help="Dish profile: shipped name or .yaml file.")],
    out: Annotated[
        Path, typer.Option("--out", callback=folder_to_write, help="Folder to write to.")
    ],
    made: Annotated[
        str, typer.Option("--made", help="How it is made: fdm, resin, paper or engraved.")
    ] = "fdm",
    mark_mm: Annotated[float, typer.Option("--mark-mm", help="Side of a mark.")] = 8.0,
    thickness_mm: Annotated[
        float | None,
        typer.Option("--thickness-mm", help="Of the plate; 3 mm if not, of paper on a card 1 mm."),
    ] = None,
    hole_mm: Annotated[
        float | None,
        typer.Option(
            "--hole-mm",
            help="Hole along x: the dish outside and 0.5 mm; 4 mm more than "
            "the dish inside if not.",
        ),
    ] = None,
    as_json: JsonFlag = False,
) -> None:
    """Write a plate with ArUco marks that lies around the dish: drawings at true size, and bodies.

    Into the folder go `insert.yaml` (for `observe frame`), `insert.svg`, `.pdf` and `.png`; of a
    printed one `insert_white.stl` and `insert_black.stl`, which lie flush in one another. Then
    measure from cross to cross: `observe frame --measured` takes that.
    """
    if made not in get_args(Process):
        raise UsageError(f"--made {made!r} isn't one of {', '.join(get_args(Process))}")
    thick = thickness_mm if thickness_mm is not None else 3.0 if made in _SOLID else 1.0
    drawn = design_insert(
        load(Dish, dish), mark_mm=mark_mm, thickness_mm=thick, hole_mm=hole_mm,
        process=cast(Process, made),
    )  # fmt: skip
    solids = insert_solids(drawn) if made in _SOLID else None
    out.mkdir(parents=True, exist_ok=True)
    write_insert(out / "insert.yaml", drawn)
    write_svg(out / "insert.svg", drawn)
    write_dots(out / "insert.png", drawn, _DPI)
    write_dots(out / "insert.pdf", drawn, _DPI)
    if solids is not None:
        write_stl(out / "insert_white.stl", solids[0])
        write_stl(out / "insert_black.stl", solids[1])
    left, right = (c for c in drawn.crosses if c.name in ("left", "right"))
    if as_json:
        print_json({
            "folder": str(out), "marks": len(drawn.marks), "plate_mm": drawn.plate_mm,
            "hole_mm": drawn.hole_mm, "left_to_right_mm": right.x_mm - left.x_mm,
        })  # fmt: skip
        return
    messages().print(
        f"wrote {out}: {len(drawn.marks)} marks of {mark_mm:g} mm on {drawn.plate_mm[0]:.4g} x "
        f"{drawn.plate_mm[1]:.4g} mm, hole {drawn.hole_mm[0]:g} x {drawn.hole_mm[1]:g} mm. Make it "
        f"at 100 %, then measure from the left to the right cross ({right.x_mm - left.x_mm:.2f} mm "
        "as drawn)",
        markup=False,
    )
