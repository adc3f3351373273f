"""`printctl observe frame`: fit a camera's pose over the printer to pictures of a dish insert."""

from __future__ import annotations

from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from firmware_profiles import Needle, load
from printctl.calibration.patterns import read_pattern
from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, messages, print_json, print_lines, three_numbers
from printctl.errors import UsageError
from printctl.settings import arg, opt
from registration.devices.camera_frame import (
    Bath,
    CameraFrame,
    Insert,
    PrintedLine,
    SeenMarks,
    Ties,
    TipView,
    Touch,
    find_crossings,
    find_marks,
    find_tip,
    fit_frame,
    grounds,
    locate_tip,
    merged,
    read_frame,
    read_insert,
)
from registration.devices.lens import Lens, read_lens
from registration.devices.lens.board import decoded
from registration.devices.lens.lens import write_model
from registration.errors import PictureError

_T95: Final = 1.96
_MISFIT_PX: Final = 1.0
_U_Z_MM: Final = 0.2
_U_Z_OF_PRINT_MM: Final = 5.0
"""How far the marks may lie above or below a print whose --at wasn't given."""


@command
def frame(
    pictures: list[Path] = arg("Pictures of the insert, nothing moved between them."),
    lens: Path = opt("File of `printctl calibrate camera`.", ...),
    insert: Path = opt("File of `printctl observe insert`.", ...),
    out: Path = opt("YAML file to write.", ..., "-o", "--out"),
    touched: list[str] | None = opt(
        "Printer's position with the tip on a cross (left, right, front, back); two or more, with "
        "Z where the tip touches the plate.",
        metavar="CROSS=X,Y[,Z]"
    ),
    u_touch_mm: float = opt("Standard uncertainty of a touched place.", 0.05, min=0),
    printed: Path | None = opt(
        "A print in the dish instead: the .json of `calibrate pattern squares`; its lines are "
        "looked for."
    ),
    at: str | None = opt(
        "Insert's middle and its marks' height, printer's frame, about; touched crosses tell it "
        "better. If not given, where the print lies, or 0,0,0.",
        metavar="X,Y,Z"
    ),
    u_z_mm: float | None = opt("Standard uncertainty of --at's Z; 0.2 if not given.", min=0.001),
    measured: str | None = opt(
        "Measured from the left to the right cross, and its standard uncertainty (0.03 mm).",
        metavar="MM[,U]"
    ),
    bath_surface_z_mm: float | None = opt(
        "Surface of a clear bath above the ink, printer's frame: refraction is taken into account."
    ),
    index: float = opt("Refractive index of the bath.", 1.333, min=1, max=2),
    as_json: JsonFlag = False,
) -> None:  # fmt: skip
    """Fit a camera's place over the printer to pictures of a dish insert.

    Without touched crosses and without a print the frame is the insert's own, moved to --at.
    """
    if touched and printed is not None:
        raise UsageError("give crosses (--touched) or a print (--printed), not both")
    optics, drawn = read_lens(lens), _measured(read_insert(insert), measured)
    images = [decoded(path) for path in pictures]
    marks = merged(
        [
            find_marks(image, drawn, optics, path)
            for image, path in zip(images, pictures, strict=True)
        ]
    )
    lines = [] if printed is None else _lines(printed)
    (x, y, z), u_z = _about(at, u_z_mm, lines)
    bath = None if bath_surface_z_mm is None else Bath(surface_z_mm=bath_surface_z_mm, index=index)
    ties = Ties(
        touches=[_touch(word, u_touch_mm) for word in touched or []],
        z_mm=z, u_z_mm=u_z, at_mm=(x, y), bath=bath,
    )  # fmt: skip
    now = datetime.now(UTC)
    if lines:
        first = fit_frame(marks, drawn, optics, ties, now)
        crossings = find_crossings(images[0], first.view, lines)
        ties = Ties(printed=crossings, z_mm=z, u_z_mm=u_z, at_mm=(x, y), bath=bath)
    found = fit_frame(marks, drawn, optics, ties, now)
    write_model(out, found)
    _tell(found, marks, optics, drawn, as_json, _height_note(found, ties))
    messages().print(f"wrote {out}", markup=False)


