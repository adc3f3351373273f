"""`printctl observe sweep`: fit a laser line that a calibrated camera sees, by a flat face."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Final

import typer

from printctl.cli.observe_options import FrameFile
from printctl.cli.options import JsonFlag, messages, print_json, print_lines
from registration.devices.camera_frame import check_frame, read_frame
from registration.devices.laser_sweep import fit_laser, trace
from registration.devices.lens.lens import write_model
from registration.errors import PictureError

_T95: Final = 1.96


def sweep(
    pictures: Annotated[
        Path,
        typer.Argument(help="Folder of pictures, TIFF of pages or video: the laser's line swept "
                       "over a flat face in the dish.", show_default=False),
    ],
    frame: FrameFile,
    floor_z: Annotated[
        float,
        typer.Option("--floor-z", help="Height of that face, printer's frame, mm: touch it with "
                     "the needle.", show_default=False),
    ],
    out: Annotated[Path, typer.Option("-o", "--out", help="YAML file to write.")],
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
