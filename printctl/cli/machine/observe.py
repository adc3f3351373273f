"""`printctl observe`: group of subcommands for the camera that watches prints."""

from __future__ import annotations

import math
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final, cast, get_args

import numpy as np
import typer

from firmware_profiles import Needle, load
from firmware_profiles.plates import Dish
from printctl.calibration.patterns import read_printed_lines
from printctl.cli.declare import group, json_command, wants_json
from printctl.cli.machine.running_print import answer, looks
from printctl.cli.options import folder_to_write, print_json, print_note, print_result
from printctl.errors import UsageError
from printctl.settings import arg, opt, three_numbers
from registration.devices import camera_frame
from registration.devices.camera_frame.check import LIMIT_UM
from registration.devices.camera_frame.insert import SOLID, Process
from registration.devices.laser_sweep import fit_laser, trace
from registration.devices.lens import read_lens
from registration.devices.lens.board import decoded
from registration.devices.lens.lens import write_model
from registration.errors import PictureError

_T95: Final = 1.96
_U_Z_MM: Final = 0.2
_U_Z_OF_PRINT_MM: Final = 5.0
"""How far the marks may lie above or below a print whose --at wasn't given."""
FrameFile = Annotated[Path, opt("File of `printctl observe frame`.")]


@json_command
def insert(
    dish: str = opt("Dish profile: shipped name or .yaml file.", ...),
    out: Path = opt("Folder for the files.", ..., callback=folder_to_write),
    made: str = opt("Manufacturing method: fdm, resin, paper or engraved.", "fdm"),
    mark_mm: float = opt("Side length of a mark.", 8.0),
    thickness_mm: float | None = opt("Plate thickness; default 3 mm, paper on a card 1 mm."),
    hole_mm: float | None = opt(
        "Hole size along x; default: outer dish size + 0.5 mm, or inner size + 4 mm."
    ),
) -> None:
    """Write a fiducial plate with ArUco marks for a dish: drawings at true size, and bodies.

    Into the folder go `insert.yaml` (for `observe frame`), `insert.svg`, `.pdf` and `.png`; of a
    printed one `insert_white.stl` and `insert_black.stl`, which lie flush in one another. Then
    measure from cross to cross: `observe frame --measured` takes that.
    """
    if made not in get_args(Process):
        raise UsageError(f"--made {made!r} isn't one of {', '.join(get_args(Process))}")
    thick = thickness_mm if thickness_mm is not None else 3.0 if made in SOLID else 1.0
    drawn = camera_frame.design_insert(
        load(Dish, dish), mark_mm=mark_mm, thickness_mm=thick, hole_mm=hole_mm,
        process=cast(Process, made),
    )  # fmt: skip
    camera_frame.write_files(out, drawn)
    left, right = (c.x_mm for c in drawn.crosses if c.name in ("left", "right"))
    marks, plate, hole = len(drawn.marks), drawn.plate_mm, drawn.hole_mm
    if wants_json():
        facts = {"folder": str(out), "marks": marks, "plate_mm": plate, "hole_mm": hole}
        print_json(facts | {"left_to_right_mm": right - left})
        return
    print_note(
        f"wrote {out}: {marks} marks of {mark_mm:g} mm on {plate[0]:.4g} x {plate[1]:.4g} mm, hole "
        f"{hole[0]:g} x {hole[1]:g} mm. Make it at 100 %, then measure from the left to the right "
        f"cross ({right - left:.2f} mm as drawn)"
    )


