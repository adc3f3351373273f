"""`printctl observe`: group of subcommands for the camera that watches prints."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Final, cast, get_args

import typer

from design.solids.write import write_stl
from firmware_profiles import load
from firmware_profiles.plates import Dish
from printctl.cli.declare import command
from printctl.cli.observe_frame import frame, tip
from printctl.cli.observe_looks import FrameFile, answer, looks
from printctl.cli.options import JsonFlag, folder_to_write, messages, print_json, print_lines
from printctl.errors import UsageError
from printctl.settings import arg, opt
from registration.devices.camera_frame import (
    check_frame,
    design_insert,
    insert_solids,
    read_frame,
    write_dots,
    write_insert,
    write_svg,
)
from registration.devices.camera_frame.check import LIMIT_UM
from registration.devices.camera_frame.insert import Process
from registration.devices.laser_sweep import fit_laser, trace
from registration.devices.lens.board import decoded
from registration.devices.lens.lens import write_model
from registration.errors import PictureError

# `printctl observe insert`: write a dish insert with marks, to print, plot or engrave.

_SOLID: Final = ("fdm", "resin")
_DPI: Final = 1200


@command
def insert(
    dish: str = opt("Dish profile: shipped name or .yaml file.", ...),
    out: Path = opt("Folder to write to.", ..., callback=folder_to_write),
    made: str = opt("How it is made: fdm, resin, paper or engraved.", "fdm"),
    mark_mm: float = opt("Side of a mark.", 8.0),
    thickness_mm: float | None = opt("Of the plate; 3 mm if not, of paper on a card 1 mm."),
    hole_mm: float | None = opt(
        "Hole along x: the dish outside and 0.5 mm; 4 mm more than the dish inside if not."
    ),
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


# `printctl observe sweep`: fit a laser line that a calibrated camera sees, by a flat face.

_T95: Final = 1.96


@command
def sweep(
    *,
    pictures: Path = arg(
        "Folder of pictures, TIFF of pages or video: the laser's line swept over a flat face in "
        "the dish."
    ),
    frame: FrameFile,
    floor_z: float = opt(
        "Height of that face, printer's frame, mm: touch it with the needle.", ...
    ),
    out: Path = opt("YAML file to write.", ..., "-o", "--out"),
    as_json: JsonFlag = False,
) -> None:  # fmt: skip
    """Fit how a laser line sweeps under a camera, so that pictures of its line become heights.

    The line must cross the insert left and right of the dish.
    """
    camera = read_frame(frame).under(None)
    traced = trace(pictures, camera)
    held = check_frame(traced.ground, camera, pictures)
    if not held.holds:
        raise PictureError(f"the camera's frame doesn't hold: {'; '.join(held.why)}")
    fitted = fit_laser(traced, camera, floor_z, datetime.now(UTC))
    laser = fitted.laser
    write_model(out, laser)
    at, above = (_T95 * one for one in laser.u_um)
    if as_json:
        print_json({
            "pictures": fitted.pictures, "of": traced.pictures, "off_um": laser.off_um,
            "height_95_um": at, "height_95_above_um": above, "point": laser.point,
        })  # fmt: skip
    else:
        print_lines(
            f"pictures            {fitted.pictures} of {traced.pictures} used",
            f"flat face           told {laser.off_um:.0f} µm off its height, per picture (RMS)",
            f"heights             ± {at:.0f} µm at z {floor_z:g} mm, ± {above:.0f} µm 5 mm above "
            "(95 %, of one picture's line)",
        )
    messages().print(f"wrote {out}", markup=False)


# `printctl observe check`: detect a moved camera or insert from the marks in one picture.
@command
def check(
    *,
    picture: Path = arg("Picture of the insert."),
    frame: FrameFile,
    limit_um: float = opt("Shift at the dish up to which a frame holds.", LIMIT_UM, min=1),
    as_json: JsonFlag = False,
) -> None:
    """Compare a picture's marks with the frame's: a bumped camera, a moved insert, another focus.

    Marks may be hidden, as long as four around the dish are seen.
    """
    held = read_frame(frame)
    answer = check_frame(decoded(picture), held, picture, limit_um)
    age = held.age_days(datetime.now(UTC))
    if as_json:
        number = {"moved_um": answer.moved_um, "u_um": answer.u_um}
        print_json({
            "holds": answer.holds, "marks": answer.marks, "why": answer.why,
            "notes": answer.notes, "age_days": age,
            **{name: one if math.isfinite(one) else None for name, one in number.items()},
        })  # fmt: skip
    else:
        moved = (
            "" if math.isnan(answer.moved_um)
            else f": moved {answer.moved_um:.0f} µm at the dish (± {2 * answer.u_um:.0f} µm), "
            f"{answer.marks} marks"
        )  # fmt: skip
        verdict = "holds" if answer.holds else "does not hold"
        print_lines(
            f"the frame of {age:.1f} days ago {verdict}{moved}",
            *answer.why,
            *answer.notes,
        )
    if not answer.holds:
        raise typer.Exit(3)


observe = typer.Typer(
    help="A camera over the dish: tie it to the printer, check it; what it saw of a print.",
    no_args_is_help=True,
)


observe.command("insert")(insert)


observe.command("frame")(frame)


observe.command("check")(check)


observe.command("tip")(tip)


observe.command("sweep")(sweep)


observe.command("looks")(looks)


observe.command("answer")(answer)
