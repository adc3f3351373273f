"""`printctl calibrate`: measure the constants of printer, ink, camera and scanner."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Literal

import cv2
import typer
from PIL import Image

from design.files import atomic_replacement
from printctl.calibration import Estimate
from printctl.calibration.scanner import ScannerCalibration
from printctl.cli.declare import command, group, json_command
from printctl.cli.judge.scan import voxel_mm
from printctl.cli.machine.calibrate_measured import (
    backlash,
    lag,
    level,
    offset,
    print_estimates,
    weigh,
)
from printctl.cli.machine.calibrate_pattern import pattern, widths
from printctl.cli.options import print_note, print_notes
from printctl.errors import UsageError
from printctl.settings import arg, numbers_of, opt, settings
from registration import ScanOverrides, read_scan
from registration.devices.lens import Board, board_picture, find_board, fit_lens, write_lens
from registration.devices.optics import write_calibration
from registration.wall_reference import read_reference


@json_command
def oct_device(
    grid: list[Path] | None = opt("Scan of a flat dot grid in air; again at another height."),
    pitch_um: float | None = opt("Pitch of the grid's dots.", min=10),
    pitch_u_um: float = opt(
        "Expanded uncertainty (k = 2) of the pitch from the grid's certificate.", 0.0, min=0.0
    ),
    step: Path | None = opt("Scan of a step of known height."),
    height_um: float | None = opt("Height of the step.", min=10),
    height_u_um: float = opt(
        "Expanded uncertainty (k = 2) of the height from the step's certificate.", 0.0, min=0.0
    ),
    reference: list[Path] | None = opt(
        "Report folder of a reference part with a certified model; repeat for other scans."
    ),
    reference_u_um: float = opt(
        "Expanded uncertainty (k = 2) of its diameters from its certificate.", 0.0, min=0.0
    ),
    immersed: bool = opt(
        "The step was immersed in the same medium as the prints.", False, "--immersed/--in-air"
    ),
    voxel_um: str | None = opt(
        "Voxel size if the files don't contain it; Z as optical path length.", metavar="X,Y,Z"
    ),
    axes: str | None = opt("Order of axes, slowest first.", metavar="ZYX"),
    scale: Literal["linear", "db"] | None = opt("Intensity scale if the files don't contain it."),
    write: Path | None = opt(
        "YAML file for `register --oct-calibration`; values of other targets in it are kept."
    ),
) -> None:
    """Fan, bow, scales and walls of a device: from a dot grid, a step, a part of known channels.

    Scan the grid in air at two heights at least 0.5 mm apart: one height can't show the fan.
    The step in air gives the scale of depth; under the medium (--immersed) its group index.
    The part's diameters give the offset of walls: register it with the model that it truly is.
    """
    voxel = voxel_mm(voxel_um)
    overrides = ScanOverrides(
        voxel_mm=voxel,
        optical_depth=None if voxel is None else True,
        refractive_index=1.0,
        scale=scale,
        modality="oct",
        axes=axes,
    )
    if not grid and step is None and not reference:
        raise UsageError(
            "give scans of a grid (--grid), of a step (--step) or reports of a part of known "
            "diameters (--reference)"
        )
    scanner = ScannerCalibration.beside(write)
    if step is not None:
        if height_um is None:
            raise UsageError("--step needs the step's height: give --height-um")
        scanner.add_step(read_scan(step, overrides), height_um, height_u_um, immersed=immersed)
    if grid:
        if pitch_um is None:
            raise UsageError("--grid needs the distance of its dots: give --pitch-um")
        scanner.add_grid([read_scan(path, overrides) for path in grid], pitch_um, pitch_u_um)
    if reference:
        scanner.add_reference([read_reference(path) for path in reference], reference_u_um)
    print_estimates(scanner.estimates(), scanner.all_notes())
    if write is not None:
        write_calibration(write, scanner.calibration)
        print_note(f"wrote {write}")


@json_command
def walls(
    phantoms: list[Path] = arg("Report folders of a reference part, as for --reference."),
    write: Path | None = opt("YAML file for `register --oct-calibration`."),
) -> None:
    """Old name of `calibrate oct --reference`, for one more release.

    The file that it writes is the device's, for `register --oct-calibration`.
    """
    print_notes(["the new name is printctl calibrate oct --reference"])
    oct_device(reference=phantoms, write=write)


_MARKER = 0.75
"""Side of a marker, of its square's."""
_MOST_PX = 30_000