@json_command
def sweep(
    *,
    pictures: Path = arg(
        "Folder of images, multi-page TIFF or video: the laser line swept over a flat face in the "
        "dish."
    ),
    frame: FrameFile,
    floor_z: float = opt(
        "Height of that face in printer coordinates, mm: touch off the needle on it.", ...
    ),
    out: Path = opt("YAML file to write.", ..., "-o", "--out"),
) -> None:  # fmt: skip
    """Fit how a laser line sweeps under a camera, so that pictures of its line become heights.

    The line must cross the fiducial plate left and right of the dish.
    """
    camera = camera_frame.read_frame(frame).under(None)
    traced = trace(pictures, camera)
    held = camera_frame.check_frame(traced.ground, camera, pictures)
    if not held.holds:
        raise PictureError(f"the camera's frame doesn't hold: {'; '.join(held.why)}")
    fitted = fit_laser(traced, camera, floor_z, datetime.now(UTC))
    laser = fitted.laser
    write_model(out, laser)
    at, above = (_T95 * one for one in laser.u_um)
    facts = {
        "pictures": fitted.pictures, "of": traced.pictures, "off_um": laser.off_um,
        "height_95_um": at, "height_95_above_um": above, "point": laser.point,
    }  # fmt: skip
    print_result(facts, [
        f"pictures            {fitted.pictures} of {traced.pictures} used",
        f"flat face           told {laser.off_um:.0f} µm off its height, per picture (RMS)",
        f"heights             ± {at:.0f} µm at z {floor_z:g} mm, ± {above:.0f} µm 5 mm above "
        "(95 %, of one picture's line)",
    ])  # fmt: skip
    print_note(f"wrote {out}")


@json_command
def check(
    *,
    picture: Path = arg("Image of the fiducial plate."),
    frame: FrameFile,
    limit_um: float = opt("Maximum shift at the dish for the frame to be valid.", LIMIT_UM, min=1),
) -> None:
    """Compare a picture's marks with the frame's: a moved camera or plate, another focus.

    Marks may be hidden, as long as four around the dish are seen.
    """
    held = camera_frame.read_frame(frame)
    answer = camera_frame.check_frame(decoded(picture), held, picture, limit_um)
    age = held.age_days(datetime.now(UTC))
    facts = {
        name: None if isinstance(one, float) and not math.isfinite(one) else one
        for name, one in vars(answer).items()
    }
    moved = ""
    if not math.isnan(answer.moved_um):
        moved = f": moved {answer.moved_um:.0f} µm at the dish (± {2 * answer.u_um:.0f} µm), "
        moved += f"{answer.marks} marks"
    verdict = "holds" if answer.holds else "does not hold"
    lines = [f"the frame of {age:.1f} days ago {verdict}{moved}", *answer.why, *answer.notes]
    print_result(facts | {"age_days": age}, lines)
    if not answer.holds:
        raise typer.Exit(3)