def _about(
    at: str | None, u_z_mm: float | None, lines: list[PrintedLine]
) -> tuple[tuple[float, float, float], float]:
    """Insert's middle with its marks' height, and that height's standard uncertainty, mm.

    A print without --at lies in the insert's middle, and a camera that looks from aside tells how
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


def _height_note(found: CameraFrame, ties: Ties) -> list[str]:
    off = found.middle_mm[2] - ties.z_mm
    if found.tied != "printed" or abs(off) < 3 * ties.u_z_mm:
        return []
    return [
        f"the marks seem to lie {off:+.1f} mm from --at's Z ({ties.z_mm:g} ± {ties.u_z_mm:g} mm), "
        "and the frame is a compromise of both: leave --at out, or give the marks' height"
    ]


def _measured(drawn: Insert, said: str | None) -> Insert:
    if said is None:
        return drawn
    try:
        length, *more = (float(word) for word in said.split(","))
    except ValueError as exc:
        raise UsageError(f"--measured {said!r} isn't MM or MM,U; write it like 66.61,0.03") from exc
    if len(more) > 1 or length <= 0 or any(u <= 0 for u in more):
        raise UsageError(f"--measured {said!r} isn't MM or MM,U; write it like 66.61,0.03")
    return drawn.measured("left", length, more[0] if more else 0.03)


def _touch(word: str, u_mm: float) -> Touch:
    name, _, numbers = word.partition("=")
    try:
        x, y, *z = (float(part) for part in numbers.split(","))
    except ValueError as exc:
        raise UsageError(
            f"--touched {word!r} isn't CROSS=X,Y or CROSS=X,Y,Z; write it like left=66.7,100.1,4.2"
        ) from exc
    if len(z) > 1:
        raise UsageError(f"--touched {word!r} has more than X, Y and Z")
    return Touch(name, x, y, z[0] if z else None, max(u_mm, 1e-4))


def _lines(path: Path) -> list[PrintedLine]:
    """The straight lines of a calibration pattern's squares or frame, printer's frame."""
    written = read_pattern(path)
    pattern, at = written.pattern, written.at_mm
    if at is None:
        raise UsageError(
            f"{path} doesn't say where it was printed: a former printctl wrote it; write and print "
            "the pattern again (printctl calibrate pattern squares)"
        )
    corner = np.array([at[0] - pattern.size_mm[0] / 2, at[1] - pattern.size_mm[1] / 2, at[2]])
    found = []
    for stroke in pattern.of_role("side", "frame"):
        ends = (stroke.points + corner).tolist()
        found += [PrintedLine(tuple(a), tuple(b), pattern.bead.width_mm) for a, b in pairwise(ends)]
    return found


def _tell(
    found: CameraFrame, marks: SeenMarks, lens: Lens, drawn: Insert, as_json: bool, notes: list[str]
) -> None:
    if lens.covariance is None:
        notes.append(
            "the lens file doesn't say how well its numbers are known; fit it to five pictures of "
            "a board, tilted by 20 to 40 degrees to different sides (printctl calibrate camera)"
        )
    if found.tied == "insert":
        notes.append("places are the insert's, moved to --at: nothing ties them to the printer")
    if found.off_px > _MISFIT_PX:
        notes.append(f"marks are off by {found.off_px:.1f} pixels: is the insert flat?")
    scale = found.insert_scale / drawn.scale - 1
    if abs(scale) > 3 * drawn.u_scale:
        notes.append(f"the insert is {100 * scale:+.2f} % larger than it should be; measure it")
    if as_json:
        print_json({
            "um_per_px": found.um_per_px, "u_um": 1e3 * found.u_mm, "marks": len(marks.index),
            "off_px": found.off_px, "insert_scale": found.insert_scale, "tied": found.tied,
            "eye_mm": found.eye_mm, "notes": notes,
        })  # fmt: skip
        return
    print_lines(
        f"camera to printer   ± {1e3 * _T95 * found.u_mm:.0f} µm (95 %, along the worst axis, in "
        "the dish)",
        f"scale               {found.um_per_px:.1f} µm a pixel in the dish's middle",
        f"marks               {len(marks.index)} of {len(drawn.marks)}, off by "
        f"{found.off_px:.2f} pixels",
        f"insert              {100 * (found.insert_scale - 1):+.2f} % against its drawing",
        *notes,
    )


# `printctl observe tip`: measure the needle tip's offset, width and wear in pictures.

_SURE_MM: Final = 0.02


@command
def tip(
    pictures: list[Path] = arg("Pictures of the needle."),
    frame: list[Path] = opt(
        "File of `observe frame`; one for all pictures, or one for each (several cameras).", ...
    ),
    at: list[str] = opt(
        "The printer's position in each picture, in their order.", ..., metavar="X,Y,Z"
    ),
    needle: str = opt("Needle profile.", ...),
    reach_mm: float = opt("How far the tip may be off.", 2.0, min=0.1, max=20),
    ground: Path | None = opt(
        "The same scene without the needle (of one camera); other pictures serve as such, if not "
        "given."
    ),
    known_z_mm: float | None = opt(
        "Standard uncertainty of Z, where the needle was touched off; one picture will do then.",
        min=0.001
    ),
    as_json: JsonFlag = False,
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
    files = {path: read_frame(path) for path in frame}
    frames = [files[path] for path in (frame if len(frame) > 1 else frame * len(pictures))]
    places = np.array([three_numbers(word, "--at") for word in at])
    views, missed = _views(pictures, frames, places, rod, reach_mm, ground)
    for said in missed:
        messages().print(said, markup=False)
    if not views:
        raise PictureError("the tip is not found in any picture")
    first = None if known_z_mm is None else np.array([5.0, 5.0, known_z_mm])
    found = locate_tip(views, rod.outer_mm, u_first_mm=first)
    u_mm, offset = found.u_mm, found.offset_mm
    notes = list(found.worn)
    if u_mm.max() > _SURE_MM:
        axis = "xyz"[int(u_mm.argmax())]
        notes.append(
            f"{axis} is known to {_T95 * 1e3 * u_mm.max():.0f} µm only: give more pictures with "
            "the needle farther apart, or one from another side"
        )
    if as_json:
        print_json({
            "offset_mm": offset.tolist(), "u_mm": u_mm.tolist(), "outer_mm": found.outer_mm,
            "u_outer_mm": found.u_outer_mm, "worn": found.worn, "views": found.views,
            "misfit": found.misfit if np.isfinite(found.misfit) else None,
            "not_found": missed, "notes": notes,
        })  # fmt: skip
        return
    print_lines(
        *(
            f"tip {name}   {o:+.3f} ± {_T95 * u:.3f} mm from the printer's position"
            for name, o, u in zip("xyz", offset, u_mm, strict=True)
        ),
        f"outer   {found.outer_mm:.3f} ± {_T95 * found.u_outer_mm:.3f} mm ({rod.outer_mm:g} by the "
        "profile)",
        f"(95 %, {found.views} of {len(pictures)} pictures)",
        *notes,
    )


def _views(
    pictures: list[Path],
    frames: list[CameraFrame],
    places: NDArray[np.float64],
    rod: Needle,
    reach_mm: float,
    ground: Path | None,
) -> tuple[list[TipView], list[str]]:
    """Pictures in which the tip is found, and what is said of the others."""
    images = [decoded(path) for path in pictures]
    scene = None if ground is None else decoded(ground)
    behind: list[NDArray[Any] | None] = [scene] * len(images)
    if ground is None:
        for one in {id(each): each for each in frames}.values():
            own = [n for n, each in enumerate(frames) if each is one]
            picked = grounds([images[n] for n in own], one, places[own], rod.outer_mm, reach_mm)
            for n, other in zip(own, picked, strict=True):
                behind[n] = other
    views, missed = [], []
    for n, path in enumerate(pictures):
        try:
            seen = find_tip(
                images[n], frames[n], places[n], rod.outer_mm, reach_mm=reach_mm,
                length_mm=rod.length_mm, ground=behind[n], source=str(path),
            )  # fmt: skip
        except PictureError as exc:
            missed.append(f"{path}: not found: {exc}")
            continue
        views.append(TipView(frames[n], seen, places[n]))
    return views, missed
