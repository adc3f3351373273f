"""`printctl calibrate board`, `camera`: draw a board; fit camera scale and distortion to photos."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import cv2
from PIL import Image

from design.files import atomic_replacement
from printctl.calibration import Estimate
from printctl.cli.calibrate_options import numbers_of, print_estimates
from printctl.cli.declare import command
from printctl.cli.options import JsonFlag, messages
from printctl.errors import UsageError
from printctl.settings import arg, opt
from registration.devices.lens import Board, board_picture, find_board, fit_lens, write_lens

_MARKER = 0.75
"""Side of a marker, of its square's."""
_MOST_PX = 30_000

Squares = Annotated[str, opt("Squares of the board.", metavar="COLUMNS,ROWS")]
Square = Annotated[float, opt("Side of a square.")]
Marker = Annotated[float | None, opt("Side of a marker; 0.75 of a square's if not.")]
Markers = Annotated[str, opt("OpenCV's name of the markers' set.")]


@command
def board(
    *,
    out: Path = arg("PNG to be written."),
    square_mm: Square,
    squares: Squares = "11,8",
    marker_mm: Marker = None,
    markers: Markers = "5X5_100",
    dpi: int = opt("Of the printer.", 1200, min=72, max=25400),
) -> None:
    """A ChArUco board to print at 100 % and glue onto something flat.

    Measure over ten squares what was printed: `calibrate camera` takes that.
    """
    if out.suffix.lower() != ".png":
        raise UsageError(f"{out}: a board is written as .png")
    asked = _board(squares, square_mm, marker_mm, markers)
    longest = (max(asked.columns, asked.rows) + 2) * square_mm * dpi / 25.4
    if longest > _MOST_PX:
        raise UsageError(
            f"the board would be {longest:.0f} px long ({_MOST_PX} at most); lower --dpi"
        )
    if asked.marker_mm / 7 * dpi / 25.4 < 4:
        raise UsageError(
            f"a marker's cells would be {asked.marker_mm / 7 * dpi / 25.4:.1f} dots of the printer "
            "wide (4 wanted); raise --dpi or --square-mm"
        )
    picture = board_picture(asked, dpi)
    # A square is a whole number of dots, so the file's dots differ a little from the printer's.
    true_dpi = 25.4 * picture.shape[1] / ((asked.columns + 2) * square_mm)
    with atomic_replacement(out) as draft:
        Image.fromarray(picture).save(draft, "PNG", dpi=(true_dpi, true_dpi))
    messages().print(f"wrote {out}: print it at 100 %", markup=False)


@command
def camera(
    *,
    pictures: list[Path] = arg("Pictures of the board; in the first it lies where prints will."),
    square_mm: Square,
    squares: Squares = "11,8",
    marker_mm: Marker = None,
    markers: Markers = "5X5_100",
    write: Path | None = opt("YAML file for --camera of widths and dye."),
    as_json: JsonFlag = False,
) -> None:
    """Scale and distortion of a camera or microscope, from pictures of a ChArUco board.

    One picture will do where the camera looks down on a plane: fill it with the board. Focus,
    zoom and distance stay as they are from then on.
    """
    asked = _board(squares, square_mm, marker_mm, markers)
    views = [find_board(path, asked) for path in pictures]
    lens = fit_lens(views)
    low, high = lens.um_per_px_95
    wide = math.prod(lens.size_px)
    covered = cv2.contourArea(cv2.convexHull(views[0].pixels.astype("float32"))) / wide
    notes = [
        f"{sum(len(view.pixels) for view in views)} corners in {len(views)} pictures, off by "
        f"{lens.off_px:.2g} px; the lens moves a place at the border by {lens.bends_px:.1f} px",
        "the scale is as right as --square-mm: measure over ten squares",
    ]
    if covered < 0.5:
        notes.append(
            f"the board fills {covered:.0%} of the first picture: distortion beyond it is a guess; "
            "fill half of it or more"
        )
    print_estimates({"scale in the picture's middle": Estimate(lens.um_per_px, low, high, "µm/px")},
         notes, as_json)  # fmt: skip
    if write is not None:
        write_lens(write, lens)
        messages().print(f"wrote {write}", markup=False)


def _board(squares: str, square_mm: float, marker_mm: float | None, markers: str) -> Board:
    sides = numbers_of(squares, "--squares")
    if len(sides) != 2 or any(side != int(side) for side in sides):
        raise UsageError(f"--squares {squares!r} isn't columns,rows; write it like 11,8")
    marker = _MARKER * square_mm if marker_mm is None else marker_mm
    return Board(int(sides[0]), int(sides[1]), square_mm, marker, markers)