@json_command
def frame(
    pictures: list[Path] = arg("Images of the fiducial plate, with nothing moved between them."),
    lens: Path = opt("File of `printctl calibrate camera`.", ...),
    insert: Path = opt("File of `printctl observe insert`.", ...),
    out: Path = opt("YAML file to write.", ..., "-o", "--out"),
    touched: list[str] | None = opt(
        "Printer position with the tip on a cross (left, right, front, back); at least two, with Z "
        "if the tip touches the plate.",
        metavar="CROSS=X,Y[,Z]"
    ),
    u_touch_mm: float = opt("Standard uncertainty of a touched position.", 0.05, min=0),
    printed: Path | None = opt(
        "Use a print in the dish instead: the .json of `calibrate pattern squares`; its lines are "
        "detected."
    ),
    at: str | None = opt(
        "Approximate plate centre and mark height in printer coordinates; touched crosses refine "
        "it. Default: the position of the print, or 0,0,0.",
        metavar="X,Y,Z"
    ),
    u_z_mm: float | None = opt("Standard uncertainty of Z in --at; default 0.2.", min=0.001),
    measured: str | None = opt(
        "Measured distance from the left to the right cross, and its standard uncertainty (0.03 "
        "mm).",
        metavar="MM[,U]"
    ),
    bath_surface_z_mm: float | None = opt(
        "Surface of a clear bath above the ink in printer coordinates, to correct refraction."
    ),
    index: float = opt("Refractive index of the bath.", 1.333, min=1, max=2),
) -> None:  # fmt: skip
    """Fit a camera's place over the printer to pictures of a fiducial plate.

    Without touched crosses and without a print the frame is the plate's own, moved to --at.
    """
    if touched and printed is not None:
        raise UsageError("give crosses (--touched) or a print (--printed), not both")
    optics, drawn = read_lens(lens, "--lens"), _measured(camera_frame.read_insert(insert), measured)
    images = [decoded(path) for path in pictures]
    marks = camera_frame.merged([
        camera_frame.find_marks(image, drawn, optics, path)
        for image, path in zip(images, pictures, strict=True)
    ])  # fmt: skip
    lines = (
        []
        if printed is None
        else [camera_frame.PrintedLine(*one) for one in read_printed_lines(printed)]
    )
    (x, y, z), u_z = _about(at, u_z_mm, lines)
    bath = (
        None
        if bath_surface_z_mm is None
        else camera_frame.Bath(surface_z_mm=bath_surface_z_mm, index=index)
    )
    ties = camera_frame.Ties(
        touches=[_touch(word, u_touch_mm) for word in touched or []],
        z_mm=z, u_z_mm=u_z, at_mm=(x, y), bath=bath,
    )  # fmt: skip
    now = datetime.now(UTC)
    if lines:
        found, ties = camera_frame.fit_printed_frame(
            images[0], lines, marks, drawn, optics, ties, now
        )
    else:
        found = camera_frame.fit_frame(marks, drawn, optics, ties, now)
    write_model(out, found)
    notes = camera_frame.frame_notes(found, drawn, optics, ties)
    facts = {
        "um_per_px": found.um_per_px, "u_um": 1e3 * found.u_mm, "marks": len(marks.index),
        "off_px": found.off_px, "insert_scale": found.insert_scale, "tied": found.tied,
        "eye_mm": found.eye_mm, "notes": notes,
    }  # fmt: skip
    print_result(facts, [
        f"camera to printer   ± {1e3 * _T95 * found.u_mm:.0f} µm (95 %, along the worst axis, in "
        "the dish)",
        f"scale               {found.um_per_px:.1f} µm a pixel in the dish's middle",
        f"marks               {len(marks.index)} of {len(drawn.marks)}, off by "
        f"{found.off_px:.2f} pixels",
        f"plate               {100 * (found.insert_scale - 1):+.2f} % against its drawing",
        *notes,
    ])  # fmt: skip
    print_note(f"wrote {out}")


def _about(
    at: str | None, u_z_mm: float | None, lines: list[camera_frame.PrintedLine]
) -> tuple[tuple[float, float, float], float]:
    """Fiducial plate's middle with its marks' height, and that height's standard uncertainty, mm.

    A print without --at lies in the plate's middle, and a camera that looks from aside tells how
    much higher the marks are.
    """
    if at is not None:
        x, y, z = three_numbers(at, "--at")
        return (x, y, z), u_z_mm or _U_Z_MM
    if not lines:
        return (0.0, 0.0, 0.0), u_z_mm or _U_Z_MM
    ends = np.array([end for line in lines for end in (line.begin, line.end)])
    x, y, z = (ends.min(axis=0) + ends.max(axis=0)).tolist()
    return (x / 2, y / 2, z / 2), u_z_mm or _U_Z_OF_PRINT_MM


def _measured(drawn: camera_frame.Insert, stated: str | None) -> camera_frame.Insert:
    if stated is None:
        return drawn
    try:
        length, u_mm = (float(word) for word in f"{stated},0.03".split(",")[:2])
    except ValueError:
        length = u_mm = 0.0
    if stated.count(",") > 1 or not (length > 0 and u_mm > 0):
        raise UsageError(f"--measured {stated!r} isn't MM or MM,U; write it like 66.61,0.03")
    return drawn.measured("left", length, u_mm)