@settings
class BoardOptions:
    """A ChArUco board, as it was printed."""

    square_mm: float = opt("Side length of a square.", ...)
    squares: str = opt("Number of squares of the board.", "11,8", metavar="COLUMNS,ROWS")
    marker_mm: float | None = opt("Side length of a marker; default 0.75 of a square.")
    markers: str = opt("OpenCV name of the marker dictionary.", "5X5_100")

    def board(self) -> Board:
        """Raise `UsageError` for --squares that aren't two whole numbers."""
        sides = numbers_of(self.squares, "--squares")
        if len(sides) != 2 or any(side != int(side) for side in sides):
            raise UsageError(f"--squares {self.squares!r} isn't columns,rows; write it like 11,8")
        marker = _MARKER * self.square_mm if self.marker_mm is None else self.marker_mm
        return Board(int(sides[0]), int(sides[1]), self.square_mm, marker, self.markers)


@command
def board(
    *,
    out: Path = arg("PNG file to write."),
    drawn: BoardOptions,
    dpi: int = opt("Print resolution.", 1200, min=72, max=25400),
) -> None:
    """A ChArUco board to print at 100 % and glue onto something flat.

    Measure over ten squares what was printed: `calibrate camera` takes that.
    """
    if out.suffix.lower() != ".png":
        raise UsageError(f"{out}: a board is written as .png")
    requested = drawn.board()
    longest = (max(requested.columns, requested.rows) + 2) * drawn.square_mm * dpi / 25.4
    if longest > _MOST_PX:
        raise UsageError(
            f"the board would be {longest:.0f} px long ({_MOST_PX} at most); lower --dpi"
        )
    cell_dots = requested.marker_mm / 7 * dpi / 25.4
    if cell_dots < 4:
        raise UsageError(
            f"a marker's cells would be {cell_dots:.1f} dots of the printer wide (4 wanted); raise "
            "--dpi or --square-mm"
        )
    picture = board_picture(requested, dpi)
    # A square is a whole number of dots, so the file's dots differ a little from the printer's.
    true_dpi = 25.4 * picture.shape[1] / ((requested.columns + 2) * drawn.square_mm)
    with atomic_replacement(out) as draft:
        Image.fromarray(picture).save(draft, "PNG", dpi=(true_dpi, true_dpi))
    print_note(f"wrote {out}: print it at 100 %")


@json_command
def camera(
    *,
    pictures: list[Path] = arg(
        "Images of the board; in the first one it is in the printing position."
    ),
    printed: BoardOptions,
    write: Path | None = opt("YAML file for the option --camera of `widths` and `dye`."),
) -> None:
    """Scale and distortion of a camera or microscope, from pictures of a ChArUco board.

    One picture will do where the camera looks down on a plane: fill it with the board. Focus,
    zoom and distance stay as they are from then on.
    """
    requested = printed.board()
    views = [find_board(path, requested) for path in pictures]
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
         notes)  # fmt: skip
    if write is not None:
        write_lens(write, lens)
        print_note(f"wrote {write}")


calibrate = group(
    typer.Typer(
        help="Measure a machine's and an ink's constants, each with its uncertainty.",
        no_args_is_help=True,
    ),
    *(weigh, offset, level, backlash, lag, pattern, widths, board, camera),
    oct=oct_device,
    walls=walls,
)
