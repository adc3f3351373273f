"""Data model and YAML file of a laser that sweeps under a calibrated camera."""

from __future__ import annotations

from datetime import datetime
from pathlib import Path
from typing import Annotated, Final, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from kernels.arrays import FloatArray
from registration.devices.camera_frame.frame import CameraFrame
from registration.devices.lens.model_file import read_model, write_model

_KEY: Final = "printctl_laser"
Number = Annotated[float, Field(allow_inf_nan=False)]


class LaserSweep(BaseModel):
    """A line laser on a pivot or stage.

    Attributes
    ----------
    made : datetime
    point : (x, y, z, w), mm and 1
        Through which all planes of light pass, printer's frame: x/w, y/w, z/w; with w 0 the
        direction in which they all run.
    flat_z_mm : float, mm
        Of the face that the sweep was fitted over.
    off_um : float, µm
        RMS of the heights told of that face, per picture.
    u_um : (at the face, 5 mm above), µm
        Standard uncertainty of a height, of one picture.
    frame : CameraFrame
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    printctl_laser: Literal[1] = 1
    made: datetime
    point: tuple[Number, Number, Number, Number]
    flat_z_mm: Number
    off_um: Annotated[float, Field(ge=0, allow_inf_nan=False)]
    u_um: tuple[Number, Number]
    frame: CameraFrame

    def heights(self, ends: FloatArray, slopes: FloatArray) -> FloatArray:
        """Heights z (n,) at which rays meet a picture's plane of light, printer's frame, mm.

        Parameters
        ----------
        ends : (2, 3) float64, mm
            Two places of the laser's line on the insert.
        slopes : (n, 2) float64
            x and y per z of rays from the camera.
        """
        return heights_of(np.array(self.point), np.array(self.frame.eye_mm), ends, slopes)


def heights_of(
    point: FloatArray, eye: FloatArray, ends: FloatArray, slopes: FloatArray
) -> FloatArray:
    """Heights z (n,) at which rays meet the plane through two ends and a point (x, y, z, w), mm."""
    normal = np.cross(ends[1] - ends[0], point[:3] - point[3] * ends[0])
    down = normal @ (eye - ends[0])
    return np.asarray(eye[2] - down / (slopes @ normal[:2] + normal[2]))


def is_laser_file(path: Path) -> bool:
    """Whether a file is `write_laser`'s."""
    try:
        with path.open(encoding="utf-8") as file:
            return file.readline().startswith(_KEY)
    except (OSError, UnicodeDecodeError):
        return False


def write_laser(path: Path, laser: LaserSweep) -> None:
    """Write a file that `read_laser` reads back exactly.

    Raises
    ------
    OSError
        When the disk is full or the folder can't be written.
    """
    write_model(path, laser)


def read_laser(path: Path) -> LaserSweep:
    """Read a laser's file.

    Raises
    ------
    PictureError
        When the file is missing, or isn't one.
    """
    return read_model(path, LaserSweep, "laser", "printctl observe sweep")