def _touch(word: str, u_mm: float) -> camera_frame.Touch:
    name, _, numbers = word.partition("=")
    try:
        x, y, *z = (float(part) for part in numbers.split(","))
    except ValueError as exc:
        raise UsageError(
            f"--touched {word!r} isn't CROSS=X,Y or CROSS=X,Y,Z; write it like left=66.7,100.1,4.2"
        ) from exc
    if len(z) > 1:
        raise UsageError(f"--touched {word!r} has more than X, Y and Z")
    return camera_frame.Touch(name, x, y, z[0] if z else None, max(u_mm, 1e-4))


@json_command
def tip(
    pictures: list[Path] = arg("Images of the needle."),
    frame: list[Path] = opt(
        "File of `observe frame`; one for all images, or one per image (several cameras).", ...
    ),
    at: list[str] = opt(
        "Printer position for each image, in the same order.", ..., metavar="X,Y,Z"
    ),
    needle: str = opt("Needle profile.", ...),
    reach_mm: float = opt("Maximum deviation of the tip.", 2.0, min=0.1, max=20),
    ground: Path | None = opt(
        "Image of the same scene without the needle (single camera); default: the other images."
    ),
    known_z_mm: float | None = opt(
        "Standard uncertainty of Z if the needle was touched off; a single image is then enough.",
        min=0.001
    ),
) -> None:  # fmt: skip
    """Find where the needle's tip is: its offset from the printer's position, its width, its wear.

    Take four pictures with the needle at places some 20 mm apart around the dish's middle, well
    above the bath; or two of two cameras.
    """
    if len(at) != len(pictures):
        raise UsageError(f"{len(pictures)} pictures and {len(at)} places; give one --at for each")
    if len(frame) not in (1, len(pictures)):
        raise UsageError(f"{len(frame)} frames; give one, or one for each of {len(pictures)}")
    rod = load(Needle, needle)
    files = {path: camera_frame.read_frame(path) for path in frame}
    frames = [files[path] for path in (frame if len(frame) > 1 else frame * len(pictures))]
    places = np.array([three_numbers(word, "--at") for word in at])
    images, names = [decoded(path) for path in pictures], list(map(str, pictures))
    scene = None if ground is None else decoded(ground)
    views, missed = camera_frame.find_tips(
        images, names, frames, places, rod, reach_mm=reach_mm, ground=scene
    )
    for stated in missed:
        print_note(stated)
    if not views:
        raise PictureError("the tip is not found in any picture")
    first = None if known_z_mm is None else np.array([5.0, 5.0, known_z_mm])
    found = camera_frame.locate_tip(views, rod.outer_mm, u_first_mm=first)
    u_mm, offset, notes = found.u_mm, found.offset_mm, found.notes()
    facts = {
        "offset_mm": offset.tolist(), "u_mm": u_mm.tolist(), "outer_mm": found.outer_mm,
        "u_outer_mm": found.u_outer_mm, "worn": found.worn, "views": found.views,
        "misfit": found.misfit if np.isfinite(found.misfit) else None,
        "not_found": missed, "notes": notes,
    }  # fmt: skip
    print_result(facts, [
        *(
            f"tip {name}   {o:+.3f} ± {_T95 * u:.3f} mm from the printer's position"
            for name, o, u in zip("xyz", offset, u_mm, strict=True)
        ),
        f"outer   {found.outer_mm:.3f} ± {_T95 * found.u_outer_mm:.3f} mm ({rod.outer_mm:g} by the "
        "profile)",
        f"(95 %, {found.views} of {len(pictures)} pictures)",
        *notes,
    ])  # fmt: skip


observe = group(
    typer.Typer(
        help="A camera over the dish: tie it to the printer, check it; what it saw of a print.",
        no_args_is_help=True,
    ),
    *(insert, frame, check, tip, sweep, looks, answer),
)
